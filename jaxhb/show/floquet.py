"""What becomes of a small disturbance of a periodic motion, in words: no unstable one goes without."""

from dataclasses import dataclass

from ..periodic.stability import attracts


@dataclass(frozen=True)
class Growth:
    """Growth of a disturbance over one period of a motion.

    multiplier : float or None, modulus of the largest Floquet multiplier
    stable : bool or None, whether disturbances die away
    loses_by : str, how stability is lost, "" where that is not known
    refused : str, why there is no multiplier, "" where there is one or nothing to tell
    """

    multiplier: float | None = None
    stable: bool | None = None
    loses_by: str = ""
    refused: str = ""

    @property
    def unstable(self):
        """Whether disturbances grow, as far as is known."""
        return self.stable is False


def growth_of(state):
    """The :class:`Growth` of the motion of a steady state or orbit."""
    if state.response is None or not state.known:
        return Growth()
    found, refused = state.stability, ""
    if found is None:
        _, found, refused = attracts(state.response)
    if found is not None:
        return Growth(found.largest, found.stable, found.loses_by or "")
    return Growth(refused="" if state.kind == "contact" else refused)  # teeth in contact are a linear train


def growth_text(growth, period=1):
    """What a Growth says of a motion of ``period`` cycles; "" where nothing is known."""
    span = "a cycle" if period <= 1 else f"{period} cycles"
    size = growth.multiplier
    if size is None:
        return f"stability not decided: {growth.refused}" if growth.refused else ""
    if growth.unstable:
        how = f" ({growth.loses_by})" if growth.loses_by else ""
        return f"UNSTABLE{how}: a disturbance grows {size:.3g} times in {span}; the train does not run in it"
    return f"stable: a disturbance falls to {size:.2g} of its size in {span}"
