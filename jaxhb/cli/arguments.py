"""The options of every command as values, by the names under which
:mod:`jaxhb.cli.main` declares them.

A class has the options of one command; those that several commands take are in classes
that it inherits.
"""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from jaxhb.report.files.compared import Compared

Setting = tuple[str, float | str]
"""``NAME.FIELD`` and the value that it gets."""


@dataclass(frozen=True, kw_only=True)
class CommonOptions:
    """Options of all commands that read a scene; ``files`` are paths of those to write,
    by the names of :data:`jaxhb.report.files.formats.FORMATS`.
    """

    scene: str
    quiet: bool = False
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class SceneOptions(CommonOptions):
    """Options of ``jaxhb scene``."""

    expand: bool
    referred: bool


@dataclass(frozen=True, kw_only=True)
class ChangedOptions(CommonOptions):
    """Values of the scene that a command changes, and the units in which it shows
    quantities, by their names.
    """

    set: tuple[Setting, ...]
    units: Mapping[str, str] | None = None
    rules: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ComputedOptions(ChangedOptions):
    """Options of all commands that compute the train as a scenario leaves it.

    scenarios : those asked for; scenario : the one that this run takes, None for the
    scene as written; links_at : where links that vary become constant; compared : what
    is compared over several scenarios, None where there is one.
    """

    scenarios: tuple[str, ...]
    scenario: str | None = None
    links_at: tuple[tuple[str, float], ...]
    viscous: float | None
    compared: "list[Compared] | None" = None


@dataclass(frozen=True, kw_only=True)
class ParallelOptions:
    """Where independent parts are computed: by so many processes of this machine, or by
    the workers of the scheduler at an address; ``executor`` is what the command opens
    for it.
    """

    workers: int | None
    scheduler: str | None
    quiet: bool = False
    executor: Executor | None = None


@dataclass(frozen=True, kw_only=True)
class CampaignOptions(ParallelOptions):
    """Options of ``jaxhb campaign``: its study, and the folder of the rows."""

    study: str
    folder: str | None
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class FiringOptions:
    """Cylinders that do not fire, and those that have no gas torque at all."""

    misfire: tuple[str, ...]
    cut_off: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class AccuracyOptions:
    """Number of harmonics, or the largest truncation error."""

    harmonics: int | None
    tolerance: float


@dataclass(frozen=True, kw_only=True)
class MotionOptions(AccuracyOptions):
    """The motion asked for: a periodic solution, or what the train does."""

    orbit: bool


@dataclass(frozen=True, kw_only=True)
class SpectraOptions:
    """Amplitudes in files up to an order, None for all."""

    orders: float | None


@dataclass(frozen=True, kw_only=True)
class CheckOptions(ComputedOptions):
    """Options of ``jaxhb check``; ``excitation`` is the cylinder whose tangential
    pressures are asked for, at ``loads``, none for its own.
    """

    rpm: list[float] | None
    excitation: str | None
    loads: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ModesOptions(ComputedOptions):
    """Options of what takes modes."""

    at: float | None


@dataclass(frozen=True, kw_only=True)
class ShapeOptions(ModesOptions):
    """Options of ``jaxhb modes``."""

    vector_sums: bool


@dataclass(frozen=True, kw_only=True)
class HolzerOptions(ModesOptions):
    """Options of ``jaxhb holzer``: frequencies, or modes by their numbers."""

    hz: tuple[float, ...]
    mode: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class CampbellOptions(ModesOptions, FiringOptions):
    """Options of ``jaxhb campbell``; ``modes`` is how many are drawn."""

    rpm: list[float]
    orders: list[float] | None
    modes: int


@dataclass(frozen=True, kw_only=True)
class ForcedOptions(ComputedOptions, FiringOptions, SpectraOptions):
    """Options of ``jaxhb forced``; ``element`` are those told speed by speed, and with
    ``by_cylinder`` by what each cylinder adds.
    """

    rpm: list[float]
    element: tuple[str, ...]
    by_cylinder: bool


@dataclass(frozen=True, kw_only=True)
class SolveOptions(ComputedOptions, FiringOptions, MotionOptions, SpectraOptions):
    """Options of ``jaxhb solve``."""

    rpm: float
    certify: bool
    gear: str | None


@dataclass(frozen=True, kw_only=True)
class SweepOptions(
    ComputedOptions, FiringOptions, MotionOptions, SpectraOptions, ParallelOptions
):
    """Options of ``jaxhb sweep``; ``over`` is the number of the scene that it goes over
    instead of the speed, and its values.
    """

    rpm: list[float]
    direction: Literal["up", "down", "both"] | None
    full: bool
    over: tuple[str, list[float] | list[str]] | None
    folder: str | None
    chunk: int


@dataclass(frozen=True, kw_only=True)
class TransientOptions(ComputedOptions, FiringOptions):
    """Options of ``jaxhb transient``; ``speed`` are rows of (s, rpm), ``rpm`` the only
    or, where it is ``free``, the first speed; ``link`` is that of the picture.
    """

    seconds: float
    speed: list[tuple[float, float]] | None
    rpm: float | None
    free: bool
    event: tuple[str, ...]
    start: Literal["steady", "rest"] | None
    passage: tuple[tuple[float, float], ...]
    record: float | None
    refine: int
    link: str | None


@dataclass(frozen=True, kw_only=True)
class ReportOptions(
    ComputedOptions, FiringOptions, MotionOptions, SpectraOptions, ParallelOptions
):
    """Options of ``jaxhb report``; ``transient`` are the rows of (s, rpm) of one,
    ``words`` the file of the phrases of a page.
    """

    rpm: list[float]
    at: float | None
    words: str | None
    transient: list[tuple[float, float]] | None
    event: tuple[str, ...]
    gear: str | None
    certify: bool
    tuned: str | None
    tolerances: bool
    tune: bool


@dataclass(frozen=True, kw_only=True)
class TuneOptions(ChangedOptions, ParallelOptions):
    """Options of ``jaxhb tune``; those that are None are as the [tune] table says."""

    rpm: list[float] | None
    optimizer: str | None
    robust: str | None
    steps: int | None
    starts: int | None
    seed: int | None
    tolerance: float | None


@dataclass(frozen=True, kw_only=True)
class ToleranceOptions(ComputedOptions, AccuracyOptions, ParallelOptions):
    """Options of ``jaxhb tolerance``."""

    rpm: list[float]
    of: tuple[str, ...]
    samples: int | None
    seed: int | None


@dataclass(frozen=True, kw_only=True)
class PhaseOptions(ComputedOptions):
    """Options of ``jaxhb phase``; ``name`` is the [[phase]] that is turned."""

    rpm: list[float]
    name: str | None
    of: tuple[str, ...]
    phases: int | None


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(ComputedOptions):
    """Options of ``jaxhb identify``; ``fit`` are numbers and their bounds, ``weak``
    asks for the weak cylinder instead.
    """

    measured: str
    fit: tuple[tuple[str, tuple[float, float]], ...]
    noise: float
    weak: bool


@dataclass(frozen=True, kw_only=True)
class OrdersOptions:
    """Options of ``jaxhb orders``: a file of a measured rotation, and what becomes of
    it.
    """

    recorded: str
    quiet: bool = False
    files: Mapping[str, str] = field(default_factory=dict)
    pulses: int | None
    revolutions: float
    orders: float
    cycles: int
    step: float
    mark: float
    element: str | None
    quantity: Literal["angle", "speed", "acceleration"]
