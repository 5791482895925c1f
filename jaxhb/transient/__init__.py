"""Time integration: the referee, and starts for the harmonic solution."""
