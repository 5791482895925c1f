"""How many time steps a cycle takes: one of a few numbers, as each is a program."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TimeStepOptions:
    """How many time steps a cycle takes.

    Parameters
    ----------
    per_mode_period : steps per period of the highest mode: with so many, forces that change linearly within a step
        suffice
    per_harmonic : steps per harmonic that is an unknown: estimates of the truncation error see twice as many harmonics
    multiple : what the number of steps is a multiple of: blocks of the preconditioner and segments of a cycle divide it
    counts : numbers of steps that are offered
    """

    per_mode_period: int = 6
    per_harmonic: int = 4
    multiple: int = 32
    counts: tuple[int, ...] = (*(n * 2**k for k in range(5, 13) for n in (2, 3)), 16384)


TIME_STEPS = TimeStepOptions()


def time_steps_for(harmonic):
    """Time steps per cycle for motion up to ``harmonic`` of the cycle."""
    return next((n for n in TIME_STEPS.counts if n >= TIME_STEPS.per_mode_period * harmonic), TIME_STEPS.counts[-1])


def time_steps_of(harmonics):
    """Time steps per cycle of the preconditioner for so many harmonics: a level has one program."""
    multiple = TIME_STEPS.multiple
    return min(-(-TIME_STEPS.per_harmonic * harmonics // multiple) * multiple, TIME_STEPS.counts[-1])
