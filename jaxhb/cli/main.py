"""The command line: ``jaxhb scenes | scene | modes | solve | ...``; commands import the heavy modules."""

# PYTHON_ARGCOMPLETE_OK
import argparse
import gc
import importlib
import os
import sys
import traceback

from jaxhb import __version__
from jaxhb.cli.help_texts import (
    CAMPBELL,
    CHECK,
    COMPLETION,
    DESCRIPTION,
    FORCED,
    HOLZER,
    NEW,
    REPORT,
    SCENE,
    SOLVE,
    SWEEP,
    TUNE,
    below,
)
from jaxhb.cli.options import (
    add_accuracy,
    add_certify,
    add_files,
    add_gear,
    add_mean_load,
    add_misfire,
    add_netcdf,
    add_orbit,
    add_plot,
    add_scene,
    add_speeds,
    add_table,
    count,
    one_speed,
    orders,
    over,
    positive,
    share,
    speed,
    speed_range,
    speeds,
    whole,
)
from jaxhb.cli.parsing import SHELLS, Parser, complete, completion, of_elements, of_scenes
from jaxhb.cli.streams import Ended, guarded, tell
from jaxhb.report.files.output import INTERRUPTED

ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",  # its threads wait actively: beside a busy process a solve takes ten times as long
    "TF_CPP_MIN_LOG_LEVEL": "3",  # the compiler warns of cached programs that come from the same machine
}
"""Read when numpy and jax are imported, which only commands do; what the user has set stays."""

NEW_OBJECTS = 50_000
"""Objects between collections of garbage: with Python's 700 or so they take a third of the time of tracing."""

EACH_MISFIRE = "; each: every cylinder in turn, and which is the worst"


def main(argv=None):
    """Run the command line.

    Parameters
    ----------
    argv : list of str, optional
        Default: the arguments of the process.

    Returns
    -------
    int
        0 answered, 1 a speed without an answer, 2 bad input or an output that cannot be written, 3 an error of the
        program (its traceback is shown), 130 stopped by the user, 141 the reader of the output closed it, 143
        terminated.

    Examples
    --------
    >>> main(["solve", "spur_pair", "--rpm", "2000"])  # doctest: +ELLIPSIS
    All teeth stay in contact at 2000 rpm.
    ...
    0
    """
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    return guarded(lambda: _run(argv))


def _run(argv):
    try:
        understood = parser()
        complete(understood)
        arguments = understood.parse_args(argv)
        arguments.words = sys.argv[1:] if argv is None else argv
        return arguments.command(arguments)
    except SystemExit as stop:
        return stop.code
    except KeyboardInterrupt as stop:
        notes = getattr(stop, "__notes__", None)
        tell(f"stopped; {' '.join(notes) if notes else 'nothing more is written'}")
        return stop.status if isinstance(stop, Ended) else INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and error.filename is None:
            raise  # of standard output: it has no name, and what has one is told by then
        if type(error).__name__ in ("SceneError", "OutputError", "CheckpointError"):
            print(error, file=sys.stderr)
            return 2
        traceback.print_exc()
        return 3


def parser():
    """The argument parser."""
    raw = argparse.RawDescriptionHelpFormatter
    top = Parser("jaxhb", description=DESCRIPTION, epilog=below(), formatter_class=raw, allow_abbrev=False)
    top.add_argument("--version", action="version", version=f"jaxhb {__version__}")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def add(name, command, short, text=""):
        text = {"help": short, "description": text or short, "epilog": below(name)}
        made = commands.add_parser(name, **text, formatter_class=raw, allow_abbrev=False)
        made.set_defaults(command=command)
        if command not in (run_scenes, completion):
            text = "print nothing but what is wrong: for files and the exit status"
            made.add_argument("--quiet", action="store_true", help=text)
        return made

    for group in (_scene_commands, _linear_commands, _speed_commands, _report_commands, _tune_commands):
        group(add)
    return top


def _scene_commands(add):
    new = add("new", run_new, "write a small commented scene to begin with, or a copy of another", NEW)
    new.add_argument("file", metavar="FILE.toml", help="the scene to write")
    text = "the scene to copy: packaged (jaxhb scenes) or the path of a file (default: first_scene)"
    new.add_argument("--from", dest="scene", default="first_scene", metavar="SCENE", help=text)
    add("scenes", run_scenes, "the packaged scenes and what they are")
    scene = add("scene", run_scene, "check a scene and write it as TOML, from files of other programs too", SCENE)
    text = "a packaged scene, or the path of a .toml, .json or .csv"
    scene.add_argument("scene", metavar="SCENE", help=text).completer = of_scenes
    scene.add_argument("--expand", action="store_true", help="write the cylinders that an [engine] makes")
    scene.add_argument("--out", metavar="FILE.toml", help="write it there, its tables beside it (default: print it)")
    text = "print inertias, stiffnesses and dampings instead, actual and referred to the reference rotor"
    scene.add_argument("--referred", action="store_true", help=text)
    add_plot(scene, "a sketch of the train instead of printing it: disks, shafts, gears in mesh, dampers, grounds")


def _linear_commands(add):
    check = add("check", _runner("check", "linear_commands"), "is the scene plausible? torques, modes, notes", CHECK)
    add_scene(check)
    text = "speeds of the mean torques, rpm (default: the ends of what the scene gives over the speed)"
    check.add_argument("--rpm", type=speeds, metavar="A:B:COUNT", help=text)
    check.add_argument("--json", metavar="FILE", help="write all of it for programs, SI units")
    check.set_defaults(by_speed=True)
    modes = add(
        "modes",
        _runner("modes", "linear_commands"),
        "natural frequencies in Hz, undamped; mode shapes",
    )
    add_scene(modes)
    add_mean_load(modes)
    modes.add_argument("--json", metavar="FILE", help="write frequencies and shapes for programs")
    add_plot(modes, "shapes of the first six modes that strain links, with nodes and damping ratios")
    holzer = add("holzer", _runner("holzer", "linear_commands"), "Holzer's table of a train without loops", HOLZER)
    add_scene(holzer)
    add_mean_load(holzer)
    chosen = holzer.add_mutually_exclusive_group()
    text = "frequencies of the tables, Hz (default: the first three natural frequencies that strain links)"
    chosen.add_argument("--hz", nargs="+", type=positive, metavar="F", help=text)
    chosen.add_argument("--mode", nargs="+", type=count, metavar="K", help="modes, numbered as by jaxhb modes")
    holzer.add_argument("--json", metavar="FILE", help="write the tables in full precision, SI units")
    add_plot(holzer, "the residual over the frequency")
    campbell = add("campbell", _runner("campbell", "linear_commands"), "natural frequencies and orders", CAMPBELL)
    add_scene(campbell)
    add_mean_load(campbell)
    text = "range of speeds of the reference rotor, rpm; COUNT matters where frequencies depend on the speed"
    campbell.add_argument("--rpm", required=True, type=speed_range, metavar="A:B[:COUNT]", help=text)
    text = "orders of the reference rotor (default: those that the torques have)"
    campbell.add_argument("--orders", type=orders, metavar="N1,N2,...", help=text)
    text = "how many of the modes that strain links, the lowest (default 6)"
    campbell.add_argument("--modes", type=whole, default=6, metavar="N", help=text)
    add_misfire(campbell, EACH_MISFIRE)
    campbell.add_argument("--json", metavar="FILE", help="write frequencies and critical speeds in full precision")
    campbell.add_argument("--csv", metavar="FILE", help="write one row per critical speed for spreadsheets")
    add_plot(campbell, "the Campbell diagram")
    forced = add(
        "forced", _runner("forced", "linear_commands"), "linear: amplitudes by order and heat over the speed", FORCED
    )
    add_scene(forced)
    add_speeds(forced)
    text = "a disk, shaft, damper or mesh, speed by speed; may be repeated (default: the largest values of all)"
    element = forced.add_argument("--element", action="append", default=[], metavar="NAME", help=text)
    element.completer = of_elements("disk", "shaft", "damper", "mesh")
    add_misfire(forced, EACH_MISFIRE)
    add_files(forced, "orders and synthesis over the speed, of up to four elements")
    add_table(forced)
    add_netcdf(forced)


def _speed_commands(add):
    solve = add("solve", _runner("solve_one"), "one speed: do the teeth hammer? forces, torques, contact", SOLVE)
    add_scene(solve)
    solve.add_argument("--rpm", required=True, type=one_speed, metavar="R", help="speed of the reference rotor, rpm")
    add_misfire(solve)
    add_accuracy(solve)
    add_orbit(solve)
    add_certify(solve)
    add_files(solve, "the gear torque and the tooth forces over the cycle")
    add_table(solve)
    add_netcdf(solve)
    text = "write the motion over its period for spreadsheets: forces, torques, angles, speeds over the crank angle"
    solve.add_argument("--trace", metavar="FILE.csv", help=text)
    add_gear(solve)
    sweep = add("sweep", _runner("sweep", "sweeps"), "many speeds in one call: at which speeds do they hammer?", SWEEP)
    add_scene(sweep)
    add_speeds(sweep)
    add_misfire(sweep)
    add_accuracy(sweep)
    add_orbit(sweep)
    text = "which neighbour a speed starts from: the one below (up, default), above (down), or one after the other"
    sweep.add_argument("--direction", choices=("up", "down", "both"), help=text)
    add_files(sweep, "tooth force and time out of contact over the speed")
    add_table(sweep)
    add_netcdf(sweep)
    text = "amplitudes of all orders in the JSON and NetCDF files (default: none and those of the excitation)"
    sweep.add_argument("--full", action="store_true", help=text)
    text = "go over a number of the scene at the one speed of --rpm: from A to B in COUNT steps, or V1,V2,..., SI units"
    sweep.add_argument("--over", type=over, metavar="NAME.FIELD=A:B:COUNT", help=text)
    text = "keep what is found in this folder for good; without it until the sweep is done, in the folder of programs"
    sweep.add_argument("--out", dest="folder", metavar="DIR", help=text)
    text = "speeds that are computed, kept and written together (default 16); fewer lose less, and take longer"
    sweep.add_argument("--chunk", type=whole, metavar="N", help=text)


def _report_commands(add):
    report = add("report", _runner("report"), "several speeds, normal running and a misfire", REPORT)
    add_scene(report)
    add_speeds(report)
    add_misfire(report, EACH_MISFIRE)
    add_accuracy(report)
    add_orbit(report)
    add_files(report, "the torque on one gear over the cycle, in normal running")
    add_table(report)
    add_netcdf(report)
    add_gear(report)
    text = "speed of the picture and of what the page shows in full, rpm (default: the largest tooth force)"
    report.add_argument("--at", type=speed, metavar="R", help=text)
    add_certify(report, ", at the speed of --at")
    text = "write a page to print and sign: one file, no network (needs jaxhb[report])"
    report.add_argument("--html", metavar="FILE.html", help=text)
    second = report.add_mutually_exclusive_group()
    text = "on the page, another design beside the first: a scene, as jaxhb tune writes it"
    second.add_argument("--tuned", metavar="SCENE", help=text)
    text = "on the page, the design tuned as the [tune] table of the scene asks beside the first; takes minutes"
    second.add_argument("--tune", action="store_true", help=text)


def _tune_commands(add):
    tune = add("tune", _runner("tune"), "find the dampers (or any numbers) that cure it, by gradient", TUNE)
    add_scene(tune, scenarios=False)  # the tuned scene would not hold the values of one
    text = "speeds of the reference rotor, rpm, instead of those of the [tune] table: A:B:COUNT or R1,R2,..."
    tune.add_argument("--rpm", type=speeds, metavar="A:B:COUNT", help=text)
    tune.add_argument("--optimizer", choices=("lbfgs", "adam"), help="default: lbfgs")
    tune.add_argument("--steps", type=whole, metavar="N", help="maximum number of steps")
    tune.add_argument(
        "--starts", type=whole, metavar="N", help="number of designs tuned together: the scene and random ones"
    )
    tune.add_argument("--seed", type=count, metavar="N", help="seed of the random designs (default 0)")
    tune.add_argument("--tolerance", type=share, metavar="T", help="as in solve (default 0.01)")
    tune.add_argument("--output", metavar="FILE.toml", help="the tuned scene (default: SCENE_tuned.toml here)")
    tune.add_argument("--json", metavar="FILE", help="parameters, readings, history (default: as --output, .json)")
    tune.add_argument("--plot", metavar="FILE.png", help="draw the response before and after and the history")
    shell = add("completion", completion, "what makes a shell complete commands, options, scenes and names", COMPLETION)
    shell.add_argument("shell", nargs="?", choices=SHELLS, default="bash", metavar="SHELL", help=", ".join(SHELLS))


def run_scenes(_):
    from jaxhb.cli.inputs import scenes

    return scenes()


def run_new(arguments):
    from jaxhb.cli.inputs import new

    return new(arguments)


def run_scene(arguments):
    from jaxhb.cli.inputs import scene

    return scene(arguments)


def _runner(name, module="commands"):
    """What runs a command: it reads its inputs first, which takes a fraction of the time of importing jax."""

    def run(arguments):
        from jaxhb.cli.inputs import read

        train = read(arguments)
        from jaxhb._program import keep_programs
        from jaxhb._store import user_folder

        commands = importlib.import_module(f".{module}", __package__)
        keep_programs(user_folder())
        gc.set_threshold(NEW_OBJECTS)
        return getattr(commands, name)(train, arguments)

    return run


if __name__ == "__main__":
    sys.exit(main())
