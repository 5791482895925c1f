"""Options that several commands take, and how their values are read; light, before anything heavy is imported."""

import argparse
import math

from jaxhb.cli.parsing import of_elements, of_scenes
from jaxhb.train.speeds import read_speed, read_speeds

_NO_NUMBER = ("nan", "inf", "infinity")

RANGE_COUNT = 33
"""Speeds of a range that has no count."""


def add_scene(command, scenarios=True):
    """The scene and what is changed in it."""
    scene = command.add_argument("scene", metavar="SCENE", help="a packaged scene (jaxhb scenes) or the path of a file")
    scene.completer = of_scenes
    if scenarios:
        command.add_argument("--scenario", metavar="NAME", help="take the values of [scenario.NAME] of the scene")
        text = "make links that vary constant: as they are at this frequency (hz), amplitude (rad) or speed (rpm)"
        command.add_argument("--links-at", action="append", default=[], type=place, metavar="hz=VALUE", help=text)
        text = "turn loss factors into viscous damping that takes as much at this frequency, Hz"
        command.add_argument("--viscous", type=positive, metavar="HZ", help=text)
    command.add_argument(
        "--set",
        action="append",
        default=[],
        type=setting,
        metavar="NAME.FIELD=VALUE",
        help='change a value of the scene, SI units: "crank damper.damping=300", "idler.teeth=40"; may be repeated',
    )


def add_speeds(command):
    """Speeds in rpm."""
    text = "speeds of the reference rotor, rpm: from A to B in COUNT equal steps, or a list R1,R2,..."
    command.add_argument("--rpm", required=True, type=speeds, metavar="A:B:COUNT", help=text)


def add_mean_load(command):
    """Teeth as stiff as they are at the mean load of a speed."""
    text = "meshes with backlash with their tangent stiffness at the mean load of this speed, rpm (default: in contact)"
    command.add_argument("--at", type=speed, metavar="R", help=text)
    command.set_defaults(by_speed=True)


def add_misfire(command, more=""):
    """Cylinders that do not fire."""
    text = "this cylinder does not fire: it has no gas torque at all, not that of compression either; its inertia"
    text += ' torque stays (one that compresses but burns nothing: --set "CYLINDER.combustion.imep=0"); may be repeated'
    text += more
    misfire = command.add_argument("--misfire", action="append", default=[], metavar="CYLINDER", help=text)
    misfire.completer = of_elements("cylinder")


def add_accuracy(command):
    """How exactly the periodic solution is computed."""
    command.add_argument(
        "--harmonics", type=whole, metavar="N", help="fixed number of harmonics (default: as many as needed)"
    )
    command.add_argument(
        "--tolerance",
        type=share,
        default=0.01,
        metavar="T",
        help="largest truncation error, as a share of the largest tooth force (default 0.01)",
    )


def add_orbit(command):
    """A periodic solution whether or not the train runs in it."""
    text = "a periodic solution instead of what the train does; it need not be stable, and a note says whether it is"
    command.add_argument("--orbit", action="store_true", help=text)


def add_certify(command, where=""):
    """A computed bound."""
    text = f"a computed bound on how far off tooth forces can be{where}: double precision, no proof; half a minute"
    command.add_argument("--certify", action="store_true", help=text)


def add_files(command, picture):
    """Files of numbers and a picture."""
    text = "write all numbers in full precision, SI units; -: to standard output instead of the tables"
    command.add_argument("--json", metavar="FILE", help=text)
    text = "list amplitudes in files up to this order (default: all; of a sweep none)"
    command.add_argument("--orders", type=positive, metavar="M", help=text)
    add_plot(command, picture)


def add_table(command):
    """A table of rows."""
    command.add_argument("--csv", metavar="FILE", help="write one row per answer for spreadsheets, SI units")


def add_netcdf(command):
    """Labelled arrays."""
    text = "write labelled arrays (xarray, ncview, MATLAB, ...; needs jaxhb[data])"
    command.add_argument("--netcdf", metavar="FILE.nc", help=text)


def add_plot(command, picture):
    """A picture."""
    command.add_argument("--plot", metavar="FILE.png", help=f"draw {picture} (.png, .svg, .pdf; needs jaxhb[plot])")


def add_gear(command):
    """The gear of the picture."""
    gear = command.add_argument("--gear", metavar="NAME", help="gear of the picture (default: of the reference rotor)")
    gear.completer = of_elements("disk")


def speed(text):
    """A speed in rpm from the command line."""
    return _read(read_speed, text)


def one_speed(text):
    """A speed in rpm, where a command takes no more than one."""
    if not {",", ":"} & set(text):
        return speed(text)
    several = len(speed_range(text))
    commands = "jaxhb sweep and jaxhb report take several"
    raise argparse.ArgumentTypeError(f"{text!r} are {several} speeds, and this command takes one: {commands}")


def speeds(text):
    """Speeds in rpm from ``A:B:COUNT`` or ``R1,R2,...``."""
    return _read(read_speeds, text)


def speed_range(text):
    """Speeds in rpm from ``A:B[:COUNT]`` or ``R1,R2,...``."""
    return speeds(f"{text}:{RANGE_COUNT}" if text.count(":") == 1 else text)


def orders(text):
    """Orders from ``N1,N2,...``."""
    return [positive(word) for word in text.split(",")]


def _read(reader, text):
    try:
        return reader(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def positive(text):
    """A number greater than 0 from the command line."""
    value = _number(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number greater than 0")
    return value


def whole(text, least=1):
    """A whole number of at least 1 from the command line."""
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least {least}")
    return int(text)


def count(text):
    """A whole number of at least 0 from the command line."""
    return whole(text, least=0)


def share(text):
    """A number between 0 and 1 from the command line."""
    value = _number(text)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number greater than 0 and less than 1, as 0.01 for 1 %")
    return value


def setting(text):
    """``(NAME.FIELD, VALUE)`` from the command line, the value a number or a word."""
    key, equals, word = text.rpartition("=")
    value, name = _number(word), word.strip()
    if math.isnan(value) and name.replace("_", "").isalnum() and name[0].isalpha() and name.lower() not in _NO_NUMBER:
        value = name
    if equals and name[:1] in "0123456789+-." and name[:1] and math.isnan(value):
        raise argparse.ArgumentTypeError(f"{text!r}: {name} is no number; values are numbers in SI units, as 3.6e4")
    if not equals or (isinstance(value, float) and not math.isfinite(value)):
        raise argparse.ArgumentTypeError(f'{text!r} is not NAME.FIELD=VALUE, as "crank damper.damping=300"')
    return key.strip(), value


def over(text):
    """``(NAME.FIELD, [values])`` from the command line."""
    key, equals, values = text.rpartition("=")
    words = values.split(":")
    try:
        if len(words) == 1:
            found = [float(word) for word in values.split(",")]
        else:
            first, last, steps = float(words[0]), float(words[1]), int(words[2])
            found = [first + (last - first) * i / (steps - 1) for i in range(steps)]
    except (ValueError, IndexError, ZeroDivisionError):
        found = []
    if not equals or len(words) not in (1, 3) or len(found) < 2 or not all(map(math.isfinite, found)):
        example = '"crank damper.damping=100:400:13" or =100,200,400'
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME.FIELD=A:B:COUNT with a COUNT of at least 2, as {example}"
        )
    return key.strip(), found


def place(text):
    """``(hz | amplitude | rpm, VALUE)`` from the command line."""
    name, _, number = text.partition("=")
    value = _number(number)
    if name not in ("hz", "amplitude", "rpm") or not value >= 0:
        raise argparse.ArgumentTypeError(
            f"{text!r} is none of hz=VALUE, amplitude=VALUE and rpm=VALUE, VALUE at least 0"
        )
    return name, value


def _number(text):
    """A finite number, or nan."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
