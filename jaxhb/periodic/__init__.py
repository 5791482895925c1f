"""Finding and certifying periodic solutions."""
