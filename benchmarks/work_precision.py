"""Work-precision: error of the elastic tooth force over one cycle against run time, one
curve per method.

    python benchmarks/work_precision.py                               27 disks, tooth damping 6, 2 and 1 %, all methods
    python benchmarks/work_precision.py --disks 300 --damping 6 1     shafts cut into pieces
    python benchmarks/work_precision.py --disks 3000 --damping 6 --rpm 1833 --methods
    harmonic rk4 implicit --budget 20 python benchmarks/work_precision.py --methods
    harmonic rk4 --json rows.jsonl
    python benchmarks/work_precision.py --quick                       one speed, one damping, few settings

The task is ``gear_train_30`` at five speeds at which its teeth hammer, with the same
tooth damping ratio at every mesh (the scene's own is 5 %), as it is (27 disks) and with
its shafts cut into pieces (:func:`refined_trains.refined`). Errors are sup-norm over
the cycle and all meshes, relative to the largest tooth force, at the times that a
method samples; to what, see :mod:`references`. Seconds are run time on one core,
medians of repeats; beside it, what the first call took longer (the references have
compiled much of jaxhb before: ``scaling.py compile`` has its compile time). An
integrator runs from the linear motion shifted onto its flanks until the tooth force of
two cycles agrees within ``aim``, at most 100 cycles, and at 6 % damping also for six
cycles; of the compiled ones only the steps count. Where the stable step of Runge-Kutta
is hopeless (3000 disks) its row is a prediction, six cycles from the pace of 256 steps.

The first line takes an hour, 10 minutes of it at 6 %: at 1 and 2 % some speeds are not
solved, and each call says so after 18 s. A speed of 27 disks at 6 % with ``--methods
harmonic rk4`` takes 40 s, one of 3000 disks 1 to 2 minutes.
"""

import numpy as np
from adaptive import diffrax_march, march_speeds, scipy_march
from integrators import runge_kutta as runge_kutta_steps
from marches import march
from records import command_line, started, timed
from references import distance, references
from refined_trains import HAMMERING_RPM, refined, with_tooth_damping
from tasks import fastest_rate, prepare

import jaxhb

TOLERANCES = (3e-2, 1e-2, 3e-3, 1e-3)
STEPS = (2000, 3000, 4000, 6000, 12000)
IMPLICIT_STEPS = (3000, 6000, 12000, 24000, 48000)
AIMS = (1e-2, 1e-3)
STABLE = 2.7
"""Largest ``dt x fastest rate`` of Runge-Kutta."""

COLUMNS = {
    "method": "<11s",
    "setting": "<34s",
    "disks": "5d",
    "damping_percent": "15g",
    "rpm": "6.0f",
    "error": "8.1e",
    "seconds": "9.4f",
    "compile_seconds": "15.1f",
    "cycles": "6d",
    "closure": "8.0e",
    "branch": "<8s",
    "status": "<20s",
}


class Case:
    """One train at one speed with its references, and where rows go."""

    def __init__(self, train, rpm, damping, options, recorder):
        self.train = train
        self.rpm = rpm
        self.damping = damping
        self.options = options
        self.recorder = recorder
        self.task = prepare(train, rpm)
        quick = {"steps": 24000} if options.quick else {}
        self.references, self.notes = references(
            train, rpm, self.task, budget=options.budget, **quick
        )

    @property
    def small(self):
        """Whether methods with dense matrices of all disks are tried."""
        return self.train.topology.n_disks <= 60

    def add(self, method, setting, force=None, **row):
        """Record a row; the error is measured here."""
        error, branch = (
            distance(self.references, force) if force is not None else (np.nan, "")
        )
        if not self.references:
            branch = "no reference"
        self.recorder.add(
            method=method,
            setting=", ".join(f"{key} {value:g}" for key, value in setting.items()),
            settings=setting,
            disks=self.train.topology.n_disks,
            damping_percent=self.damping,
            rpm=self.rpm,
            error=error,
            branch=branch,
            references=[
                (r.branch, r.source, r.periodicity_error) for r in self.references
            ],
            without=self.notes,
            **row,
        )

    def marched(self, method, setting, found):
        """Record a march."""
        aim = setting.get("aim")
        if not found.finite:
            status = "diverged"
        elif aim is None or found.periodicity_error <= aim:
            status = "settled" if aim else "fixed cycles"
        else:
            status = "never settles" if found.cycles >= 100 else "out of time"
        self.add(
            method,
            setting,
            found.force,
            seconds=found.seconds,
            seconds_per_step=found.seconds_per_step,
            cycles=found.cycles,
            periodicity_error=found.periodicity_error,
            status=status,
        )


def harmonic(case):
    """``jaxhb.solve`` from a cold start at rising tolerance."""
    for tolerance in TOLERANCES[1:2] if case.options.quick else TOLERANCES:
        _solved(case, "jaxhb", {"tolerance": tolerance}, tolerance=tolerance)


def chain(case):
    """The full chain sweep with all disks as unknowns; its limit of 128 harmonics lies
    below the mesh modes.
    """
    for harmonics in (48,) if case.options.quick else (64, 128):
        if case.small:
            _solved(
                case,
                "chain",
                {"harmonics": harmonics},
                harmonics=harmonics,
                method="chain",
            )
        else:
            case.add(
                "chain", {"harmonics": harmonics}, status="dense blocks: not tried"
            )


def _solved(case, label, setting, **wanted):
    response, first, seconds, spread = timed(
        lambda: jaxhb.solve(case.train, rpm=case.rpm, **wanted), case.options.repeats
    )
    count = max(8192, 8 * response.harmonics)
    case.add(
        label,
        setting,
        case.task.force(response.deflection_samples(count)),
        seconds=seconds,
        spread=spread,
        compile_seconds=first - seconds,
        status=jaxhb.Status(int(response.status)).name,
        harmonics=response.harmonics,
        estimate=float(response.truncation_error),
        path=[str(event) for event in response.path],
    )


def runge_kutta(case):
    """Compiled explicit Runge-Kutta."""
    least = int(np.ceil(case.task.period * fastest_rate(case.task) / STABLE))
    counts = sorted({max(steps, least) for steps in STEPS})
    if least > 5e6:
        begun = _pace(case, least)
        note = {
            "seconds_per_cycle": begun * least,
            "seconds_per_step": begun,
            "status": "step too small",
        }
        case.add("rk4", {"steps": least}, seconds=6 * begun * least, cycles=6, **note)
        return
    _marches(case, "rk4", counts[::4] if case.options.quick else counts)


def _pace(case, steps):
    """Seconds of a Runge-Kutta step, from a few hundred."""
    task = case.task
    x, v, table = task.displacement.copy(), task.velocity.copy(), task.table(512)
    seen = np.empty((2, task.model.mesh_k.size, 256))
    return (
        timed(
            lambda: runge_kutta_steps(
                task.model, x, v, table, task.period / steps, *seen
            ),
            3,
        )[2]
        / 256
    )


def implicit(case):
    """Compiled implicit integrator along the tree."""
    _marches(
        case, "implicit", IMPLICIT_STEPS[2:3] if case.options.quick else IMPLICIT_STEPS
    )


def _marches(case, method, counts):
    march(case.task, method, 16, cycles=1)
    budget = case.options.budget
    for steps in counts:
        for aim in AIMS[:1] if case.options.quick else AIMS:
            found = _median(
                lambda s=steps, a=aim: march(
                    case.task, method, s, aim=a, budget=budget
                ),
                case.options,
            )
            case.marched(method, {"steps": steps, "aim": aim}, found)
        if case.damping >= 6:
            found = _median(
                lambda s=steps: march(case.task, method, s, cycles=6, budget=budget),
                case.options,
            )
            case.marched(method, {"steps": steps, "cycles": 6}, found)


def _median(run, options):
    """The march of median duration; one that takes long is not repeated."""
    runs = [run()]
    while len(runs) < options.repeats and runs[0].seconds < options.budget / 20:
        runs.append(run())
    return sorted(runs, key=lambda found: found.seconds)[len(runs) // 2]


def exponential(case):
    """The package's modal exponential integrator, one speed a call, all that the call
    does counts.
    """
    for steps in (4000,) if case.options.quick else (2000, 4000, 8000):
        if not case.small:
            case.add("exponential", {"steps": steps}, status="dense state: not tried")
            continue
        for cycles in (6,) if case.options.quick else (6, 30):
            _integrated(case, steps, cycles)


def _integrated(case, steps, cycles):
    orbit, first, seconds, spread = timed(
        lambda: jaxhb.integrate(case.train, rpm=case.rpm, cycles=cycles, steps=steps),
        case.options.repeats,
    )
    case.add(
        "exponential",
        {"steps": steps, "cycles": cycles},
        orbit.elastic,
        seconds=seconds,
        spread=spread,
        compile_seconds=first - seconds,
        cycles=cycles,
        periodicity_error=orbit.periodicity_error,
        status="fixed cycles",
    )


def batched(cases):
    """The same over all speeds in one vmapped program; seconds per speed, the cutting
    into steps included.
    """
    if not cases[0].small:
        return
    for steps in (4000,) if cases[0].options.quick else (2000, 4000, 8000):
        for cycles in (6,) if cases[0].options.quick else (6, 30):
            deflection, periodicity_error, first, seconds = march_speeds(
                cases[0].train,
                [case.rpm for case in cases],
                steps,
                cycles,
                cases[0].options.repeats,
            )
            for case, seen, change in zip(
                cases, deflection, periodicity_error, strict=True
            ):
                case.add(
                    "exp. batch",
                    {"steps": steps, "cycles": cycles, "speeds": len(cases)},
                    case.task.force(seen),
                    seconds=seconds / len(cases),
                    compile_seconds=first - seconds,
                    cycles=cycles,
                    periodicity_error=float(change),
                    status="fixed cycles",
                )


def adaptive(case):
    """Adaptive integrators of diffrax and scipy for six cycles."""
    if not case.small:
        case.add("adaptive", {}, status="dense state: not tried")
        return
    quick = case.options.quick
    explicit = [
        (solver, rtol) for solver in ("Tsit5", "Dopri8") for rtol in (1e-3, 1e-5, 1e-7)
    ]
    for solver, rtol in [("Tsit5", 1e-5)] if quick else explicit:
        seen, first, seconds = diffrax_march(case.task, solver, rtol, 6, 4000, 1)
        _adapted(case, solver, rtol, seen, seconds, compile_seconds=first - seconds)
    compiled = [("LSODA", 1e-4), ("LSODA", 1e-6), ("DOP853", 1e-5)]
    for solver, rtol in compiled[:1] if quick else compiled:
        seen, seconds = scipy_march(case.task, solver, rtol, 6, 4000)
        _adapted(case, solver, rtol, seen, seconds)


def _adapted(case, method, rtol, seen, seconds, **row):
    force = case.task.force(seen)
    status = "fixed cycles" if np.isfinite(force).all() else "diverged"
    case.add(
        method,
        {"rtol": rtol, "cycles": 6},
        force,
        seconds=seconds,
        cycles=6,
        status=status,
        **row,
    )


METHODS = {
    "harmonic": harmonic,
    "rk4": runge_kutta,
    "implicit": implicit,
    "exponential": exponential,
    "adaptive": adaptive,
    "chain": chain,
}


def summary(rows, limits=(3e-2, 1e-2, 3e-3)):
    """Print the least time of each method to an error, median over the speeds, and
    where it was reached.
    """
    print(
        "\nleast seconds to an error, median over the speeds (reached at so many of"
        " them; x: time / that of jaxhb)"
    )
    for key in dict.fromkeys((r["disks"], r["damping_percent"]) for r in rows):
        own = [
            r
            for r in rows
            if (r["disks"], r["damping_percent"]) == key and np.isfinite(r["error"])
        ]
        speeds = {r["rpm"] for r in rows if (r["disks"], r["damping_percent"]) == key}
        for method in dict.fromkeys(r["method"] for r in own):
            cells = []
            for limit in limits:
                mine = _fastest(own, method, limit)
                base = _fastest(own, "jaxhb", limit)
                ratio = [mine[s] / base[s] for s in mine if s in base]
                time = (
                    f"{np.median(list(mine.values())):9.4f} s"
                    f" ({len(mine)}/{len(speeds)})"
                    if mine
                    else "-"
                )
                cells.append(
                    f"{limit:.1%}: {time:>17s}"
                    + (f" x {np.median(ratio):7.2g}" if ratio else " " * 10)
                )
            print(f"{key[0]:5d} disks {key[1]:4g} %  {method:12s} " + "  ".join(cells))
        _predicted(rows, key, _fastest(own, "jaxhb", limits[1]))


def _predicted(rows, key, base):
    """Print what Runge-Kutta would take where its stable step is too small to be
    tried.
    """
    seconds = {
        r["rpm"]: r["seconds"]
        for r in rows
        if (r["disks"], r["damping_percent"]) == key and r["status"] == "step too small"
    }
    if seconds:
        ratio = [seconds[s] / base[s] for s in seconds if s in base]
        told = f", x {np.median(ratio):.2g} of jaxhb at {1e-2:.1%}" if ratio else ""
        cycles = (
            f"{np.median(list(seconds.values())):.0f} s for six cycles of its largest"
            " stable step"
        )
        print(f"{key[0]:5d} disks {key[1]:4g} %  rk4 would take {cycles}{told}")


def _fastest(rows, method, limit):
    """Seconds by speed of the fastest row of a method with an error within
    ``limit``.
    """
    found = {}
    for r in rows:
        if (
            r["method"] == method
            and r["error"] <= limit
            and r["status"] not in ("never settles", "out of time")
        ):
            found[r["rpm"]] = min(found.get(r["rpm"], np.inf), r["seconds"])
    return found


def main():
    """Run what the command line asks for."""
    parser = command_line(
        __doc__, core=0, repeats=5, quick="one speed, one damping ratio, few settings"
    )
    parser.add_argument(
        "--disks",
        type=int,
        nargs="+",
        default=[27],
        help="disks of the train: 27, 300, 3000",
    )
    parser.add_argument(
        "--damping",
        type=float,
        nargs="+",
        default=[6, 2, 1],
        help="tooth damping ratio in %%",
    )
    parser.add_argument("--rpm", type=float, nargs="+", default=list(HAMMERING_RPM))
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument(
        "--budget",
        type=float,
        default=60.0,
        help="seconds after which a march begins no other cycle",
    )
    options = parser.parse_args()
    if options.quick:
        options.repeats = 1
        options.rpm = options.rpm[2:3] or options.rpm[:1]
        options.damping = options.damping[:1]
    recorder = started("work-precision", options, COLUMNS)
    for disks in options.disks:
        for damping in options.damping:
            train = with_tooth_damping(refined("gear_train_30", disks), damping / 100)
            cases = [
                Case(train, rpm, damping, options, recorder) for rpm in options.rpm
            ]
            for case in cases:
                for method in options.methods:
                    METHODS[method](case)
            if "exponential" in options.methods:
                batched(cases)
    summary(recorder.rows)


if __name__ == "__main__":
    main()
