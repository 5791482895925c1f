"""Options that several commands take."""

import click

from jaxhb.cli.completion import of_elements, of_scenes
from jaxhb.cli.parsing import option, together
from jaxhb.cli.values import place, positive, setting, share, whole
from jaxhb.train.speeds import read_speed, read_speeds

SCENE_ARGUMENT = click.argument(
    "scene", metavar="SCENE", help="a packaged scene (jaxhb scenes) or the path of a file", shell_complete=of_scenes
)
QUIET = option("--quiet", "print nothing but what is wrong: for files and the exit status")

SCENE_OF_TUNING = together(
    SCENE_ARGUMENT,
    QUIET,
    option(
        "--set NAME.FIELD=VALUE",
        'change a value of the scene, SI units: "crank damper.damping=300", "idler.teeth=40"; may be repeated',
        setting,
        multiple=True,
    ),
)
SCENE = together(
    SCENE_OF_TUNING,
    option("--scenario NAME", "take the values of [scenario.NAME] of the scene"),
    option(
        "--links-at hz=VALUE",
        "make links that vary constant: as they are at this frequency (hz), amplitude (rad) or speed (rpm)",
        place,
        multiple=True,
    ),
    option("--viscous HZ", "turn loss factors into viscous damping that takes as much at this frequency, Hz", positive),
)
"""The scene and what is changed in it; of a tuning without what the tuned scene could not hold."""

RPM = option(
    "--rpm A:B:COUNT",
    "speeds of the reference rotor, rpm: from A to B in COUNT equal steps, or a list R1,R2,...",
    read_speeds,
    required=True,
)
MEAN_LOAD = option(
    "--at R", "teeth as stiff as they are under the mean load of this speed, rpm (default: in contact)", read_speed
)

MOTION = together(
    option("--harmonics N", "fixed number of harmonics (default: as many as needed)", whole),
    option(
        "--tolerance T",
        "largest truncation error, as a share of the largest tooth force",
        share,
        default=0.01,
        show_default=True,
    ),
    option("--orbit", "a periodic solution, stable or not (a note says which), instead of what the train does"),
)
"""Which motion is asked for, and how exactly."""

GEAR = option(
    "--gear NAME", "gear of the picture (default: of the reference rotor)", shell_complete=of_elements("disk")
)


def misfire(more=""):
    """Cylinders that do not fire."""
    text = (
        "this cylinder does not fire: it has no gas torque at all, not that of compression either; its inertia torque"
        ' stays (one that compresses but burns nothing: --set "CYLINDER.combustion.imep=0"); may be repeated'
    )
    return option("--misfire CYLINDER", text + more, multiple=True, shell_complete=of_elements("cylinder"))


EACH_MISFIRE = misfire("; each: every cylinder in turn, and which is the worst")


def certify(where=""):
    """A computed bound."""
    text = f"a computed bound on how far off tooth forces can be{where}: double precision, no proof; half a minute"
    return option("--certify", text)


def plot(picture):
    """A picture."""
    return option("--plot FILE.png", f"draw {picture} (.png, .svg, .pdf; needs jaxhb[plot])")


def files(picture):
    """Files of numbers and a picture."""
    return together(
        option("--json FILE", "all numbers in full precision, SI units; -: on standard output instead of the tables"),
        option("--orders M", "list amplitudes in files up to this order (default: all; of a sweep none)", positive),
        plot(picture),
        option("--csv FILE", "write one row per answer for spreadsheets, SI units"),
        option("--netcdf FILE.nc", "write labelled arrays (xarray, ncview, MATLAB, ...; needs jaxhb[data])"),
    )
