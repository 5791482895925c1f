"""The extremes of every number, each with the outcome that is expected of it.

Most are one small train, a motor that hammers a mill through one pair of gears, with
one number out of the common. What is expected is a set of statuses or a fragment of the
sentence of an error. A converged status has to agree with a second way to the same
answer: shooting, or twice the harmonics where the train cannot be integrated in time.
"""

import dataclasses
import time
from dataclasses import dataclass, field

import jax
import numpy as np

import jaxhb
from jaxhb import (
    Cylinder,
    Damper,
    Disk,
    Ground,
    Load,
    Mesh,
    SceneError,
    Shaft,
    Status,
    Torque,
)

AGREEMENT = 0.03
"""Of the elastic tooth force with the second way: three times the default tolerance."""

CONVERGED = frozenset({"CONVERGED"})
RESOLVED = CONVERGED | {"TOLERANCE_NOT_MET"}
HONEST = RESOLVED | {"MAX_STEPS", "STALLED", "NEAR_SINGULAR"}
"""Any outcome that says what happened; a converged one still has to agree."""

GROUND = [Ground(disk="motor", stiffness=1e-9)]


@dataclass(frozen=True)
class Extreme:
    """One extreme: ``run()`` gives a response or a finding; ``expected`` are statuses
    or a fragment of a sentence.

    ``check`` tells how a converged response is judged: "shooting", "harmonics" (twice
    as many) or "none".
    """

    name: str
    made: str
    run: object
    expected: object
    check: str = "shooting"
    quick: bool = True


@dataclass(frozen=True)
class Found:
    """Outcome of a check that is no single response."""

    status: str
    detail: str = ""
    wrong: bool = field(default=False)


def parts(
    *,
    coupling=0.004,
    shaft=(2e4, 4e4),
    drag=4.0,
    mean=8.0,
    amplitude=60.0,
    holds=None,
    gear=0.002,
    **mesh,
):
    """Motor, coupling, pinion, wheel and mill; ``mesh`` overrides fields of the
    mesh.
    """
    law = {"stiffness": 2e8, "damping": 800.0, "backlash": 1e-4} | mesh
    return [
        Disk(name="motor", inertia=0.05, damping=0.05),
        Disk(name="coupling", inertia=coupling),
        Disk(name="pinion", inertia=gear, radius=0.04),
        Disk(name="wheel", inertia=0.01, radius=0.07),
        Disk(name="mill", inertia=0.1, damping=0.1),
        Shaft(between=("motor", "coupling"), stiffness=shaft[0], damping=drag),
        Shaft(between=("coupling", "pinion"), stiffness=shaft[0], damping=drag),
        Shaft(between=("wheel", "mill"), stiffness=shaft[1], damping=drag),
        Mesh(between=("pinion", "wheel"), **law),
        Torque(
            disk="motor",
            mean=mean,
            harmonics=tuple((float(k), amplitude / k, 5.0 * k) for k in (1, 2, 3, 4)),
        ),
        *(holds or [Load(disk="mill")]),
    ]


def built(elements):
    """A train of :func:`parts`."""
    return jaxhb.build(
        elements, name="motor and mill", reference="motor", revolutions_per_cycle=1
    )


def solved(rpm=2400.0, *, options=(), **changes):
    """Solve :func:`parts` with some numbers changed."""
    return lambda: jaxhb.solve(built(parts(**changes)), rpm=rpm, **dict(options))


def chain_of(disks, *, inertia):
    """The train with the mill's shaft cut into pieces that together are as soft, damped
    and heavy as the whole one.

    With ``inertia`` 0 the pieces change nothing, and the tooth force is that of the
    train of five disks.
    """
    count = disks - 4
    elements = [e for e in parts() if getattr(e, "between", None) != ("wheel", "mill")]
    names = ["wheel", *(f"piece {k}" for k in range(1, count)), "mill"]
    elements += [Disk(name=name, inertia=inertia / (count - 1)) for name in names[1:-1]]
    pairs = zip(names[:-1], names[1:], strict=True)
    return built(
        [
            *elements,
            *(
                Shaft(between=p, stiffness=4e4 * count, damping=4.0 * count)
                for p in pairs
            ),
        ]
    )


def pieces_change_nothing(disks=3000):
    """Massless pieces of a shaft against the whole shaft."""
    whole = jaxhb.solve(built(parts()), rpm=2400.0)
    cut = jaxhb.solve(chain_of(disks, inertia=0.0), rpm=2400.0)
    change = difference(whole, cut)
    return Found(
        Status(int(cut.status)).name, f"force differs by {change:.1e}", change > 1e-6
    )


def two_disks(mean):
    """Two gears alone."""
    rows = ((1.0, 30.0, 0.0), (2.0, 10.0, 4.0))
    elements = [
        Disk(name=name, inertia=0.002, radius=0.04) for name in ("pinion", "wheel")
    ]
    elements += [
        Mesh(between=("pinion", "wheel"), stiffness=2e8, damping=800.0, backlash=1e-4),
        Load(disk="wheel"),
    ]
    train = jaxhb.build(
        [*elements, Torque(disk="pinion", mean=mean, harmonics=rows)],
        reference="pinion",
    )
    return jaxhb.solve(train, rpm=2400.0)


def silent():
    """A train that nothing drives."""
    return jaxhb.solve(
        built([e for e in parts() if not isinstance(e, Torque)]), rpm=2400.0
    )


def at_resonance(backlash):
    """An undamped pair of disks excited exactly at its natural frequency, through a
    shaft or through teeth.
    """
    link = [Mesh(between=("a", "b"), stiffness=1e6, backlash=1e-4)] if backlash else []
    link = link or [Shaft(between=("a", "b"), stiffness=1e4)]
    disks = [
        Disk(name=name, inertia=0.01, radius=0.1 if backlash else None) for name in "ab"
    ]
    rows = ((1.0, 10.0, 0.0),)
    torques = [Torque(disk="a", mean=20.0, harmonics=rows), Load(disk="b")]
    train = jaxhb.build(
        [*disks, *link, *torques], reference="a", revolutions_per_cycle=1
    )
    return jaxhb.solve(
        train, rpm=60 * jaxhb.natural_frequencies(train).frequencies_hz[-1]
    )


def in_float32():
    """Every array of the train and the speed in single precision: the numbers are
    rounded, the arithmetic is not.
    """
    train = built(parts())
    single = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=np.float32), train)
    same = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=np.float64), single)
    response = jaxhb.solve(single, rpm=np.float32(2400))
    wanted = jaxhb.solve(same, rpm=2400.0)
    change = difference(response, wanted)
    double = all(
        a.dtype in (np.float64, np.complex128)
        for a in (response.forces, response.angles, response.residual)
    )
    detail = (
        f"differs by {change:.1e} from the same numbers in double precision, results"
        f" double: {double}"
    )
    return Found(Status(int(response.status)).name, detail, not double or change > 1e-8)


def one_of_each():
    """One element of each kind, with a number in every field."""
    gas = ((0.5, 3.0, 4.0), (1.0, 5.0, -2.0))
    return [
        *parts(
            epsilon=1e-3,
            transition=0.04,
            holds=[Ground(disk="motor", stiffness=10.0), Load(disk="mill", share=1.0)],
        ),
        Damper(
            name="ring",
            disk="motor",
            inertia=0.01,
            damping=2.0,
            stiffness=1e3,
            loss_factor=0.01,
        ),
        Cylinder(
            disk="motor",
            bore=0.1,
            stroke=0.12,
            rod=0.2,
            reciprocating_mass=1.0,
            gas_torque_mean=3.0,
            gas_torque=gas,
        ),
        Torque(
            disk="coupling",
            mean=1.0,
            harmonics=((1.0, 2.0, 3.0),),
            scale=((500.0, 0.5), (3000.0, 1.0)),
            name="extra",
        ),
    ]


def numbers_of(element):
    """Fields of an element that hold numbers, and the same with one number replaced."""
    for f in dataclasses.fields(element):
        value = getattr(element, f.name)
        if f.metadata["kind"] in ("number", "count") and value is not None:
            yield f.name, lambda bad: bad
        elif f.metadata["kind"] == "rows" and value:
            for row in (0, -1):
                for column in range(len(value[0])):
                    yield f"{f.name}[{row}][{column}]", _with_entry(value, row, column)


def _with_entry(rows, row, column):
    def changed(bad):
        table = [list(r) for r in rows]
        table[row][column] = bad
        return tuple(tuple(r) for r in table)

    return changed


def refused_when_built():
    """NaN and infinities in every number of a scene."""
    elements = one_of_each()
    let_through = []
    count = 0
    jaxhb.build(elements, reference="motor")
    for i, element in enumerate(elements):
        for name, change in numbers_of(element):
            for bad in (np.nan, np.inf, -np.inf):
                count += 1
                changed = dataclasses.replace(
                    element, **{name.split("[")[0]: change(bad)}
                )
                try:
                    jaxhb.build(
                        [*elements[:i], changed, *elements[i + 1 :]], reference="motor"
                    )
                    let_through.append(f"{type(element).__name__}.{name} = {bad}")
                except SceneError:
                    pass
    return Found(
        "let through" if let_through else "refused",
        f"{count} numbers; {'; '.join(let_through)}",
    )


def refused_when_replaced():
    """NaN and infinities through ``train.replace``."""
    train = jaxhb.build(one_of_each(), reference="motor")
    let_through = []
    count = 0
    for name, (kind, _) in train.topology.elements.items():
        attribute = {"mesh": "meshes"}.get(kind, f"{kind}s")
        table = getattr(train, attribute)
        for f in (
            f for f in dataclasses.fields(table) if getattr(table, f.name) is not None
        ):  # None: nothing has it
            shape = np.shape(train.value(f"{name}.{f.name}"))
            for bad in (np.nan, np.inf, -np.inf) if np.prod(shape) else ():
                count += 1
                value = np.full(shape, bad)
                try:
                    train.replace({f"{name}.{f.name}": value})
                    let_through.append(f"{name}.{f.name} = {bad}")
                except SceneError:
                    pass
    return Found(
        "let through" if let_through else "refused",
        f"{count} numbers; {'; '.join(let_through)}",
    )


def traced_not_finite():
    """NaN and infinities that only the compiled program sees, one number of the train
    at a time.
    """
    elements = [
        (
            dataclasses.replace(e, scale=((500.0, 0.5), (3000.0, 1.0)))
            if isinstance(e, Torque)
            else e
        )
        for e in parts()
    ]
    train = built(
        [
            *elements,
            Damper(name="ring", disk="motor", inertia=0.01, damping=2.0, stiffness=1e3),
        ]
    )
    plan = jaxhb.plan(train, rpm=2400.0)
    leaves, tree = jax.tree.flatten(train)
    status = jax.jit(
        lambda leaves: jaxhb.solve(tree.unflatten(leaves), rpm=2400.0, plan=plan).status
    )
    sound = jax.tree_util.tree_flatten_with_path(train)[0]
    let_through = []
    count = 0
    for i, (path, leaf) in enumerate(sound):
        if not np.size(leaf) or np.asarray(leaf).dtype.kind != "f":
            continue
        for bad in (np.nan, np.inf):
            count += 1
            worse = np.array(leaf)
            worse.flat[np.argmax(np.abs(worse))] = bad
            found = Status(int(status([*leaves[:i], worse, *leaves[i + 1 :]])))
            if found != Status.NONFINITE:
                let_through.append(
                    f"{jax.tree_util.keystr(path)} = {bad}: {found.name}"
                )
    return Found(
        "let through" if let_through else "NONFINITE",
        f"{count} numbers; {'; '.join(let_through)}",
    )


def pushed_far():
    """The teeth do not notice how far a soft ground lets the train turn, and time
    integration refuses 8e9 rad.
    """
    soft, firm = (
        solved(holds=[Ground(disk="motor", stiffness=k)])() for k in (1e-9, 1e-3)
    )
    change = difference(soft, firm)
    error = jaxhb.shooting_correction(firm).error
    try:
        jaxhb.shooting_correction(soft)
        return Found("time integration went through")
    except ValueError as refusal:
        refused = str(refusal)
    status = Status(max(int(soft.status), int(firm.status))).name
    detail = (
        f"1e-9 against 1e-3 N m/rad: {change:.1e}; there shooting: {error:.1e};"
        f" {refused}"
    )
    return Found(status, detail, wrong=change > AGREEMENT or not error < AGREEMENT)


def refused_arguments():
    """Speeds, tolerances and harmonics that are no numbers to solve with."""
    train = built(parts())
    let_through = []
    tries = [{"rpm": bad} for bad in (np.nan, np.inf, -np.inf, 0.0, -600.0)]
    tries += [{"rpm": 2400.0, "tolerance": bad} for bad in (np.nan, np.inf, -0.01)]
    tries += [
        {"rpm": 2400.0, "harmonics": bad} for bad in (np.nan, np.inf, 0, 32.5, 4097)
    ]
    for arguments in tries:
        try:
            found = jaxhb.solve(train, **arguments)
            let_through.append(f"{arguments}: {Status(int(found.status)).name}")
        except ValueError:
            pass
        except Exception as failure:  # noqa: BLE001
            let_through.append(f"{arguments}: {type(failure).__name__}: {failure}")
    return Found("let through" if let_through else "refused", "; ".join(let_through))


def difference(first, second):
    """Largest difference of the elastic tooth forces over the cycle / largest elastic
    tooth force.
    """
    a, b = (
        r.force(r.topology.mesh_names[0]).elastic.samples(16384)
        for r in (first, second)
    )
    return float(np.abs(a - b).max() / np.abs(a).max())


def second_way(response, check):
    """(how far the tooth force is from the second way to it, in words), NaN where that
    fails.
    """
    if check == "none" or not any(response.topology.mesh_backlash):
        return 0.0, ""
    if check == "shooting":
        found = jaxhb.shooting_correction(response)
        closed = found.orbit.settled
        return (
            found.error if closed else np.nan
        ), f"shooting{'' if closed else ' does not close'}: {found.error:.1e}"
    finer = jaxhb.solve(
        response.train,
        rpm=float(response.rpm),
        start=response,
        harmonics=2 * response.harmonics,
    )
    change = difference(response, finer)
    return (
        change,
        f"twice the harmonics ({Status(int(finer.status)).name}): {change:.1e}",
    )


def judged(extreme):
    """The row of one extreme."""
    begin = time.perf_counter()
    detail = ""
    wrong = False
    try:
        found = extreme.run()
        seconds = time.perf_counter() - begin
        if isinstance(found, Found):
            status = found.status
            detail = found.detail
            wrong = found.wrong
        else:
            status = Status(int(found.status)).name
            detail = (
                f"{found.harmonics} harmonics, estimate"
                f" {float(found.truncation_error):.1e}"
            )
            if status == "CONVERGED":
                change, words = second_way(found, extreme.check)
                wrong = change > AGREEMENT
                detail = f"{detail}, {words}"
    except Exception as error:  # noqa: BLE001
        seconds = time.perf_counter() - begin
        status = f"{type(error).__name__}: {error}"
    known = (
        extreme.expected in status
        if isinstance(extreme.expected, str)
        else status in extreme.expected
    )
    expected = (
        extreme.expected
        if isinstance(extreme.expected, str)
        else sorted(extreme.expected)
    )
    row = {
        "extreme": extreme.name,
        "made": extreme.made,
        "expected": expected,
        "found": status,
        "detail": detail,
    }
    return row | {
        "wrong": bool(wrong),
        "as_expected": bool(known and not wrong),
        "seconds": seconds,
    }


def extremes():
    """The table: name, how made, what is run, what is expected."""
    loaded = {"mean": 400.0, "amplitude": 20.0}
    return [
        Extreme("gap 1e-8", "epsilon = 1e-8", solved(epsilon=1e-8), RESOLVED),
        Extreme("gap 0", "epsilon = 0", solved(epsilon=0.0), RESOLVED),
        Extreme(
            "gap 0, no load",
            "epsilon = 0, mean 0: nothing centres it",
            solved(epsilon=0.0, mean=0.0),
            HONEST,
        ),
        Extreme(
            "sharp", "transition = 1e-6", solved(transition=1e-6), HONEST, quick=False
        ),
        Extreme(
            "blunt", "transition = 1", solved(transition=1.0), RESOLVED, quick=False
        ),
        Extreme(
            "tight",
            "backlash = 1e-12 m: a linear train",
            solved(backlash=1e-12),
            RESOLVED,
            quick=False,
        ),
        Extreme("wide", "backlash = 1 m", solved(backlash=1.0), HONEST, quick=False),
        Extreme(
            "wide, loaded",
            "backlash = 1 m, teeth stay in contact",
            solved(backlash=1.0, **loaded),
            CONVERGED,
            quick=False,
        ),
        Extreme(
            "stiffness ratio",
            "shafts 1e-2 and 1e10 N m/rad",
            solved(shaft=(1e-2, 1e10)),
            HONEST,
            quick=False,
        ),
        Extreme(
            "stiffness ratio, turned",
            "shafts 1e10 and 1e-2 N m/rad",
            solved(shaft=(1e10, 1e-2)),
            HONEST,
            quick=False,
        ),
        Extreme(
            "massless disk",
            "coupling of inertia 0",
            solved(coupling=0.0),
            RESOLVED,
            quick=False,
        ),
        Extreme(
            "massless gear",
            "pinion of inertia 0",
            solved(gear=0.0),
            RESOLVED,
            "harmonics",
            quick=False,
        ),
        Extreme(
            "no inertia at all",
            "one disk of inertia 0",
            lambda: built([Disk(name="a", inertia=0.0)]),
            "every disk is 0",
        ),
        Extreme(
            "soft ground",
            "1e-9 N m/rad",
            solved(holds=[*GROUND, Load(disk="mill")]),
            RESOLVED,
        ),
        Extreme(
            "soft ground, pushed",
            "1e-9 N m/rad takes 8 N m",
            pushed_far,
            CONVERGED,
            "none",
            quick=False,
        ),
        Extreme(
            "unbalanced",
            "mean torque, no load",
            lambda: built(parts()[:-1]),
            "must balance",
        ),
        Extreme(
            "crawling",
            "1 rpm, mesh mode at harmonic 150 000",
            solved(1.0),
            HONEST,
            "none",
            quick=False,
        ),
        Extreme(
            "crawling, loaded",
            "1 rpm, teeth stay in contact",
            solved(1.0, **loaded),
            CONVERGED,
            "none",
        ),
        Extreme("racing", "1e6 rpm", solved(1e6), CONVERGED, quick=False),
        Extreme("no load", "mean torque 0", solved(mean=0.0), RESOLVED),
        Extreme("no torque", "mean and harmonics 0", silent, CONVERGED, "none"),
        Extreme(
            "undamped",
            "damping at motor and mill alone",
            solved(drag=0.0, damping=0.0),
            HONEST,
            quick=False,
        ),
        Extreme(
            "2 disks",
            "two gears that stay in contact",
            lambda: two_disks(50.0),
            CONVERGED,
        ),
        Extreme(
            "2 disks, apart",
            "two gears that hammer",
            lambda: two_disks(5.0),
            RESOLVED,
            quick=False,
        ),
        Extreme(
            "3000 disks",
            "2994 massless pieces of a shaft",
            pieces_change_nothing,
            CONVERGED,
            quick=False,
        ),
        Extreme(
            "4096 harmonics",
            "harmonics = 4096",
            solved(options={"harmonics": 4096}),
            CONVERGED,
            quick=False,
        ),
        Extreme(
            "4097 harmonics",
            "harmonics = 4097",
            solved(options={"harmonics": 4097}),
            "more than the limit",
        ),
        Extreme(
            "resonance",
            "undamped, linear",
            lambda: at_resonance(False),
            frozenset({"NEAR_SINGULAR"}),
        ),
        Extreme(
            "resonance of teeth",
            "undamped, with backlash",
            lambda: at_resonance(True),
            HONEST,
            quick=False,
        ),
        Extreme(
            "not finite, built",
            "NaN, inf in every number",
            refused_when_built,
            "refused",
        ),
        Extreme(
            "not finite, replaced",
            "NaN, inf in every number",
            refused_when_replaced,
            "refused",
        ),
        Extreme(
            "not finite, traced",
            "NaN, inf in every array",
            traced_not_finite,
            "NONFINITE",
            quick=False,
        ),
        Extreme(
            "arguments", "speed, tolerance, harmonics", refused_arguments, "refused"
        ),
        Extreme("float32", "all arrays in single precision", in_float32, CONVERGED),
    ]
