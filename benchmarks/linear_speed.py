"""Linear forced response: 1000 speeds x 24 orders of 30 disks beside numpy and
openTorsion; long chains.

    python benchmarks/linear_speed.py                      both parts, a minute
    python benchmarks/linear_speed.py sweep chain          some of them
    python benchmarks/linear_speed.py --json rows.jsonl

One core, medians of repeats after a first call that compiles. ``error`` is the largest
difference of an angle from the dense solution refined in extended precision, over the
largest angle; ``balance`` the power that is not turned into heat, over what is brought
in. openTorsion gets the meshes as its ElasticGear and all frequencies in one call of
its ``ss_response``: it gives angles, jaxhb torques, powers and residuals as well. The
chain is free at both ends, 64 harmonics at one speed; the exponent is the slope of log
time over log size.
"""

import json
from pathlib import Path

import numpy as np
from branched_thirty import MESH, branched_thirty, numpy_angles
from records import command_line, exponent, run_parts, timed

import jaxhb
from jaxhb.train.excitation import excitation

DATA = Path(__file__).parents[1] / "tests" / "data" / "branched_30_disk_linear.json"
COLUMNS = {
    "part": "<6s",
    "method": "<24s",
    "disks": "6d",
    "speeds": "6d",
    "harmonics": "9d",
    "seconds": "8.4f",
    "spread": "7.4f",
    "first_seconds": "13.2f",
    "build_seconds": "13.2f",
    "error": "8.1e",
    "balance": "8.1e",
}
SIZES = 1250, 2500, 5000, 10_000, 20_000, 40_000
LONG = 5000
"""Disks from which the exponent is taken: shorter chains stay in the cache of a
processor.
"""


def unbalanced(response):
    """Largest share of the power brought in that the elements do not turn into heat."""
    heat = response.disk_power.sum(-1) + response.link_power.sum(-1)
    return float(np.max(np.abs(heat / response.input_power - 1)))


def sweep(recorder, options):
    """1000 speeds, by the forced response and by numpy."""
    data = json.loads(DATA.read_text())
    train, rpm = branched_thirty(data), np.linspace(*data["speeds"])
    refined = numpy_angles(train, rpm, refinements=3)
    sizes = {
        "part": "sweep",
        "disks": 30,
        "speeds": len(rpm),
        "harmonics": len(data["orders"]),
    }
    found, first, seconds, spread = timed(
        lambda: jaxhb.forced_response(train, rpm=rpm), options.repeats
    )
    dense, _, dense_seconds, dense_spread = timed(
        lambda: numpy_angles(train, rpm), min(options.repeats, 3)
    )
    angles = found.angles[..., 1:]
    largest = np.abs(refined).max()
    recorder.add(
        **sizes,
        method="forced_response",
        seconds=seconds,
        spread=spread,
        first_seconds=first,
        error=float(np.abs(angles - refined).max() / largest),
        balance=unbalanced(found),
        apart_from_numpy=float(np.abs(angles - dense).max() / largest),
    )
    error = float(np.abs(dense - refined).max() / largest)
    recorder.add(
        **sizes,
        method="numpy, batched solve",
        seconds=dense_seconds,
        spread=dense_spread,
        error=error,
    )
    try:
        call = opentorsion_angles(data, train, rpm)
    except ImportError:
        print("openTorsion is not installed: pip install opentorsion")
        return
    peer, _, peer_seconds, peer_spread = timed(call, min(options.repeats, 3))
    error = float(
        np.abs(np.abs(peer) - np.abs(refined)).max() / largest
    )  # its gears turn against each other
    recorder.add(
        **sizes,
        method="openTorsion, ss_response",
        seconds=peer_seconds,
        spread=peer_spread,
        error=error,
    )


def opentorsion_angles(data, train, rpm):
    """A function that computes the angles ``(n, S, orders)`` by openTorsion."""
    from opentorsion.assembly import Assembly
    from opentorsion.elements.disk_element import Disk
    from opentorsion.elements.elastic_gear_element import ElasticGear
    from opentorsion.elements.shaft_element import Shaft

    gears = {}
    for row in data[
        "gears"
    ]:  # teeth of N/m are springs of N m/rad on the parent's radius; radii in mm
        parent = gears.get(row["parent"])
        square = 0.0 if parent is None else (1e-3 * parent.R) ** 2
        own = {"k": MESH["stiffness"] * square, "c": MESH["damping"] * square}
        gears[row["node"]] = ElasticGear(
            row["node"], 0.0, row["R"], parent=parent, **own
        )
    shafts = [Shaft(s["n1"], s["n2"], k=s["k"], c=s["c"]) for s in data["shafts"]]
    disks = [Disk(d["node"], d["J"], c=d["c"]) for d in data["disks"]]
    model = Assembly(shafts, disks, elastic_gear_elements=list(gears.values()))
    orders = len(data["orders"])
    omega = (
        np.array(train.topology.cycle_frequency(rpm))[:, None]
        * np.arange(1, orders + 1)
    ).ravel()
    torque = np.asarray(excitation(train, float(rpm[0]), orders)[0])[
        :, 1:
    ]  # the same at all speeds
    loads = np.tile(torque, len(rpm))

    def call():
        angles, _ = model.ss_response(loads, omega)
        return angles.reshape(len(disks), len(rpm), orders).transpose(1, 0, 2)

    return call


def chain(recorder, options):
    """Free chains of many disks."""
    found = {}
    for disks in SIZES:
        parts = [
            jaxhb.Disk(name=str(i), inertia=1.0, damping=0.01) for i in range(disks)
        ]
        parts += [
            jaxhb.Shaft(between=(str(i), str(i + 1)), stiffness=1e6, damping=2.0)
            for i in range(disks - 1)
        ]
        parts.append(
            jaxhb.Torque(
                disk="0", harmonics=[(float(n), 1.0 / n, 0.3) for n in range(1, 65)]
            )
        )
        train, built, *_ = timed(
            lambda parts=parts: jaxhb.build(parts, revolutions_per_cycle=1), 1
        )
        response, first, seconds, spread = timed(
            lambda train=train: jaxhb.forced_response(train, rpm=60.0), options.repeats
        )
        found[disks] = seconds
        recorder.add(
            part="chain",
            method="forced_response",
            disks=disks,
            speeds=1,
            harmonics=64,
            seconds=seconds,
            spread=spread,
            first_seconds=first,
            build_seconds=built,
            balance=unbalanced(response),
            residual=float(response.residual),
        )
    long = [disks for disks in SIZES if disks >= LONG]
    print(
        "seconds grow with the disks to the power"
        f" {exponent(long, [found[disks] for disks in long]):.2f}"
    )


PARTS = {"sweep": sweep, "chain": chain}


def main():
    """Run what the command line asks for."""
    run_parts("linear_speed", command_line(__doc__, core=0, repeats=9), PARTS, COLUMNS)


if __name__ == "__main__":
    main()
