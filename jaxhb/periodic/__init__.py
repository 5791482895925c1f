"""Finding periodic solutions and estimating their errors."""
