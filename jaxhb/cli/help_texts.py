"""What ``jaxhb --help`` and the commands say of themselves."""

DESCRIPTION = """\
Forced vibration of drive trains with gear backlash: do the teeth hammer, at which speeds, and how hard?
For each speed jaxhb reports what the train does after it has run long enough: teeth in contact, a periodic motion, one
with a period of several cycles, or an irregular one. Units: rpm, N m, kN and deg."""

EXAMPLES = """\
  jaxhb new my_engine.toml
  jaxhb check my_engine.toml
  jaxhb scenes
  jaxhb scene six_cylinder_diesel --expand
  jaxhb scene gear_train_30 --plot train.png
  jaxhb modes six_cylinder_diesel
  jaxhb forced six_cylinder_diesel --rpm 1000:2600:65 --element "cyl6|flywheel" --plot orders.png
  jaxhb campbell six_cylinder_diesel --rpm 600:2600 --orders 3,4.5,6,9 --plot campbell.png
  jaxhb holzer six_cylinder_diesel --mode 1 2
  jaxhb solve gear_train_30 --rpm 1800 --plot cycle.png
  jaxhb solve gear_train_30 --rpm 1800 --misfire "cylinder A1" --set "crank damper.damping=300" --json result.json
  jaxhb sweep gear_train_30 --rpm 600:2450:20 --csv sweep.csv --plot sweep.png
  jaxhb report gear_train_30 --rpm 600,1200,1800,2450 --misfire "cylinder A1" --plot crank_gear.png
  jaxhb report gear_train_30 --rpm 700:2450:8 --misfire "cylinder A1" --html report.html
  jaxhb tune engine_with_damper --plot tuned.png"""

STATUS = """\
exit status: 0 every speed has its answer: the kind of motion is known, and the harmonic solution of a periodic one is
within its limits (residual and truncation error); what is "not confirmed by harmonic balance" is known from recorded
cycles, an answer that a ? marks; 1 a speed has none (files are still written); 2 bad input (nothing is written); 3 an
error in the program. With --orbit: 0 converged at all speeds, 1 not; an unstable orbit is reported. A scene whose mean
torques do not balance is bad input (2). If --set unbalances a scene, it is reported as such (1)."""

WITHOUT_SPEEDS = ("new", "scene", "scenes", "completion", "modes", "holzer")
LINEAR = ("check", "campbell", "forced")
DONE = "exit status: 0 done; 2 bad input (nothing is written); 3 an error in the program."
LINEAR_STATUS = """\
exit status: 0 every speed has an answer; 1 not so (files are still written); 2 bad input (nothing is written); 3 an
error in the program."""

FORCED = """\
The linear forced response, all teeth in contact: amplitude of every order, half peak-to-peak of the synthesis, sum of
amplitudes, and power turned into heat, of every disk (deg), shaft and damper (N m) and mesh (kN). Without --element the
largest values over the speeds. Links may vary over frequency and amplitude."""
HOLZER = """\
Holzer's table as engineers print it: inertia, ordinate, torque sum and twist from the free ends to the last disk, with
the energies of disks and links in % of the kinetic energy. Undamped; teeth in contact, or as --at says. At a natural
frequency the residual is 0 but for rounding."""
CAMPBELL = """\
The Campbell diagram: natural frequencies over the speed, orders of the excitation as rays, and the critical speeds
where they meet, order x rpm / 60 = Hz. Undamped; teeth in contact, or as --at says; order-tuned absorbers follow the
speed."""
SOLVE = """\
One speed, with backlash and without: the kind of motion, which teeth separate and for how long, tooth forces (kN),
torques of gears and shafts (N m). Of a motion that never repeats the numbers are extremes over recorded cycles, and the
largest tooth force of a cycle is given as 5, 50 and 95 % of the cycles have it."""
SWEEP = """\
Many speeds in one call: kind of motion, largest tooth force and time out of contact over the speed. Where several
motions are possible the train has the one it comes from: each speed starts from its neighbour below (--direction up),
above (down), or is reached both ways."""
REPORT = """\
Several speeds, with backlash and without, in normal running and with a misfiring cylinder, or with every cylinder in
turn (--misfire each). The plot shows the torque on one gear over the cycle, with the time in the gap shaded. --html
writes a page that is printed and signed: the train and its data, natural frequencies, forced orders, what the train
does at every speed, limits, accuracy, notes."""

COMPLETION = """\
Prints a script for the shell; needs jaxhb[shell]. In ~/.bashrc: eval "$(jaxhb completion bash)"; for fish:
jaxhb completion fish | source."""

SCENE = """\
Checks a scene and writes it as TOML. Files of other programs are read by their endings: .json in the TORS format of
openTorsion, .csv with a table of inertias (name, inertia, radius, ...) and one of links (from, to, stiffness, ...)."""

CHECK = """\
Reads a scene and reports what it amounts to: mean torques and tooth forces, the damping of every mesh, natural
frequencies with damping ratios. Notes name numbers that are allowed but far from usual, as a pressure in bar or a bore
in mm; they are no errors, and solve, sweep and report print them, too."""

NEW = """\
Writes a scene to begin with, every line explained, or a copy of another one with its tables beside it. Never overwrites
a file."""

TUNE = """\
Changes numbers of a scene within bounds, by gradient, to make a response small over a range of speeds. The [tune] table
of the scene sets what changes and what is minimised: docs/how_to/tune.md has all of it. Every step writes the tuned
scene and the history, so Ctrl-C leaves the best design so far; the exit status is then 130."""


def below(command=None):
    """The examples, all of them or those of one command, and what the exit status tells."""
    own = [line for line in EXAMPLES.splitlines() if command in (None, line.split()[1])]
    status = DONE if command in WITHOUT_SPEEDS else LINEAR_STATUS if command in LINEAR else STATUS
    return "\n".join(["examples:", *own, "", status] if own else [status])
