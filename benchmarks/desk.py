"""How long four commands of the desk take on two plants, as whole processes: the first
call, which compiles, and the second, which finds its programs on disk.

    python benchmarks/desk.py [--commands check identify tolerance phase] [--core 0]

``two_stroke`` is a ship driven directly by six cylinders through a long shaft line (26
disks, no teeth); ``twin_v12`` has two V12 engines on one gear with a shaft generator
that rattles (34 disks, three meshes with backlash); ``loaded`` is the same with 15 % of
the power taken by the generator, so that no tooth leaves contact. The measured orders
are computed from changed plants, with 2 % of noise.

Seconds are of the processor (user and system), as other programs may run beside these.
``programs`` is the share of the second call in which programs run or are waited for,
``traced`` how many the second call traced, which must be none; both are from a third
call with a profile.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from records import command_line, started

PLANTS = Path(__file__).parent / "plants"
LOADED = ("screw.share=0.85", "generator load.share=0.15")
LINE = "shaft torque of propeller shaft"
COMMANDS = {
    "check": [
        ("two_stroke", ["check"]),
        ("twin_v12", ["check"]),
    ],
    "identify": [
        (
            "two_stroke",
            [
                "identify",
                "two_stroke_measured.csv",
                "--fit=propeller.inertia=35000:50000",
                "--fit=cyl 6|thrust collar.stiffness=1e9:2e9",
            ],
        ),
        (
            "twin_v12",
            [
                "identify",
                "twin_v12_measured.csv",
                "--fit=propeller.inertia=900:1500",
                "--fit=port coupling row 1.stiffness=1e5:3e5",
            ],
        ),
    ],
    "tolerance": [
        ("two_stroke", ["tolerance", "--rpm=60:115:12"]),
        ("two_stroke", ["tolerance", "--rpm=30:115:86"]),
    ],
    "phase": [
        ("loaded", ["phase", "--rpm=180:333:6"]),
        ("loaded", ["phase", "--rpm=180:333:51"]),
        ("twin_v12", ["phase", "--rpm=180:333:6", f"--of={LINE}"]),
    ],
}
COLUMNS = {
    "plant": "<11s",
    "command": "<44s",
    "first": "7.1f",
    "second": "7.1f",
    "programs": "9.2f",
    "traced": "7d",
}
PROFILED = """
import sys, time
from jaxhb._program import Program
from jaxhb.cli.main import main

run = Program._run
trace = Program._trace
spent = [0.0, 0]

def timed(program, args, kwargs):
    begin = time.process_time()
    try:
        return run(program, args, kwargs)
    finally:
        spent[0] += time.process_time() - begin

def counted(program, call):
    spent[1] += 1
    return trace(program, call)

Program._run = timed
Program._trace = counted
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print(spent[0] / time.process_time(), spent[1], file=sys.stderr)
"""


def arguments_of(plant, command):
    """The words of a command on a plant, with the files in their folder."""
    scene = PLANTS / ("twin_v12.toml" if plant == "loaded" else f"{plant}.toml")
    name, *rest = command
    words = [str(PLANTS / word) if word.endswith(".csv") else word for word in rest]
    changes = [f"--set={change}" for change in LOADED] if plant == "loaded" else []
    return [name, str(scene), *words, *changes]


def called(begin, words, environment):
    """Seconds of the processor that a process takes, and what it writes to stderr."""
    before = os.times()
    process = subprocess.run(
        [sys.executable, *begin, *words],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    after = os.times()
    if process.returncode > 1:
        raise RuntimeError(process.stderr)
    seconds = (
        after.children_user
        + after.children_system
        - before.children_user
        - before.children_system
    )
    return seconds, process.stderr


def main():
    """Run the commands that the command line asks for."""
    parser = command_line(__doc__, core=0)
    parser.add_argument(
        "--commands", nargs="+", choices=list(COMMANDS), default=list(COMMANDS)
    )
    options = parser.parse_args()
    rows = started("desk", options, COLUMNS)
    for name in options.commands:
        for plant, command in COMMANDS[name]:
            words = arguments_of(plant, command)
            with tempfile.TemporaryDirectory() as folder:
                environment = os.environ | {
                    "JAX_COMPILATION_CACHE_DIR": f"{folder}/jax",
                    "JAXHB_CACHE": f"{folder}/jaxhb",
                }
                seconds = [
                    called(["-m", "jaxhb"], words, environment)[0] for _ in range(2)
                ]
                _, told = called(["-c", PROFILED], words, environment)
            share, traced = told.splitlines()[-1].split()
            rows.add(
                plant=plant,
                command=" ".join(command)[:44],
                first=seconds[0],
                second=seconds[1],
                programs=float(share),
                traced=int(traced),
            )


if __name__ == "__main__":
    main()
