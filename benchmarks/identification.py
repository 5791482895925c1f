"""Identification from synthetic measurements: are true numbers inside their intervals,
and is the weak cylinder found?

    python benchmarks/identification.py [--fits 100] [--cylinders 20] [--seed 1]
    python benchmarks/identification.py published     the published curves of the six-cylinder diesel

*fits*: eight numbers of ``six_cylinder_diesel`` are drawn within 20 % of the scene's;
ten orders of the torque before the flywheel, the angle of the pulley and the speed of
the flywheel at 15 speeds, with 3 % noise in amplitude and phase, are fitted from the
scene's own numbers. Counted are true numbers inside 95 % intervals, one by one and all
at once. *cylinders*: one cylinder drawn at random has 70 % of its gas torque, orders
0.5 to 3 of the flywheel's speed, with and without phases. *published*: sums of
amplitudes of two shafts over the speed, digitised (``--curves``).
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

import jaxhb
from jaxhb.design import Measured, Parameter, identify, weak_cylinder

SCENE, RPM = "six_cylinder_diesel", np.linspace(1000.0, 2400.0, 15)
ORDERS = 0.5, 1.5, 2.5, 3.0, 3.5, 4.5, 5.5, 6.0, 7.5, 9.0
NAMES = (
    "cyl6|flywheel.stiffness",
    "gear train|cyl1.stiffness",
    "cyl3|cyl4.stiffness",
    "cyl3|cyl4.loss_factor",
    "pulley.inertia",
    "flywheel.inertia",
    "cyl6.inertia",
    "cylinder 3.gas_factor",
)


def measure(truth, rng, what, orders, noise, phases=True):
    """Rows of a train with noise."""
    response = jaxhb.forced_response(truth, rpm=RPM)
    rows = []
    for quantity, element in what:
        signal = {
            "torque": response.torque,
            "angle": response.disk,
            "speed": response.speed,
        }[quantity](element)
        for order in orders:
            own = 2 * np.asarray(signal.coefficients)[:, round(2 * order)]
            rows += [
                (rpm, order, element, quantity, c)
                for rpm, c in zip(RPM, own, strict=True)
            ]
    rpm, order, element, quantity, c = zip(*rows, strict=True)
    c = np.array(c) * (
        1 + noise * (rng.normal(size=len(c)) + 1j * rng.normal(size=len(c)))
    )
    phase = np.rad2deg(np.angle(c)) if phases else np.full(len(c), np.nan)
    return Measured(np.array(rpm), np.array(order), element, quantity, np.abs(c), phase)


def fits(count, seed):
    """How often true numbers lie inside their intervals."""
    train = jaxhb.load_scene(SCENE).replace({NAMES[-1]: 1.0})
    own = np.array([float(train.value(name)) for name in NAMES])
    parameters = [
        Parameter(name=n, low=0.5 * v, high=2 * v)
        for n, v in zip(NAMES, own, strict=True)
    ]
    what = ("torque", "cyl6|flywheel"), ("angle", "pulley"), ("speed", "flywheel")
    inside = []
    opened = []
    off = []
    begin = time.perf_counter()
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        true = own * rng.uniform(0.8, 1.2, len(own))
        rows = measure(
            train.replace(dict(zip(NAMES, true, strict=True))), rng, what, ORDERS, 0.03
        )
        found = identify(train, rows, parameters=parameters)
        inside.append(found.within(true))
        opened += found.open
        off.append(found.std / found.values)
    inside = np.array(inside)
    print(f"seed {seed}, {count} fits, {time.perf_counter() - begin:.0f} s")
    for name, share, deviation in zip(
        NAMES, inside.mean(axis=0), np.median(off, axis=0), strict=True
    ):
        told = opened.count(name)
        print(
            f"  {name:28s} inside {100 * share:3.0f} %, deviation"
            f" {100 * deviation:5.2f} %, told as open {told}"
        )
    print(
        f"all numbers: {100 * inside.mean():.1f} % inside; all eight of a fit at once"
        f" in {inside.all(axis=1).sum()}"
    )


def cylinders(count, seed):
    """How often the weak cylinder is named first."""
    train = jaxhb.load_scene(SCENE)
    names = train.topology.cylinder_names
    for phases in (True, False):
        first = among = 0
        for k in range(count):
            rng = np.random.default_rng([seed, 1000 + k])
            weak = names[rng.integers(len(names))]
            truth = train.replace(
                {f"{name}.injection": 0.7 if name == weak else 1.0 for name in names}
            )
            rows = measure(
                truth,
                rng,
                [("speed", "flywheel")],
                np.arange(0.5, 3.5, 0.5),
                0.03,
                phases,
            )
            found = weak_cylinder(train, rows)
            first += found.names[0] == weak
            among += weak in found.likely
        print(
            f"{'with' if phases else 'without'} phases: right in {first} of {count},"
            f" among the likely in {among}"
        )


def published(path):
    """The curves of Mendes et al. 2008: fitted numbers beside theirs."""
    data = json.loads(Path(path).read_text(encoding="utf-8"))
    rows = []
    for key, shaft in (
        ("published_fig31_flywheel_cyl6_Nm", "cyl6|flywheel"),
        ("published_fig32_pulley_geartrain_Nm", "pulley|gear train"),
    ):
        rows += [
            (rpm, np.nan, shaft, "torque", value, np.nan)
            for rpm, value in data[key]
            if rpm <= 2400
        ]
    rpm, order, element, quantity, amplitude, phase = zip(*rows, strict=True)
    rows = Measured(
        np.array(rpm),
        np.array(order),
        element,
        quantity,
        np.array(amplitude),
        np.array(phase),
    )
    train = jaxhb.load_scene(SCENE)
    names = (
        "cyl6|flywheel.stiffness",
        "cyl6|flywheel.loss_factor",
        "pulley.inertia",
        "pulley|gear train.loss_factor",
    )
    own = [float(train.value(name)) for name in names]
    parameters = [
        Parameter(name=n, low=v / 3, high=3 * v)
        for n, v in zip(names, own, strict=True)
    ]
    found = identify(train, rows, parameters=parameters, noise=0.05)
    for name, before, value, std in zip(
        names, found.before, found.values, found.std, strict=True
    ):
        print(
            f"  {name:30s} published {before:10.4g}, fitted {value:10.4g} +- {std:.2g}"
        )
    for shaft in dict.fromkeys(element):
        own = np.array([name == shaft for name in element])
        for said, computed in (
            ("published numbers", found.before_computed),
            ("fitted", found.computed),
        ):
            off = np.abs(computed[own]) / rows.amplitude[own] - 1
            middle = 100 * np.median(np.abs(off))
            most = 100 * np.abs(off).max()
            print(
                f"  {shaft:18s} {said:18s} median off {middle:.1f} %, largest"
                f" {most:.0f} %"
            )
    print(f"open: {found.open}, misfit {found.misfit:.2f}, alike {found.alike()}")


def main():
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", nargs="?", choices=("published",))
    parser.add_argument("--fits", type=int, default=100)
    parser.add_argument("--cylinders", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--curves", default="tests/data/six_cylinder_diesel_2008.json")
    asked = parser.parse_args()
    if asked.what:
        published(asked.curves)
    else:
        fits(asked.fits, asked.seed)
        cylinders(asked.cylinders, asked.seed)


if __name__ == "__main__":
    main()
