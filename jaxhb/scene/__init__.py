"""Scene files: a file (TOML, or of another program) goes in and a train comes out, and
the other way round.
"""
