"""What a solve tried, in order: the entries of ``Response.path``. ``str`` says each for people."""

from dataclasses import dataclass

from .status import Status


@dataclass(frozen=True)
class Newton:
    """Newton's method on the harmonics; without unknown meshes one linear solve."""

    harmonics: int
    active_meshes: int
    integrals: str
    status: Status
    steps: int

    def __str__(self):
        size = f"{self.harmonics} harmonics" + (", exact integrals" if self.integrals == "exact" else "")
        if not self.active_meshes:
            return f"linear solve with {size}: {self.status.name}"
        return f"Newton with {size}: {self.status.name}, {self.steps} steps"


@dataclass(frozen=True)
class March:
    """Time integration over some cycles; the last one misses its beginning by the periodicity error."""

    cycles: int
    time_steps: int
    periodicity_error: float

    def __str__(self):
        size = f"{self.cycles} cycles of {self.time_steps} steps"
        return f"march of {size} (periodicity error {self.periodicity_error:.1e})"


@dataclass(frozen=True)
class Shooting:
    """Newton's method on the state at the beginning of a cycle, tried from so many cycles of a march.

    refined : begun from an orbit that fewer time steps found; closed : whether the orbit counts as periodic.
    """

    cycles: int
    time_steps: int
    periodicity_error: float
    closed: bool
    refined: bool = False

    def __str__(self):
        begun = "in segments, cycle" if self.refined else f"from {self.cycles} cycles"
        return f"shooting {begun} of {self.time_steps} steps (periodicity error {self.periodicity_error:.1e})"


@dataclass(frozen=True)
class Homotopy:
    """The curve of motions from the linear law to the wanted one; ``curves`` 0: too long to be tried."""

    found: bool
    curves: int
    steps: int
    turning_points: int
    time_steps: int

    def __str__(self):
        if not self.curves:
            return "homotopy from the linear law: not tried, too long"
        found = "found" if self.found else "lost"
        counts = f"curve no. {self.curves}, {self.steps} steps, {self.turning_points} turning points"
        return f"homotopy from the linear law: {found}, {counts}, cycle of {self.time_steps} steps"
