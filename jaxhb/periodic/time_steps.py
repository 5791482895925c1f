"""How many time steps a cycle takes: one of a few numbers, as each is a program."""

PER_MODE_PERIOD = 6
"""Steps per period of the highest mode: forces that change linearly within a step then do."""

PER_HARMONIC, MULTIPLE = 4, 32
"""Steps per harmonic that is an unknown: estimates of the truncation error see twice as many harmonics; and what the
number of steps is a multiple of."""

COUNTS = tuple(n * 2**k for k in range(5, 13) for n in (2, 3)) + (16384,)


def time_steps_for(harmonic):
    """Time steps per cycle for motion up to ``harmonic`` of the cycle."""
    return next((n for n in COUNTS if n >= PER_MODE_PERIOD * harmonic), COUNTS[-1])


def time_steps_of(harmonics):
    """Time steps per cycle of the preconditioner for so many harmonics: a level has one program."""
    return min(-(-PER_HARMONIC * harmonics // MULTIPLE) * MULTIPLE, COUNTS[-1])
