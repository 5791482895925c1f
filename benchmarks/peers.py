"""The task of :mod:`chain_task`, a sweep of 100 speeds, by jaxhb, by other
harmonic-balance codes and by plain numpy.

    python -m venv .venv-peers && .venv-peers/bin/pip install pyHarm-os harmonicbalance
    python benchmarks/peers.py --peers .venv-peers/bin/python --json rows.jsonl     3 minutes, with --few 5 half of it
    python benchmarks/peers.py --codes                                              jaxhb and numpy alone, 30 s

pyHarm-os 1.2 wants an older JAX than jaxhb, hence the environment of its own; all run
in turn on the same core, with 15 harmonics and 240 samples of the law (harmonicbalance
has 61 and no choice), from one speed to the next except jaxhb, whose speeds are all
cold starts. ``error`` is the largest deviation of the link's extremes over the sweep
from those of the full numpy solution, relative to the backlash; a row that is wrong by
more than 1e-3 is no rival and says so. Seconds are run time of the whole sweep;
compilation beside it. With ``--few`` harmonicbalance solves the first few speeds, at
which it takes the fewest steps, and its seconds are those times 100 / few.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
from chain_task import (
    BACKLASH,
    CONTACT,
    DAMPING,
    GAP,
    GROUND,
    HARMONICS,
    MEAN,
    SWEEP,
    SWING,
    TRANSITION,
    condensed_sweep,
    extremes,
    full_sweep,
    middle,
    published,
)
from records import command_line, started, timed

import jaxhb

ALLOWED = 1e-3
COLUMNS = {
    "code": "<26s",
    "masses": "6d",
    "speeds": "6d",
    "seconds": "9.4f",
    "spread": "8.4f",
    "compile_seconds": "15.2f",
    "error": "8.1e",
    "ratio": "8.1f",
    "published": "9.3f",
    "status": "<30s",
}
PUBLISHED = {
    "pyHarm-os": "pyHarm-os 1.2.2 (NewtonRaphson)",
    "harmonicbalance": "harmonicbalance 0.2.0",
    "numpy, all masses": "plain numpy, dense Newton",
    "numpy, condensed": "plain numpy, condensed to the backlash link",
}


def chain_train(masses):
    """The chain as a drive train whose gears have a radius of 1 m, one revolution per
    cycle.
    """
    first = middle(masses)
    parts = [
        jaxhb.Disk(
            name=f"m{i}",
            inertia=1.0,
            damping=DAMPING,
            radius=1.0 if i in (first, first + 1) else None,
        )
        for i in range(masses)
    ]
    for i in range(masses - 1):
        ends = (f"m{i}", f"m{i + 1}")
        if i == first:
            law = {"epsilon": GAP / CONTACT, "transition": TRANSITION}
            parts.append(
                jaxhb.Mesh(between=ends, stiffness=CONTACT, backlash=BACKLASH, **law)
            )
        else:
            parts.append(jaxhb.Shaft(between=ends, stiffness=1.0))
    parts += [
        jaxhb.Ground(disk=f"m{masses - 1}", stiffness=GROUND),
        jaxhb.Torque(disk="m0", mean=MEAN, harmonics=[(1.0, SWING, 0.0)]),
    ]
    return jaxhb.build(
        parts, name=f"chain of {masses}", reference="m0", revolutions_per_cycle=1
    )


def rpm_of(w):
    """Speed of the reference rotor at the frequency ``w`` in rad/s."""
    return 60 * np.asarray(w) / (2 * np.pi)


def own_sweeps(masses):
    """Two ways of jaxhb: name -> a call that gives (coefficients ``(speeds, N+1)`` of
    the link, status).
    """
    train, rpm = chain_train(masses), rpm_of(SWEEP)
    plan = jaxhb.plan(train, rpm=float(rpm[-1]), harmonics=HARMONICS, tolerance=0.5)

    @jax.jit
    def planned(rpm):
        def one(speed):
            response = jaxhb.solve(train, rpm=speed, plan=plan)
            return response.deflections[0], response.status

        return jax.vmap(one)(rpm)

    def speeds():
        response = jaxhb.solve_speeds(
            train, rpm=rpm, harmonics=HARMONICS, tolerance=0.5
        )
        return response.deflections[:, 0], response.status

    def batch():
        deflection, status = planned(rpm)
        return np.asarray(deflection), np.asarray(status)

    return {"jaxhb, solve_speeds": speeds, "jaxhb, vmapped plan": batch}


def listed(coefficients):
    """Complex ``(speeds, N+1)`` as [mean, cosines, sines] per speed."""
    rest = coefficients[:, 1:]
    return np.concatenate(
        [coefficients[:, :1].real, 2 * rest.real, -2 * rest.imag], axis=1
    )


def deviation(link, wanted):
    """Largest difference of the link's extremes over the speeds, relative to the
    backlash.
    """
    pairs = zip(link, wanted[: len(link)], strict=True)
    return (
        max(
            float(np.abs(np.subtract(extremes(a), extremes(b))).max()) for a, b in pairs
        )
        / BACKLASH
    )


def peer(python, name, masses, speeds):
    """What :mod:`peer_codes` prints, or a sentence why it did not."""
    code = Path(__file__).resolve().parent / "peer_codes.py"
    command = [str(Path(python).absolute()), str(code), name, str(masses), str(speeds)]
    with (
        tempfile.TemporaryDirectory() as folder
    ):  # pyHarm writes into the folder that it runs in
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["no output"])[-1]
    return json.loads(done.stdout.strip().splitlines()[-1])


def run(masses, options, recorder):
    """All rows of one chain; the full numpy solution is the reference and comes
    first.
    """
    rows = []

    def add(code, link, seconds, **row):
        error = deviation(link, wanted)
        status = row.pop("status", "")
        agrees = "agrees" if error <= ALLOWED else "another answer"
        rows.append(
            {
                "code": code,
                "error": error,
                "seconds": seconds,
                "status": status or agrees,
                **row,
            }
        )

    wanted, _, seconds, spread = timed(
        lambda: full_sweep(masses, SWEEP), options.repeats
    )
    add("numpy, all masses", wanted, seconds, spread=spread)
    link, _, seconds, spread = timed(
        lambda: condensed_sweep(masses, SWEEP), options.repeats
    )
    add("numpy, condensed", link, seconds, spread=spread)
    for code, sweep in own_sweeps(masses).items():
        (link, status), first, seconds, spread = timed(sweep, options.repeats)
        unsolved = int(np.sum(np.asarray(status) > jaxhb.Status.TOLERANCE_NOT_MET))
        wrong = {"status": f"{unsolved} speeds not solved"} if unsolved else {}
        add(
            code,
            listed(np.asarray(link)),
            seconds,
            spread=spread,
            compile_seconds=first - seconds,
            **wrong,
        )
    few = min(options.few, len(SWEEP))
    for code in options.codes:
        count = few if code == "harmonicbalance" else len(SWEEP)
        answer = peer(options.peers, code, masses, count)
        if isinstance(answer, str):
            rows.append({"code": code, "status": answer[:80]})
            continue
        seconds = answer["seconds"] * len(SWEEP) / count
        note = {"peer_versions": answer["versions"], "solved": count}
        add(
            code,
            np.array(answer["link"]),
            seconds,
            compile_seconds=answer["first"],
            **note,
        )
    _record(masses, rows, recorder)


def _record(masses, rows, recorder):
    """Add the rows with their ratio to pyHarm-os, or else to numpy."""
    place = published()["cpu_seconds_one_thread"]["columns"].index(f"sweep S={masses}")
    seconds = {row["code"]: row.get("seconds") for row in rows}
    base = seconds.get("pyHarm-os") or seconds["numpy, all masses"]
    for row in rows:
        label = PUBLISHED.get(row["code"])
        told = published()["cpu_seconds_one_thread"][label][place] if label else None
        ratio = base / row["seconds"] if row.get("seconds") else None
        recorder.add(
            masses=masses, speeds=len(SWEEP), published=told, ratio=ratio, **row
        )
    known = "pyHarm-os" if seconds.get("pyHarm-os") else "numpy, all masses"
    print(
        f"ratio: seconds of {known} / seconds of the row; published: seconds on another"
        " machine\n",
        flush=True,
    )


def main():
    """Run what the command line asks for."""
    parser = command_line(__doc__, core=0, repeats=5)
    parser.add_argument(
        "--peers",
        default=sys.executable,
        help="interpreter that has pyHarm-os and harmonicbalance",
    )
    names = ["pyHarm-os", "pyHarm-os, NLdofs", "harmonicbalance"]
    parser.add_argument(
        "--codes",
        nargs="*",
        choices=names,
        default=names,
        metavar="CODE",
        help="; ".join(names),
    )
    parser.add_argument("--masses", type=int, nargs="+", choices=(3, 10), default=[10])
    parser.add_argument(
        "--few", type=int, default=len(SWEEP), help="speeds that harmonicbalance solves"
    )
    options = parser.parse_args()
    recorder = started("peers", options, COLUMNS)
    for masses in options.masses:
        run(masses, options, recorder)


if __name__ == "__main__":
    main()
