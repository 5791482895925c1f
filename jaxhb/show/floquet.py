"""What becomes of a small disturbance of a periodic motion, in words: no unstable one goes without."""

from dataclasses import dataclass

from ..periodic.stability import STABILITY, largest_multiplier, reducible, stability

DECIDED = 0.15
"""Distance from 1 beyond which the nearly known multiplier of a large train decides: it is good to 10 %."""


@dataclass(frozen=True)
class Growth:
    """Growth of a disturbance over one period of a motion.

    multiplier : float or None, modulus of the largest Floquet multiplier
    stable : bool or None, whether disturbances die away
    loses_by : str, how stability is lost, "" where that is not known
    refused : str, why there is no multiplier, "" where there is one or nothing to tell
    nearly : float or None, the multiplier with a little inertia in massless disks, where refused
    """

    multiplier: float | None = None
    stable: bool | None = None
    loses_by: str = ""
    refused: str = ""
    nearly: float | None = None

    @property
    def unstable(self):
        """Whether disturbances grow, as far as is known."""
        return self.stable is False or (self.nearly is not None and self.nearly > 1 + DECIDED)


def growth_of(state, *, orbit):
    """The :class:`Growth` of the motion of a steady state or orbit.

    Parameters
    ----------
    state : SteadyState
    orbit : bool
        A march did not find it: where its stability is refused, the nearly known multiplier is taken.
    """
    response = state.response
    if response is None or not state.known or not reducible(response.topology):
        return Growth()  # disturbances of a linear train die away as its modes do
    try:
        large = response.topology.n_disks > STABILITY.dense_disks
        # Of many disks all multipliers take long: the largest alone decides where it is far from 1.
        largest = largest_multiplier(response) if large else 1.0
        if abs(largest - 1) > DECIDED:
            return Growth(largest, largest < 1)
        found = state.stability or stability(response)
        return Growth(found.largest, found.stable, found.loses_by or "")
    except ValueError as refusal:
        return Growth(refused=str(refusal), nearly=largest_multiplier(response) if orbit else None)


def growth_text(growth, period=1):
    """What a Growth says of a motion of ``period`` cycles; "" where nothing is known."""
    span = "a cycle" if period <= 1 else f"{period} cycles"
    size = growth.nearly if growth.multiplier is None else growth.multiplier
    if size is None:
        return ""
    about = ", with a little inertia in massless disks" if growth.refused else ""
    if growth.unstable:
        how = f" ({growth.loses_by})" if growth.loses_by else ""
        return f"UNSTABLE{how}: a disturbance grows {size:.3g} times in {span}{about}; the train does not run in it"
    if growth.stable is None:
        return f"stability not certain: a disturbance falls to {size:.2g} of its size in {span}{about}"
    return f"stable: a disturbance falls to {size:.2g} of its size in {span}"
