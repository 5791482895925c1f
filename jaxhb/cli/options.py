"""Options: how one is declared and completed, those that several commands take, and
what of them is beyond click.
"""

import contextlib
import dataclasses
import gc
import importlib
import importlib.util
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from functools import reduce
from typing import Any

import click
from click.shell_completion import BashComplete, CompletionItem, add_completion_class

from jaxhb.cli import arguments as cli
from jaxhb.cli.values import frequency, place, positive, setting, share, units, whole
from jaxhb.report.files.formats import FORMATS, OF_NUMBERS
from jaxhb.report.files.output import OutputError
from jaxhb.train.speeds import read_speed, read_speeds


@add_completion_class
class QuotingBash(BashComplete):
    """Names such as ``cylinder A1``: where no quote was typed, what bash would split
    stands after backslashes.
    """

    def format_completion(self, item: CompletionItem) -> str:
        """One line; bash takes one backslash away when it reads it."""
        words = os.environ["COMP_WORDS"].split("\n")[int(os.environ["COMP_CWORD"]) :]
        value = item.value
        if not (words and words[0].startswith(("'", '"'))):
            value = re.sub(r"([^\w./~@%+:=,-])", r"\\\1", value)
        return f"{item.type},{value}".replace("\\", "\\\\")


def of_scenes(
    context: click.Context, parameter: click.Parameter, begun: str
) -> list[CompletionItem]:
    """Packaged scenes that a word may become, and files where it becomes none."""
    from jaxhb.scene.files import scene_names

    names = [CompletionItem(name) for name in scene_names() if name.startswith(begun)]
    return [CompletionItem(begun, type="file"), *names]


def of_elements(*tables: str) -> Callable:
    """Propose the names of elements of these tables of the scene of the line."""

    def names(
        context: click.Context, parameter: click.Parameter, begun: str
    ) -> list[str]:
        from jaxhb.elements.sentences import SceneError
        from jaxhb.scene.files import load_scene

        try:
            elements = load_scene(context.params["scene"]).topology.elements
        except (SceneError, OSError, TypeError):
            # There is none on the line, or none that can be read.
            return []
        return [
            name
            for name, (table, _) in elements.items()
            if table in tables and name.startswith(begun)
        ]

    return names


CONSTANT_LINKS_BY_THEMSELVES = ("check", "modes", "holzer", "campbell")
"""Commands that see to --links-at themselves, at speeds of their own."""

SPEEDS = ("--rpm", "--speed", "--speeds")
NO_SPEED = (
    "Natural frequencies do not depend on the speed; --at R takes the teeth as under"
    " the mean load of R rpm."
)
EXCLUDING = (("hz", "mode"), ("tuned", "tune"), ("speed", "rpm"), ("speed", "free"))
"""Options of which a command takes one."""

# Ends how an option is spelled that takes one or more values: ``--mode K [K ...]``
MORE = " ...]"


class Command(click.Command):
    """A command that takes no option for a value, reads ``--mode 1 2``, and knows under
    which words a speed may stand.

    ``work`` is the module of this folder that has the function of its name, imported
    when it runs; ``arguments`` the class of :mod:`jaxhb.cli.arguments` that holds its
    options.
    """

    def __init__(self, name: str, *, work: str, arguments: type | None, **options: Any):
        super().__init__(name, **options)
        self.function_name = name
        self.work = work
        self.arguments = arguments

    def invoke(self, ctx: click.Context) -> int:
        """Run the function of the command; its exit status."""
        from jaxhb.cli import inputs

        for first, second in EXCLUDING:
            if ctx.params.get(first) and ctx.params.get(second):
                raise click.UsageError(
                    f"--{first} and --{second} exclude each other.", ctx
                )
        if self.arguments is None:
            return getattr(inputs, self.function_name)()
        files = {name: ctx.params[name] for name in FORMATS if ctx.params.get(name)}
        options = {
            name: value for name, value in ctx.params.items() if name not in FORMATS
        }
        arguments = self.arguments(**options, files=files)
        if not isinstance(arguments, cli.ParallelOptions):
            return self._run(arguments)
        with _executor_of(arguments) as executor:
            return self._run(dataclasses.replace(arguments, executor=executor))

    def _run(self, arguments: Any) -> int:
        """Run the function of the command with its options."""
        from jaxhb.cli import inputs, operating_modes

        if isinstance(arguments, cli.CampaignOptions | cli.OrdersOptions):
            inputs.check_files(arguments)
            return self._function()(arguments)
        if not isinstance(arguments, cli.ChangedOptions):
            return getattr(inputs, self.function_name)(arguments)
        scenarios = operating_modes.modes(arguments)
        constant_links = self.name not in CONSTANT_LINKS_BY_THEMSELVES
        train = None
        if len(scenarios) == 1:
            if isinstance(arguments, cli.ComputedOptions):
                (scenario,) = scenarios.values()
                arguments = dataclasses.replace(arguments, scenario=scenario)
            if isinstance(arguments, cli.TuneOptions):
                arguments = inputs.checked_tuning(arguments)
            else:
                inputs.check_files(arguments)
            # It takes a fraction of the time of importing jax.
            train = inputs.read(arguments, constant_links)
        function = self._function()
        from jaxhb.cli.resume import as_one
        from jaxhb.report.units import shown_in

        shown = inputs.shown_units(arguments, train)
        if train is not None:
            with shown_in(shown):
                return function(train, arguments)
        with as_one(), shown_in(shown):
            return operating_modes.each(
                function,
                arguments,
                scenarios,
                lambda one_mode: inputs.read(one_mode, constant_links),
            )

    def _function(self) -> Callable[..., int]:
        """The function of the command, ready to compute."""
        _prepare_to_compute()
        module = importlib.import_module(f"jaxhb.cli.{self.work}")
        return getattr(module, self.function_name)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does, but for what the class says; every fault knows its
        command.
        """
        valued = {
            name: parameter
            for parameter in self.params
            if isinstance(parameter, click.Option) and not parameter.is_flag
            for name in parameter.opts
        }
        if ctx.resilient_parsing and args and args[-1] in valued:
            # Its value is being completed, by the scene, of which click would not know.
            args = args[:-1]
        try:
            return super().parse_args(ctx, _spread(args, valued, ctx))
        except click.UsageError as fault:
            fault.ctx = fault.ctx or ctx
            if isinstance(fault, click.NoSuchOption) and fault.option_name in SPEEDS:
                advice = NO_SPEED if "--at" in valued else ""
                if "--rpm" in valued:
                    advice = "Did you mean '--rpm'?"
                if advice:
                    message = f"{fault.message} {advice}"
                    raise click.NoSuchOption(
                        fault.option_name, message, ctx=fault.ctx
                    ) from None
            raise


def _spread(
    args: Sequence[str], valued: dict[str, click.Option], ctx: click.Context
) -> list[str]:
    """Words as click takes them: ``--mode 1 2`` becomes ``--mode 1 --mode 2``; an
    option without its value is a fault.
    """
    words: list[str] = []
    several = None
    for word in args:
        if word.startswith("--"):
            if words and words[-1] in valued and not ctx.resilient_parsing:
                raise click.BadOptionUsage(
                    words[-1], f"Option {words[-1]!r} requires an argument."
                )
            metavar = valued[word].metavar if word in valued else None
            several = word if metavar and metavar.endswith(MORE) else None
        elif several and words[-1] != several:
            words.append(several)
        words.append(word)
    return words


def _prepare_to_compute() -> None:
    """Refuse where memory is too little, and set what must be set before jax is
    imported.
    """
    from jaxhb._jax import too_little_memory

    refusal = too_little_memory()
    if refusal:
        raise OutputError(refusal)
    from jaxhb._program import keep_programs
    from jaxhb._store import user_folder

    keep_programs(user_folder())
    # With Python's 700 or so new objects between collections these take a third of the
    # time of tracing.
    gc.set_threshold(50_000)


@contextlib.contextmanager
def _executor_of(arguments: cli.ParallelOptions) -> Iterator[Executor | None]:
    """The executor that a command is given, None for this process; its workers end with
    the block.
    """
    from jaxhb._executors import Cluster, Workers

    if arguments.workers and arguments.scheduler:
        raise OutputError("--workers and --scheduler exclude each other.")
    if arguments.scheduler:
        if importlib.util.find_spec("distributed") is None:
            raise OutputError(
                '--scheduler: it needs distributed. Install it: pip install "jaxhb'
                '[cluster]".'
            )
        cluster = Cluster(arguments.scheduler)
        with cluster:
            try:
                dashboard = cluster.connect()
            except OSError as error:
                raise OutputError(
                    f"--scheduler: no scheduler answers at {arguments.scheduler!r}:"
                    f" {error}."
                ) from None
            if not arguments.quiet:
                print(f"The scheduler shows its work at {dashboard}", file=sys.stderr)
            yield cluster
    elif arguments.workers:
        with Workers(arguments.workers) as workers:
            yield workers
    else:
        yield None


def _reader(read: Callable[[str], Any]) -> Callable[[str], Any]:
    """A type of click from a function of a word, whose ValueError says what is
    wrong.
    """

    def value(word: str) -> Any:
        try:
            return read(word)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None

    return value


def option(
    spelled: str,
    text: str,
    read: Callable[[str], Any] | Sequence[str] | None = None,
    *,
    to: str | None = None,
    **more: Any,
) -> Callable:
    """An option as its help spells it, ``--rpm A:B:COUNT``, without a second word a
    switch; named ``to`` in Python.

    ``read`` is a function of the word or a sequence of words to choose from; ``more``
    goes to click. Where they name files the shell completes them.
    """
    name, _, metavar = spelled.partition(" ")
    if metavar.startswith(("FILE", "DIR")):
        more["type"] = click.Path()
    elif callable(read):
        more["type"] = _reader(read)
    elif read is not None:
        more["type"] = click.Choice(read)
    if metavar:
        more["metavar"] = metavar
    else:
        more["is_flag"] = True
    if metavar.endswith(MORE):
        more["multiple"] = True
    names = (name,) if to is None else (name, to)
    return click.option(*names, help=text, **more)


def together(*options: Callable) -> Callable:
    """One decorator of several options, shown in this order."""
    return lambda function: reduce(
        lambda decorated, option: option(decorated), reversed(options), function
    )


SCENE_ARGUMENT = click.argument(
    "scene",
    metavar="SCENE",
    help="a packaged scene (jaxhb scenes) or the path of a file",
    shell_complete=of_scenes,
)
QUIET = option("--quiet", "print errors only; use files and the exit status")
SET = option(
    "--set NAME.FIELD=VALUE",
    'change a value of the scene, SI units or with a unit: "crank damper.damping=300",'
    ' "coupling.stiffness=36 kN m/rad", "idler.teeth=40"; may be repeated',
    setting,
    multiple=True,
)
UNITS = option(
    "--units QUANTITY=UNIT,...",
    'show quantities in these units: "torque=kN m,angle=mrad,speed=Hz" (default: those'
    " of [report] in the scene); JSON, CSV and NetCDF files stay in SI units",
    units,
)
SCENE_OF_TUNING = together(SCENE_ARGUMENT, QUIET, SET, UNITS)
SCENE = together(
    SCENE_OF_TUNING,
    option(
        "--scenario NAME",
        "apply the changes of [scenario.NAME] of the scene; may be repeated; all:"
        " every scenario in turn, with the worst one for each quantity",
        to="scenarios",
        multiple=True,
    ),
    option(
        "--rules NAME|FILE",
        "judge by this rule before those of the scene: a name, or a .toml with a rule"
        " of yours (docs/how_to/strength.md); may be repeated",
        multiple=True,
    ),
    option(
        "--links-at hz=VALUE",
        "make variable links constant, with their values at this frequency (hz),"
        " amplitude (rad) or speed (rpm), which may have another unit, as rpm=25Hz",
        place,
        multiple=True,
    ),
    option(
        "--viscous HZ",
        "turn loss factors into viscous damping that dissipates the same power at this"
        " frequency, Hz or with a unit, as 600rpm",
        frequency,
    ),
)
"""The scene and what is changed in it; of a tuning without what the tuned scene could
not hold.
"""

RPM = option(
    "--rpm A:B:COUNT",
    "speeds of the reference rotor, rpm: COUNT equally spaced speeds from A to B, or a"
    " list R1,R2,...",
    read_speeds,
    required=True,
)
MEAN_LOAD = option(
    "--at R",
    "use the tooth stiffness under the mean load of this speed, rpm (default: teeth in"
    " contact)",
    read_speed,
)
MOTION = together(
    option(
        "--harmonics N", "fixed number of harmonics (default: as many as needed)", whole
    ),
    option(
        "--tolerance T",
        "largest truncation error, relative to the largest tooth force",
        share,
        default="0.01",
        show_default=True,
    ),
    option(
        "--orbit",
        "compute a periodic solution, stable or not (a note says which), instead of"
        " what the train does",
    ),
)
"""Which motion is asked for, and how exactly."""

GEAR = option(
    "--gear NAME",
    "gear of the picture (default: of the reference rotor)",
    shell_complete=of_elements("disk"),
)


def misfire(more: str = "") -> Callable:
    """Cylinders that do not fire, and that are cut off."""
    cylinders = of_elements("cylinder")
    return together(
        option(
            "--misfire CYLINDER",
            "this cylinder does not fire: no injection, compression remains (as"
            f" classification rules require); may be repeated{more}",
            multiple=True,
            shell_complete=cylinders,
        ),
        option(
            "--cut-off CYLINDER",
            "this cylinder has no gas torque at all, neither from combustion nor from"
            f" compression; may be repeated{more}",
            multiple=True,
            shell_complete=cylinders,
        ),
    )


EACH_MISFIRE = misfire("; each: every cylinder in turn, and the worst one")


PARALLEL = together(
    option(
        "--workers N",
        "compute in N processes of this machine, one processor each (default: in this"
        " process)",
        whole,
    ),
    option(
        "--scheduler ADDRESS",
        "compute on the workers of this Dask scheduler, as tcp://10.0.0.5:8786 (needs"
        " jaxhb[cluster])",
    ),
)
"""Where independent parts are computed."""


def certify(where: str = "") -> Callable:
    """A computed bound."""
    return option(
        "--certify",
        f"compute a bound on the error of the tooth forces{where}: in double precision,"
        " no proof; takes half a minute",
    )


def file(name: str, text: str = "") -> Callable:
    """A file of the format of this name, ``text`` where a command says more of it."""
    form = FORMATS[name]
    return option(form.spelled, text or form.text)


def plot(picture: str) -> Callable:
    """A picture."""
    return file("plot", FORMATS["plot"].text.format(picture))


ORDERS = option(
    "--orders M",
    "list amplitudes in files up to this order (default: all; for a sweep none)",
    positive,
)


def files(picture: str, *, spectra: bool = True) -> Callable:
    """Files of numbers, where ``spectra`` are among them with an option of their own,
    and a picture.
    """
    record, *tables = (
        file(name) for name, form in FORMATS.items() if form.content in OF_NUMBERS
    )
    return together(record, *[ORDERS] * spectra, plot(picture), *tables)
