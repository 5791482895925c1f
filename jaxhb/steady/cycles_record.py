"""The record of a march: the numbers of its recorded cycles, quantity by quantity."""

import dataclasses

import numpy as np

from jaxhb.equations.kinematics import speed_ratios
from jaxhb.results.record import Record, RecordedSignal, SteadyContact


def record_of(equations, march):
    """The :class:`~jaxhb.results.record.Record` of a march's recorded cycles."""
    topology, signals = equations.train.topology, _signals(march, equations.train.topology.revolutions_per_cycle)
    shafts, own, linear = equations.shafts, len(equations.own), len(equations.linear)

    def take(count):
        return tuple(next(signals) for _ in range(count))

    disks, rates = take(topology.n_disks), take(topology.n_disks)
    twists, twist_rates, torques = take(shafts), take(shafts), take(shafts)
    stiffness, radius = np.asarray(equations.system.stiffness), np.asarray(equations.system.radius)
    ends = radius[equations.system.tree.end_a]
    torques = tuple(
        dataclasses.replace(torque, elastic_part=twist.scaled(k * r**2))
        for torque, twist, k, r in zip(torques, twists, stiffness[:shafts], ends[:shafts], strict=True)
    )
    deflections, forces = [None] * (own + linear), [None] * (own + linear)
    straight = take(linear), take(linear)
    for index, deflection, force in zip(equations.linear, *straight, strict=True):
        deflections[index] = deflection
        elastic = deflection.scaled(stiffness[shafts + index])
        forces[index] = dataclasses.replace(force, elastic_part=elastic)
    for index, deflection, elastic, total in zip(equations.own, take(own), take(own), take(own), strict=True):
        deflections[index], forces[index] = deflection, dataclasses.replace(total, elastic_part=elastic)
    count = len(equations.gears)
    total, elastic = take(count), take(count)
    gears = (dataclasses.replace(t, elastic_part=e) for t, e in zip(total, elastic, strict=True))
    contacts = _contacts(equations, march, forces)
    gears = dict(zip(equations.gears, gears, strict=True))
    turning = 2 * np.pi / 60 * march.rpm * speed_ratios(equations.train)[np.array(topology.rotor, dtype=int)]
    speeds = tuple(rate.shifted(mean) for rate, mean in zip(rates, turning, strict=True))
    heat = _heat(equations, topology.cycle_frequency(march.rpm), ends[:shafts], twists, twist_rates)
    found = tuple(deflections), tuple(forces), gears, contacts
    return Record(topology, march.recorded, disks, speeds, twists, torques, *found, heat)


def _heat(equations, frequency, ends, twists, rates):
    """Mean power in W that shafts and dampers turn into heat: viscous from the rates, loss factors from the orders."""
    viscous, loss = np.asarray(equations.system.viscous), np.asarray(equations.system.loss * equations.system.stiffness)
    found = []
    for k, (radius, twist, rate) in enumerate(zip(ends, twists, rates, strict=True)):
        lossy = frequency * np.sum(np.arange(1, len(twist.amplitudes) + 1) * twist.amplitudes**2) / 2
        found.append(float(radius**2 * (viscous[k] * rate.rms**2 + loss[k] * lossy)))
    return tuple(found)


def _signals(march, revolutions):
    """The quantities of a record, one after another."""
    numbers = {
        name: np.concatenate([getattr(part, name) for part in march.statistics])
        for name in ("max", "min", "mean", "square")
    }
    power = sum(part.power for part in march.statistics) / march.recorded
    for i in range(len(power)):
        yield RecordedSignal(
            highest=numbers["max"][:, i],
            lowest=numbers["min"][:, i],
            mean=float(numbers["mean"][:, i].mean()),
            rms=float(np.sqrt(numbers["square"][:, i].mean())),
            amplitudes=2 * np.sqrt(power[i, 1:]),
            revolutions_per_cycle=revolutions,
        )


def _contacts(equations, march, forces):
    """:class:`SteadyContact` of every mesh."""
    above, below, impacts, hardest = (
        np.concatenate([getattr(part, name) for part in march.contacts])
        for name in ("above", "below", "impacts", "hardest")
    )
    found = [SteadyContact(0.0, 0.0, 0.0, 0.0, int(np.sign(force.mean))) for force in forces]
    for g, index in enumerate(equations.own):
        shares = above[:, g].mean(), below[:, g].mean()
        drive = int(np.sign(forces[index].mean))
        reverse = shares[0] if drive < 0 else shares[1]
        found[index] = SteadyContact(
            float(1 - sum(shares)), float(reverse), float(impacts[:, g].mean()), float(hardest[:, g].max()), drive
        )
    return tuple(found)
