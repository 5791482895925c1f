"""What is asked of a solve, checked on the host, and how many time steps a cycle takes for it."""

from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import traced
from jaxhb.elements.elements import SceneError
from jaxhb.excitation.torques import highest_harmonic
from jaxhb.train import chain


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


MOST_HARMONICS = {"reduced": 4096, "chain": 128}
"""Harmonics of the cycle at most, by method: work and memory grow with N, for the chain with N^3 and N^2."""

DEFAULT_TOLERANCE = 0.01
"""Truncation error of the elastic tooth force, as a share of the largest tooth force."""


@dataclass(frozen=True)
class Request:
    """What is asked of a solve: ``harmonics`` None for as many as ``tolerance`` needs; see :func:`jaxhb.solve`.

    few_levels : whether numbers of harmonics lie far apart, so that the speeds of a sweep share few programs.
    """

    harmonics: int | None = None
    tolerance: float = DEFAULT_TOLERANCE
    method: str = "reduced"
    integrals: str = "sampled"
    few_levels: bool = False

    @classmethod
    def of(cls, train, harmonics=None, tolerance=None, method=None, integrals=None, few_levels=False):
        """The request with defaults for None, checked."""
        made = cls(
            harmonics,
            DEFAULT_TOLERANCE if tolerance is None else tolerance,
            method or "reduced",
            integrals or "sampled",
            few_levels,
        )
        check_method(train, made.method)
        check_integrals(made.integrals, made.method)
        check_tolerance(train, made.tolerance)
        if harmonics is not None:
            check_harmonics(train, harmonics, made.method)
        return made


def check_harmonics(train, harmonics, method):
    """Refuse a fixed number of harmonics that cannot work, with a sentence."""
    name = train.topology.title
    if not (isinstance(harmonics, int | np.integer) and harmonics >= 1):
        raise SceneError(f"{name}: harmonics is {harmonics}, must be a whole number of at least 1.")
    least = highest_harmonic(train)
    if harmonics < least:
        raise SceneError(
            f"{name}: {harmonics} harmonics of the cycle are below the excitation, which reaches harmonic {least} "
            f"(order {least / train.topology.revolutions_per_cycle:g}): ask for at least {least} harmonics."
        )
    if harmonics > MOST_HARMONICS[method]:
        raise SceneError(_too_many(train, harmonics, method, name))


def check_tolerance(train, tolerance):
    """Refuse a tolerance that is not a share of the largest tooth force."""
    if not 0 < tolerance < 1:
        name = train.topology.title
        raise SceneError(
            f"{name}: tolerance is {tolerance:g}, must be greater than 0 and less than 1: the share of the largest "
            "tooth force that the harmonics left out may make, 0.01 by default."
        )


def excited_harmonic(train, method):
    """Highest harmonic of the excitation that counts; a sentence where ``method`` cannot reach it."""
    highest = highest_harmonic(train)
    if highest > MOST_HARMONICS[method]:
        raise SceneError(
            f"{train.topology.title}: the excitation reaches harmonic {highest} of the cycle, more than the "
            f"{MOST_HARMONICS[method]} that method '{method}' offers: drop its highest orders or shorten the cycle."
        )
    return highest


def check_plan(train, plan):
    """Refuse a plan made for another train: backlash it does not know, or more excitation than it holds."""
    name, gaps = train.topology.title, train.topology.mesh_backlash
    known = len(plan.flank) == len(gaps)
    if not known or any(gap and i not in plan.active and not plan.flank[i] for i, gap in enumerate(gaps)):
        raise SceneError(f"{name}: the plan was made for a train without this backlash or other meshes: plan again.")
    if not traced(train):
        with jax.ensure_compile_time_eval():  # under jit, too
            check_harmonics(train, plan.harmonics, plan.method)


def check_method(train, method):
    """Refuse an unknown method, and the chain sweep on a closed loop."""
    if method not in MOST_HARMONICS:
        raise ValueError(f"method is {method!r}: give 'reduced' or 'chain'")
    loops = chain.span(train.topology).loops
    if method == "chain" and len(loops):
        names = ", ".join(repr(train.topology.link_names[i]) for i in loops)
        raise SceneError(
            f"{train.topology.title}: {names} closes a loop, and method 'chain' needs a tree: use 'reduced'."
        )


def check_integrals(integrals, method):
    """Refuse unknown integrals, and exact ones where the method has none."""
    if integrals not in ("sampled", "exact"):
        raise ValueError(f"integrals is {integrals!r}: give 'sampled' or 'exact'")
    if integrals == "exact" and method != "reduced":
        raise ValueError(f"exact integrals need method 'reduced', and method is {method!r}: change one of them")


def _too_many(train, harmonics, method, name):
    if method == "chain":
        disks, width = train.topology.n_disks, 2 * harmonics + 1
        need = 6 * disks * width**2 * 8 / 2**30
        return (
            f"{name}: method 'chain' holds dense blocks for all {disks} disks, about {need:.1f} GiB at {harmonics} "
            f"harmonics, and serves as a check up to {MOST_HARMONICS['chain']} harmonics: use method 'reduced'."
        )
    return f"{name}: {harmonics} harmonics are more than the limit of {MOST_HARMONICS['reduced']}: use fewer."
