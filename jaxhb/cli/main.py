"""The command line: every command with its options and what its help says; what it
computes is in other modules.
"""

import os
import sys
import traceback
from collections.abc import Callable, Sequence

import click
from click.shell_completion import get_completion_class, shell_complete

from jaxhb import __version__
from jaxhb.cli import arguments as cli, options
from jaxhb.cli.options import Command, of_elements, of_scenes, option
from jaxhb.cli.streams import Ended, guarded, tell
from jaxhb.cli.values import (
    angle,
    bounded,
    count,
    frequency,
    one_speed,
    orders,
    positive,
    seconds,
    share,
    speed_pair,
    speed_range,
    speed_rows,
    speed_step,
    whole,
)
from jaxhb.elements.sentences import LONGEST_SENTENCE, cut
from jaxhb.report.files.output import INTERRUPTED
from jaxhb.train.speeds import read_range, read_speed, read_speeds

PROGRAM = "jaxhb"
VARIABLE = "_JAXHB_COMPLETE"
ENVIRONMENT = {
    # Its threads wait actively: beside a busy process a solve takes ten times as long
    "OPENBLAS_NUM_THREADS": "1",
    # The compiler warns of cached programs that come from the same machine
    "TF_CPP_MIN_LOG_LEVEL": "3",
}
"""Read when numpy and jax are imported, which only commands do; what the user has set
stays.
"""

DONE = (
    "Exit status: 0 done; 2 invalid input (nothing is written); 3 an error in the"
    " program."
)

LINEAR_STATUS = (
    "Exit status: 0 every speed has a result; 1 a speed has none (files are still "
    "written); 2 invalid input (nothing is\n"
    "written); 3 an error in the program."
)

FITTED = (
    "Exit status: 0 done; 1 no single cylinder explains the measurements, or too "
    "few speeds have a result; 2 invalid input\n"
    "(nothing is written); 3 an error in the program."
)

ANSWERED = (
    "Exit status: 0 every speed has a result: the kind of motion is known, and "
    "the harmonic solution of a periodic motion is\n"
    "within its limits (residual and truncation error); a motion"
    ' "not confirmed by harmonic balance" is known from recorded\n'
    "cycles and counts as a result, marked by a ?; 1 a speed has no result "
    "(files are still written); 2 invalid input\n"
    "(nothing is written); 3 an error in the program. "
)

BALANCED = (
    "A scene whose mean torques do not balance is invalid input (2). If --set "
    "unbalances a scene, it is reported as such (1)."
)

SEARCHED = ANSWERED + BALANCED
STATUS = (
    f"{ANSWERED}With --orbit: 0 converged at all speeds, 1 not converged; an unstable"
    f" orbit is reported. {BALANCED}"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line on words, by default those of the process; its exit status,
    as its help tells it.

    >>> main(["solve", "spur_pair", "--rpm", "2000"])  # doctest: +ELLIPSIS
    All teeth stay in contact at 2000 rpm.
    ...
    0
    """
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    return guarded(lambda: _run(sys.argv[1:] if argv is None else argv))


def _run(words: Sequence[str]) -> int:
    # Not click's own main: it would end the process on a closed pipe, and turn Ctrl-C
    # into another error.
    try:
        if VARIABLE in os.environ:
            return shell_complete(program, {}, PROGRAM, VARIABLE, os.environ[VARIABLE])
        with program.make_context(PROGRAM, list(words), obj=words) as context:
            return program.invoke(context)
    except click.exceptions.Exit as ended:  # of --help and --version
        return ended.exit_code
    except click.UsageError as fault:
        sentence = cut(fault.format_message(), LONGEST_SENTENCE)
        where = fault.ctx.command_path if fault.ctx else PROGRAM
        print(
            f"{where}: {sentence}{'' if sentence[-1] in '.?)' else '.'} See {where}"
            " --help",
            file=sys.stderr,
        )
        return 2
    except KeyboardInterrupt as stop:
        notes = getattr(stop, "__notes__", None)
        tell(f"stopped; {' '.join(notes) if notes else 'no further files are written'}")
        return stop.status if isinstance(stop, Ended) else INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and error.filename is None:
            if not _folder_is_there():
                tell(
                    "the folder in which jaxhb was started is not there any more. Go to"
                    " another one."
                )
                return 2
            # Of standard output: it has no name, and what has one is told by then
            raise
        if type(error).__name__ in ("SceneError", "OutputError", "CheckpointError"):
            tell(
                "\n".join(
                    cut(line, LONGEST_SENTENCE) for line in str(error).splitlines()
                )
            )
            return 2
        if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):
            tell(
                "there is not enough memory for this request. Request less at a time,"
                " or allow more memory."
            )
            return 3
        if type(error).__name__ == "NotConverged":
            print(error, file=sys.stderr)
            return 1
        traceback.print_exc()
        return 3


def _folder_is_there() -> bool:
    """Whether the working folder was not removed."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


class Commands(click.Group):
    """Commands in the order in which they are defined; the help ends with the examples
    of all.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Their names."""
        return list(self.commands)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Examples and exit status."""
        epilogs = [command.epilog or "" for command in self.commands.values()]
        examples = [
            line
            for epilog in epilogs
            for line in epilog.splitlines()
            if "  jaxhb " in line
        ]
        formatter.write("\n".join(["", "Examples:", *examples, ""]))
        super().format_epilog(ctx, formatter)


@click.group(
    cls=Commands,
    no_args_is_help=False,
    subcommand_metavar="COMMAND ...",
    epilog=STATUS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
@click.version_option(__version__, message="jaxhb %(version)s")
def program() -> None:
    """Forced torsional vibration of drive trains with gear backlash: do the teeth
    hammer, at which speeds, and how hard?

    For each speed jaxhb reports the motion after transients have decayed: teeth in
    contact, a periodic motion, a motion with a period of several cycles, or an
    irregular motion. Units: rpm, N m, kN and deg.
    """


def command(arguments: type | None, work: str, status: str, *examples: str) -> Callable:
    """Declare a command: the class of its options, the module that does its work, and
    the end of its help, which are examples and what its exit status tells.
    """
    lines = "".join(f"  jaxhb {example}\n" for example in examples)
    return program.command(
        cls=Command,
        arguments=arguments,
        work=work,
        epilog=f"\b\nExamples:\n{lines}\n{status}",
    )


@command(
    cli.CommonOptions,
    "inputs",
    DONE,
    "new my_engine.toml",
    "new --xlsx my_engine.xlsx",
)
@click.argument(
    "file",
    metavar="[FILE.toml]",
    type=click.Path(),
    required=False,
    help="the scene to write",
)
@options.file(
    "xlsx",
    "write the scene as a workbook with a sheet for each kind of element instead (needs"
    " jaxhb[spreadsheet])",
)
@options.QUIET
@option(
    "--from SCENE",
    "the scene to copy",
    to="scene",
    default="first_scene",
    show_default=True,
)
def new() -> None:
    """Write a small commented scene, or a copy of another.

    Comments explain every line; a workbook says of each cell what it may hold. A copy
    includes the CSV tables of the scene. Never overwrites a file.
    """


@command(None, "inputs", DONE, "scenes")
def scenes() -> None:
    """List the packaged scenes with descriptions."""


@command(
    cli.SceneOptions,
    "inputs",
    DONE,
    "scene six_cylinder_diesel --expand",
    "scene gear_train_30 --plot train.png",
)
@options.SCENE_ARGUMENT
@options.QUIET
@option("--expand", "write each [engine] as its individual cylinders")
@options.file(
    "out",
    "write the scene to this file, and its tables to the same folder (default: print"
    " it)",
)
@option(
    "--referred",
    "print inertias, stiffnesses and damping coefficients instead, actual and referred"
    " to the reference rotor",
)
@options.plot(
    "a sketch of the train instead of printing it: disks, shafts, gears in mesh,"
    " dampers, grounds"
)
def scene() -> None:
    """Check a scene and write it as TOML.

    Files are recognised by their extension: .xlsx is a workbook as jaxhb new --xlsx
    writes it, .json the TORS format of openTorsion, .csv has a table of inertias (name,
    inertia, radius, ...) and a table of links (from, to, stiffness, ...).
    """


@command(cli.CheckOptions, "linear_commands", LINEAR_STATUS, "check my_engine.toml")
@options.SCENE
@option(
    "--rpm A:B:COUNT",
    "speeds of the mean torques, rpm (default: the lowest and highest speed tabulated)",
    read_speeds,
)
@option(
    "--excitation CYLINDER",
    "print the tangential pressures of this cylinder by order, at the last speed, with"
    " and without injection",
    shell_complete=of_elements("cylinder"),
)
@option(
    "--loads L [L ...]",
    "loads of --excitation, shares of the mean effective pressure at full load"
    " (default: that at the speed)",
    positive,
)
@options.file("json", "write all results for programs, SI units")
@options.file(
    "csv",
    "write the rows of --excitation, which a tangential_pressure of a scene reads, Pa",
)
@options.file("xlsx")
def check() -> None:
    """Is the scene plausible? Mean torques, modes, notes.

    Reads a scene and reports mean torques and tooth forces, the numbers of every
    cylinder, the damping of every mesh, and natural frequencies with damping ratios.
    Notes name values that are allowed but implausible, such as a pressure in bar or a
    bore in mm. They are not errors; solve, sweep and report print them, too.
    """


@command(
    cli.ShapeOptions,
    "linear_commands",
    DONE,
    "modes six_cylinder_diesel",
    "modes six_cylinder_diesel --vector-sums --plot stars.png",
)
@options.SCENE
@options.MEAN_LOAD
@option(
    "--vector-sums",
    "print the vector sums of the firing angles too, by order, and weighted by the"
    " modes",
)
@options.file("json", "write frequencies and shapes for programs")
@options.file("csv", "write the vector sums for spreadsheets, one row per order")
@options.file("xlsx")
@options.plot(
    "shapes of the first six modes that strain links, with nodes and damping ratios;"
    " with --vector-sums, phase diagrams of the orders instead"
)
def modes() -> None:
    """Natural frequencies in Hz, undamped, and mode shapes."""


@command(
    cli.HolzerOptions, "linear_commands", DONE, "holzer six_cylinder_diesel --mode 1 2"
)
@options.SCENE
@options.MEAN_LOAD
@option(
    "--hz F [F ...]",
    "frequencies, Hz or with a unit, as 600rpm (default: the first three that strain"
    " links)",
    frequency,
)
@option("--mode K [K ...]", "modes, with the numbers of jaxhb modes", count)
@options.file("json", "write the tables in full precision, SI units")
@options.plot("the residual over the frequency")
def holzer() -> None:
    """Holzer's table of a train without loops.

    The table lists inertia, ordinate (relative amplitude), torque sum and twist from
    the free ends to the last disk, with the energies of disks and links in % of the
    kinetic energy. Undamped; teeth in contact, or as set by --at. At a natural
    frequency the residual is 0 except for rounding.
    """


@command(
    cli.CampbellOptions,
    "linear_commands",
    LINEAR_STATUS,
    "campbell six_cylinder_diesel --rpm 600:2600 --orders 3,4.5,6,9 --plot"
    " campbell.png",
)
@options.SCENE
@options.MEAN_LOAD
@option(
    "--rpm A:B[:COUNT]",
    "range of speeds, rpm; COUNT: number of speeds if frequencies depend on the speed",
    speed_range,
    required=True,
)
@option(
    "--orders N1,N2,...",
    "orders of the reference rotor (default: those whose torques exceed 0.1 % of the"
    " largest)",
    orders,
)
@option(
    "--modes N",
    "number of modes, the lowest of those that strain links",
    whole,
    default="6",
    show_default=True,
)
@options.EACH_MISFIRE
@options.file("json", "write frequencies and critical speeds in full precision")
@options.file("csv", "write one row per critical speed for spreadsheets")
@options.file("xlsx")
@options.plot("the Campbell diagram")
def campbell() -> None:
    """Natural frequencies and orders over the speed.

    The Campbell diagram: natural frequencies over the speed, orders of the excitation
    as rays, and the critical speeds where they intersect, order x rpm / 60 = Hz.
    Undamped; teeth in contact, or as set by --at; order-tuned absorbers follow the
    speed.
    """


@command(
    cli.ForcedOptions,
    "linear_commands",
    LINEAR_STATUS,
    'forced six_cylinder_diesel --rpm 1000:2600:65 --element "cyl6|flywheel" --plot'
    " orders.png",
)
@options.SCENE
@options.RPM
@option(
    "--element NAME",
    "list this disk, shaft, damper or mesh speed by speed; may be repeated (default:"
    " the largest values of all elements)",
    multiple=True,
    shell_complete=of_elements("disk", "shaft", "damper", "mesh"),
)
@option(
    "--by-cylinder",
    "what each cylinder adds to the main orders of every --element, at the speed of its"
    " largest vibration",
)
@options.EACH_MISFIRE
@options.files("orders and synthesis of up to four elements over the speed")
def forced() -> None:
    """Linear response over the speed: amplitudes by order, heat.

    With all teeth in contact, for every disk (deg), shaft and damper (N m) and mesh
    (kN): amplitude of every order, half peak-to-peak of the synthesis, sum of
    amplitudes and dissipated power. Without --element, the largest values over the
    speeds. Links may depend on frequency and amplitude.
    """


@command(
    cli.SolveOptions,
    "commands",
    STATUS,
    "solve gear_train_30 --rpm 1800 --plot cycle.png",
    'solve gear_train_30 --rpm 1800 --misfire "cylinder A1" --set "crank'
    ' damper.damping=300" --json result.json',
)
@options.SCENE
@option("--rpm R", "speed of the reference rotor, rpm", one_speed, required=True)
@options.misfire()
@options.MOTION
@options.certify()
@options.files("the gear torque and the tooth forces over the cycle")
@options.file("trace")
@options.GEAR
def solve() -> None:
    """One speed: do the teeth hammer? Forces, torques, contact.

    With and without backlash: the kind of motion, which teeth separate and for how
    long, tooth forces (kN), torques of gears and shafts (N m). For a motion that never
    repeats, the results are extremes over recorded cycles, with the 5th, 50th and 95th
    percentiles of the largest tooth force of a cycle.
    """


@command(
    cli.SweepOptions,
    "commands",
    STATUS,
    "sweep gear_train_30 --rpm 600:2450:20 --csv sweep.csv --plot sweep.png",
)
@options.SCENE
@options.RPM
@options.misfire()
@options.MOTION
@options.PARALLEL
@option(
    "--direction {up,down,both}",
    "neighbour from which a speed starts: the next lower (up, default), the next higher"
    " (down), or both in turn",
    ("up", "down", "both"),
)
@options.files("tooth force and separated time over the speed")
@option(
    "--full",
    "write amplitudes of all orders (default: none in the JSON, the excited orders in"
    " the NetCDF file)",
)
@option(
    "--over NAME.FIELD=A:B:COUNT",
    "sweep a parameter of the scene at the single speed of --rpm: COUNT equally spaced"
    " values from A to B, or V1,V2,..., SI units",
    read_range,
)
@option(
    "--out DIR",
    "keep stored results in this folder permanently (default: until the sweep is done)",
    to="folder",
)
@option(
    "--chunk N",
    "speeds that are computed and stored together (default 16): with fewer, less is"
    " lost on interruption, but the sweep takes longer",
    whole,
    default="16",  # a batch of marches
)
def sweep() -> None:
    """Many speeds in one call: at which do the teeth hammer?

    Kind of motion, largest tooth force and separated time over the speed. Where several
    motions are possible, the train stays in the motion from which it comes: each speed
    starts from the next lower speed (--direction up), the next higher speed (down), or
    from both in turn.
    """


@command(
    cli.TransientOptions,
    "commands",
    DONE,
    "transient spur_pair --seconds 4 --speed 0:1000,4:6000 --plot run_up.png",
    'transient my_engine.toml --seconds 3 --rpm 1500 --event "load step" --json'
    " step.json",
)
@options.SCENE
@option("--seconds T", "duration, s or with a unit, as 2min", seconds, required=True)
@option(
    "--speed S:RPM,...",
    "speed of the reference rotor over time, rows of s and rpm: linear between them,"
    " the last one stays; units stand behind the last row, as 0:4,2min:9Hz",
    speed_rows,
)
@option("--rpm R", "constant speed, rpm; with --free: the first speed", one_speed)
@option(
    "--free",
    "let the torques of the excitation, of loads by their laws and of events drive the"
    " train from --rpm on",
)
@option(
    "--event NAME",
    "an [[event]] or a [sequence.NAME] of the scene; may be repeated",
    multiple=True,
    shell_complete=of_elements("event"),
)
@option(
    "--start {steady,rest}",
    "motion at 0 s: the steady motion at the first speed (default, unless that is 0"
    " rpm), or no vibration",
    ("steady", "rest"),
)
@option(
    "--passage LOW:HIGH",
    "tell the seconds between these speeds, rpm or with a unit, as 4:7Hz; may be"
    " repeated (barred ranges are found anyway)",
    speed_pair,
    multiple=True,
)
@options.misfire()
@option(
    "--record N",
    "instants to keep in a second, at least (default: every time step)",
    positive,
)
@option(
    "--refine N",
    "divide every time step by this number, to check the results",
    whole,
    default="1",
    show_default=True,
)
@options.file("json", "write peaks and trouble in full precision, SI units")
@options.file("csv", "write torques and tooth forces over time, SI units")
@options.file("xlsx")
@options.file(
    "netcdf", "write all signals over time as labelled arrays (needs jaxhb[data])"
)
@options.plot(
    "one torque and the speed over time, beside the steady motion, and its orders"
)
@option(
    "--link NAME",
    "shaft, damper or mesh of the picture (default: the shaft nearest to its limit)",
    shell_complete=of_elements("shaft", "damper", "mesh"),
)
def transient() -> None:
    """Run-ups, run-downs and events: peaks over time.

    Largest torques and tooth forces with their time and speed, separation and impacts
    of teeth, stresses beside the transient limit, seconds in barred ranges, and damage
    where a shaft has an sn_curve: see docs/how_to/transients.md.
    """


@command(
    cli.ReportOptions,
    "page_command",
    STATUS,
    'report gear_train_30 --rpm 600,1200,1800,2450 --misfire "cylinder A1" --plot'
    " crank_gear.png",
    'report gear_train_30 --rpm 700:2450:8 --misfire "cylinder A1" --html report.html',
)
@options.SCENE
@options.RPM
@options.EACH_MISFIRE
@options.MOTION
@options.PARALLEL
@options.files("the torque on one gear over the cycle, in normal running")
@options.GEAR
@option(
    "--at R",
    "speed that the picture and the page show in full, rpm (default: that of the"
    " largest tooth force)",
    read_speed,
)
@options.certify(", at the speed of --at")
@options.file("html")
@options.file("pdf")
@options.file("phrases")
@option(
    "--words FILE.toml",
    'other words on the page: a table "English" = "other" of phrases, as --phrases'
    " lists them",
)
@option(
    "--tuned SCENE",
    "add another design to the page, as jaxhb tune writes it",
    shell_complete=of_scenes,
)
@option(
    "--transient S:RPM,...",
    "add a transient to the page, as --speed of jaxhb transient gives it, up to the"
    " last row",
    speed_rows,
)
@option(
    "--event NAME",
    "an [[event]] or a [sequence.NAME] of that transient; may be repeated",
    multiple=True,
    shell_complete=of_elements("event"),
)
@option(
    "--tolerances",
    "add the worst case within the [tolerance] table of the scene to the page; takes"
    " minutes",
)
@option(
    "--tune",
    "add the design tuned as the [tune] table of the scene specifies to the page; takes"
    " minutes",
)
def report() -> None:
    """Several speeds, in normal running and with a misfire.

    With and without backlash, in normal running and with a misfiring cylinder, or with
    every cylinder in turn (--misfire each). The plot shows the torque on one gear over
    the cycle; times of separated teeth are shaded. --html writes a page to print and
    sign: the train and its data, natural frequencies, forced response by orders, the
    motion at every speed, limits, accuracy, notes.
    """


@command(
    cli.TuneOptions, "commands", SEARCHED, "tune engine_with_damper --plot tuned.png"
)
@options.SCENE_OF_TUNING
@option(
    "--rpm A:B:COUNT",
    "speeds instead of those of the [tune] table, rpm: A:B:COUNT or R1,R2,...",
    read_speeds,
)
@option("--optimizer {lbfgs,adam}", "default: lbfgs", ("lbfgs", "adam"))
@option(
    "--robust {worst,p95}",
    "minimise the response of the worst train within the [tolerance] table, or the"
    " value below which 95 of 100 trains stay",
    ("worst", "p95"),
)
@option("--steps N", "maximum number of steps", whole)
@option(
    "--starts N", "number of designs tuned together: the scene and random ones", whole
)
@options.PARALLEL
@option("--seed N", "seed of the random designs (default 0)", count)
@option("--tolerance T", "as in solve (default 0.01)", share)
@options.file("output", "the tuned scene (default: SCENE_tuned.toml here)")
@options.file("json", "parameters, results, history (default: as --output, .json)")
@options.plot("the response before and after tuning, and the history")
def tune() -> None:
    """Find the best dampers (or other parameters) by gradient.

    Changes parameters of a scene within bounds to minimise a response over a range of
    speeds. The [tune] table of the scene states what changes and what is minimised: see
    docs/how_to/tune.md. Every step writes the tuned scene and the history, so Ctrl-C
    leaves the best design so far; the exit status is then 130.
    """


@command(
    cli.ToleranceOptions,
    "many_trains",
    SEARCHED,
    "tolerance my_engine.toml --rpm 800:2400:17 --samples 200 --plot tolerance.png",
    'tolerance my_engine.toml --rpm 1800 --of "tooth force of crank gear|idler" --csv'
    " worst.csv",
)
@options.SCENE
@options.RPM
@option(
    '--of "QUANTITY of ELEMENT"',
    'quantity to evaluate, e.g. "shaft torque of cyl6|flywheel"; may be repeated'
    " (default: the largest tooth force, torque, heat of a damper and stress relative"
    " to its limit)",
    multiple=True,
)
@option(
    "--samples N",
    "number of random trains, for the 5th, 50th and 95th percentiles (default: none)",
    count,
)
@option("--seed N", "seed of the sample and of the search (default 0)", count)
@option(
    "--harmonics N", "fixed number of harmonics (default: as many as needed)", whole
)
@options.PARALLEL
@option("--tolerance T", "as in solve", share, default="0.01", show_default=True)
@options.files(
    "the nominal train, the worst case and the sample over the speed", spectra=False
)
def tolerance() -> None:
    """The worst case of tolerances and wear, and its causes.

    The [tolerance] table of the scene states how far parameters may deviate from their
    values; a worn train is a [scenario.NAME] (--scenario). At each speed a gradient
    search finds the largest force, torque and heat within the tolerances, and the
    motion in that case is reported: see docs/how_to/tolerances.md.
    """


@command(
    cli.PhaseOptions,
    "many_trains",
    LINEAR_STATUS,
    'phase two_engines.toml --rpm 200:700:51 --of "shaft torque of line" --csv'
    " phases.csv",
)
@options.SCENE
@options.RPM
@option("--phase NAME", "the [[phase]] to vary (default: the only one)", to="name")
@option(
    '--of "QUANTITY of ELEMENT"',
    'quantity to evaluate, e.g. "shaft torque of line"; may be repeated (default: every'
    " tooth force and shaft torque)",
    multiple=True,
)
@option(
    "--phases N",
    "number of phases of the scan (default: 24; per harmonic 16 without backlash, 4"
    " where teeth stay in contact at every speed and phase)",
    whole,
)
@options.file("json")
@options.file("csv", "write one row per speed and quantity for spreadsheets, SI units")
@options.file("xlsx")
def phase() -> None:
    """Two engines on one gear: the worst phase angle between them.

    A [[phase]] of the scene delays the whole excitation of one engine. Without
    backlash its worst angle is found exactly over the full circle, where teeth part by
    marching at many angles: see docs/how_to/strength.md.
    """


@command(
    cli.IdentifyOptions,
    "identify_command",
    FITTED,
    'identify my_engine.toml measured.csv --fit "cyl6|flywheel.stiffness=1e6:4e6"'
    " --output fitted.toml",
    "identify my_engine.toml measured.csv --weak-cylinder",
)
@options.SCENE
@click.argument(
    "measured", metavar="MEASURED.csv", type=click.Path(), help="the measured orders"
)
@option(
    "--fit NAME.FIELD=LOW:HIGH",
    "a parameter to fit and its bounds, SI units; may be repeated (default: those of"
    " the [tolerance] table)",
    bounded,
    multiple=True,
)
@option(
    "--noise T",
    "relative standard deviation of measured amplitudes",
    share,
    default="0.03",
    show_default=True,
)
@option(
    "--weak-cylinder",
    "find the cylinder that burns less than the others instead",
    to="weak",
)
@options.file(
    "output",
    "write the scene with the fitted parameters and their [tolerance] table",
)
@options.file("json")
@options.plot("measured and computed values over the speed")
def identify() -> None:
    """Which stiffness, damping or cylinder explains a measurement?

    Fits parameters of a scene to measured orders of torque, angle, speed or
    acceleration (columns rpm, order, element, quantity, amplitude, phase), with teeth
    in contact, and states how well the data determine them: see
    docs/how_to/measurements.md.
    """


@command(
    cli.OrdersOptions,
    "identify_command",
    DONE,
    "orders run_up.csv --pulses 60 --element flywheel --csv orders.csv --plot"
    " orders.png",
)
@click.argument(
    "recorded",
    metavar="RECORDED.csv",
    type=click.Path(),
    help="time (s), and angle (deg) or speed (rpm), or times of pulses alone; mark",
)
@options.QUIET
@option("--pulses N", "times are those of N pulses in a revolution", whole)
@option(
    "--revolutions N",
    "revolutions in a cycle: 2 of a four-stroke engine, else 1",
    positive,
    default="2",
    show_default=True,
)
@option("--orders M", "highest order", positive, default="12", show_default=True)
@option(
    "--cycles N",
    "cycles in a block, of which all orders are found together",
    whole,
    default="10",
    show_default=True,
)
@option(
    "--step RPM",
    "average blocks whose speeds lie in a window of this width, rpm or with a unit",
    speed_step,
    default="10",
    show_default=True,
)
@option(
    "--mark DEG",
    "angle of the cycle at the mark, 0 at firing top dead centre, deg or with a unit",
    angle,
    default="0",
    show_default=True,
)
@option("--element NAME", "the disk that was measured, for the files")
@option(
    "--quantity {angle,speed,acceleration}",
    "what tables, files and pictures show (default: angle)",
    ("angle", "speed", "acceleration"),
    default="angle",
)
@options.file("json")
@options.file("csv", "write the amplitudes as jaxhb identify reads them")
@options.file("xlsx")
@options.plot("the largest orders over the speed")
def orders_command() -> None:
    """Orders of a measured rotation over the speed.

    Reads a torsiograph, an encoder or the pulses of a wheel, and gives amplitude and
    phase of every order: see docs/how_to/measurements.md.
    """


@command(
    cli.CampaignOptions,
    "many_trains",
    "Exit status: 0 every case has an answer; 1 some have none; 2 invalid input; 3 an"
    " error in the program.",
    "campaign dampers.toml --workers 8",
)
@click.argument(
    "study",
    metavar="STUDY.toml",
    type=click.Path(),
    help="scenes, speeds, changes and what to keep",
)
@options.QUIET
@options.PARALLEL
@option(
    "--out DIR",
    "write the rows to this folder (default: the name of the study, here)",
    to="folder",
)
@options.file("json", "write the summary for programs")
def campaign() -> None:
    """Very many trains and speeds: rows of a folder.

    Computes all combinations of scenes, scenarios, misfires, changes and samples at all
    speeds. Rows can be read while they are computed; stopped or killed, the same
    command goes on: see docs/how_to/campaigns.md.
    """


SHELLS = ("bash", "zsh", "fish", "powershell")


@program.command(epilog=DONE)
@click.argument(
    "shell",
    default="bash",
    metavar="[SHELL]",
    type=click.Choice(SHELLS),
    help=", ".join(SHELLS),
)
def completion(shell: str) -> int:
    """Print shell code that completes commands and names.

    In ~/.bashrc: eval "$(jaxhb completion bash)"; for fish: jaxhb completion fish |
    source.
    """
    completer = get_completion_class(shell)
    assert completer is not None  # every one of SHELLS has one
    click.echo(completer(program, {}, PROGRAM, VARIABLE).source(), nl=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
