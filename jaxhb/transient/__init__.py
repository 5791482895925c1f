"""Time integration: the reference integration, and starts for the harmonic solution."""
