"""Options: how one is declared and completed, those that several commands take, and
what of them is beyond click.
"""

import gc
import importlib
import os
import re
from functools import reduce
from types import SimpleNamespace

import click
from click.shell_completion import BashComplete, CompletionItem, add_completion_class

from jaxhb.cli.values import place, positive, setting, share, whole
from jaxhb.report.files.output import OutputError
from jaxhb.train.speeds import read_speed, read_speeds


@add_completion_class
class QuotingBash(BashComplete):
    """Names such as ``cylinder A1``: where no quote was typed, what bash would split
    stands after backslashes.
    """

    def format_completion(self, item):
        """One line; bash takes one backslash away when it reads it."""
        typed = os.environ["COMP_WORDS"].split("\n")[int(os.environ["COMP_CWORD"]) :]
        quoted = typed and typed[0].startswith(("'", '"'))
        value = (
            item.value if quoted else re.sub(r"([^\w./~@%+:=,-])", r"\\\1", item.value)
        )
        return f"{item.type},{value}".replace("\\", "\\\\")


def of_scenes(context, parameter, begun):
    """Packaged scenes that a word may become, and files where it becomes none."""
    from jaxhb.scene.files import scene_names

    names = [CompletionItem(name) for name in scene_names() if name.startswith(begun)]
    return [CompletionItem(begun, type="file"), *names]


def of_elements(*tables):
    """What proposes the names of elements of the scene of the line."""

    def names(context, parameter, begun):
        from jaxhb.elements.elements import SceneError
        from jaxhb.scene.files import load_scene

        try:
            elements = load_scene(context.params["scene"]).topology.elements
        except (
            SceneError,
            OSError,
            TypeError,
        ):  # there is none on the line, or none that can be read
            return []
        return [
            name
            for name, (table, _) in elements.items()
            if table in tables and name.startswith(begun)
        ]

    return names


OWN_LINKS = (
    "check",
    "modes",
    "holzer",
    "campbell",
)  # see to --links-at themselves, at speeds of their own
MODULES = dict.fromkeys(("new", "scenes", "scene"), "inputs") | dict.fromkeys(
    ("solve", "sweep", "tune"), "commands"
)
MODULES |= {
    "report": "page_command",
    "tolerance": "tolerance_command",
    "identify": "identify_command",
    "phase": "tolerance_command",
}  # where the work is; of the others in linear_commands.py
SPEEDS = "--rpm", "--speed", "--speeds"
NO_SPEED = (
    "Natural frequencies do not depend on the speed; --at R takes the teeth as under"
    " the mean load of R rpm."
)
# Ends how an option is spelled that takes one or more values: ``--mode K [K ...]``
MORE = " ...]"


class Command(click.Command):
    """A command that takes no option for a value, reads ``--mode 1 2``, and knows under
    which words a speed may stand.

    Its work is the function of its name in a module of this folder, imported when it
    runs.
    """

    def invoke(self, ctx):
        """The exit status of that function: of the options, and but for those of
        inputs.py of the train first.
        """
        from jaxhb.cli import inputs, operating_modes

        given, module = ctx.params, MODULES.get(self.name, "linear_commands")
        for first, second in (("hz", "mode"), ("tuned", "tune")):
            if given.get(first) and given.get(second):
                raise click.UsageError(
                    f"--{first} and --{second} exclude each other.", ctx
                )
        if module == "inputs":
            return getattr(inputs, self.name)(**given)
        asked = operating_modes.modes(given)

        def read(given):
            return inputs.read(given, self.name not in OWN_LINKS)

        given = given | (
            {"scenario": [*asked.values()][0]}
            if len(asked) == 1 and "scenario" in given
            else {}
        )
        train = (
            read(given) if len(asked) == 1 else None
        )  # takes a fraction of the time of importing jax
        from jaxhb._jax import too_little_memory

        refusal = too_little_memory()
        if refusal:
            raise OutputError(refusal)
        from jaxhb._program import keep_programs
        from jaxhb._store import user_folder

        keep_programs(user_folder())
        # With Python's 700 or so new objects between collections these take a third of
        # the time of tracing.
        gc.set_threshold(50_000)
        function = getattr(importlib.import_module(f"jaxhb.cli.{module}"), self.name)

        def run(train, given):
            return function(train, SimpleNamespace(**given), **given)

        if train is not None:
            return run(train, given)
        from jaxhb.cli.resume import as_one

        with as_one():
            return operating_modes.each(run, given, asked, read)

    def parse_args(self, ctx, args):
        """As click, but for what the class says; every fault knows its command."""
        options = [
            one
            for one in self.params
            if isinstance(one, click.Option) and not one.is_flag
        ]
        valued = {name: one for one in options for name in one.opts}
        if ctx.resilient_parsing and args and args[-1] in valued:
            args = args[
                :-1
                # Its value is being completed, by the scene, of which click would not
                # know then
            ]
        words = []
        several = None
        try:
            for word in args:
                if word.startswith("--"):
                    if words and words[-1] in valued and not ctx.resilient_parsing:
                        raise click.BadOptionUsage(
                            words[-1], f"Option {words[-1]!r} requires an argument."
                        )
                    several = (
                        word
                        if word in valued and valued[word].metavar.endswith(MORE)
                        else None
                    )
                elif several and words[-1] != several:
                    words.append(several)
                words.append(word)
            return super().parse_args(ctx, words)
        except click.UsageError as fault:
            fault.ctx = fault.ctx or ctx
            meant = (
                "Did you mean '--rpm'?"
                if "--rpm" in valued
                else NO_SPEED
                if "--at" in valued
                else ""
            )
            if (
                meant
                and isinstance(fault, click.NoSuchOption)
                and fault.option_name in SPEEDS
            ):
                fault.message = f"{fault.message} {meant}"
                fault.possibilities = None
            raise


def _reader(read):
    """A type of click from a function of a word, whose ValueError says what is
    wrong.
    """

    def value(word):
        try:
            return read(word)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None

    return value


def option(spelled, text, read=None, *, to=None, **more):
    """An option as its help spells it, ``--rpm A:B:COUNT``, without a second word a
    switch; named ``to`` in Python.

    ``read`` is a function of the word or a sequence of words to choose from. Where they
    name files the shell completes them.
    """
    name, _, metavar = spelled.partition(" ")
    if metavar.startswith(("FILE", "DIR")):
        more["type"] = click.Path()
    elif read is not None:
        more["type"] = _reader(read) if callable(read) else click.Choice(read)
    more |= {"metavar": metavar} if metavar else {"is_flag": True}
    more |= {"multiple": True} if metavar.endswith(MORE) else {}
    return click.option(*filter(None, (name, to)), help=text, **more)


def together(*options):
    """One decorator of several options, shown in this order."""
    return lambda function: reduce(
        lambda made, one: one(made), reversed(options), function
    )


SCENE_ARGUMENT = click.argument(
    "scene",
    metavar="SCENE",
    help="a packaged scene (jaxhb scenes) or the path of a file",
    shell_complete=of_scenes,
)
QUIET = option(
    "--quiet", "print nothing but what is wrong: for files and the exit status"
)
SET = option(
    "--set NAME.FIELD=VALUE",
    'change a value of the scene, SI units: "crank damper.damping=300",'
    ' "idler.teeth=40"; may be repeated',
    setting,
    multiple=True,
)
SCENE_OF_TUNING = together(SCENE_ARGUMENT, QUIET, SET)
SCENE = together(
    SCENE_OF_TUNING,
    option(
        "--scenario NAME",
        "take what [scenario.NAME] of the scene changes; may be repeated, and all:"
        " every one in turn, in which each quantity is largest",
        multiple=True,
    ),
    option(
        "--links-at hz=VALUE",
        "make links that vary constant: as they are at this frequency (hz), amplitude"
        " (rad) or speed (rpm)",
        place,
        multiple=True,
    ),
    option(
        "--viscous HZ",
        "turn loss factors into viscous damping that takes as much at this"
        " frequency, Hz",
        positive,
    ),
)
"""The scene and what is changed in it; of a tuning without what the tuned scene could
not hold.
"""

RPM = option(
    "--rpm A:B:COUNT",
    "speeds of the reference rotor, rpm: COUNT from A to B, equally far apart, or a"
    " list R1,R2,...",
    read_speeds,
    required=True,
)
MEAN_LOAD = option(
    "--at R",
    "teeth as stiff as they are under the mean load of this speed, rpm (default: in"
    " contact)",
    read_speed,
)
MOTION = together(
    option(
        "--harmonics N", "fixed number of harmonics (default: as many as needed)", whole
    ),
    option(
        "--tolerance T",
        "largest truncation error, as a share of the largest tooth force",
        share,
        default="0.01",
        show_default=True,
    ),
    option(
        "--orbit",
        "a periodic solution, stable or not (a note says which), instead of what the"
        " train does",
    ),
)
"""Which motion is asked for, and how exactly."""

GEAR = option(
    "--gear NAME",
    "gear of the picture (default: of the reference rotor)",
    shell_complete=of_elements("disk"),
)


def misfire(more=""):
    """Cylinders that do not fire, and that are cut off."""
    named = {"multiple": True, "shell_complete": of_elements("cylinder")}
    without_injection = (
        "this cylinder does not fire: no injection, compression stays (as rules of"
        " classification ask)"
    )
    without_gas = (
        "this cylinder has no gas torque at all, neither of combustion nor of"
        " compression"
    )
    return together(
        option(
            "--misfire CYLINDER", f"{without_injection}; may be repeated{more}", **named
        ),
        option("--cut-off CYLINDER", f"{without_gas}; may be repeated{more}", **named),
    )


EACH_MISFIRE = misfire("; each: every cylinder in turn, and which is the worst")


def certify(where=""):
    """A computed bound."""
    text = (
        f"a computed bound on how far off tooth forces can be{where}: double precision,"
        " no proof; half a minute"
    )
    return option("--certify", text)


def plot(picture):
    """A picture."""
    return option(
        "--plot FILE.png", f"draw {picture} (.png, .svg, .pdf; needs jaxhb[plot])"
    )


def files(picture, *, spectra=True):
    """Files of numbers, where ``spectra`` are among them with an option of their own,
    and a picture.
    """
    orders = option(
        "--orders M",
        "list amplitudes in files up to this order (default: all; of a sweep none)",
        positive,
    )
    return together(
        option(
            "--json FILE",
            "all numbers in full precision, SI units; -: on standard output instead of"
            " the tables",
        ),
        *([orders] if spectra else []),
        plot(picture),
        option("--csv FILE", "write one row per answer for spreadsheets, SI units"),
        option(
            "--netcdf FILE.nc",
            "write labelled arrays (xarray, ncview, MATLAB, ...; needs jaxhb[data])",
        ),
    )
