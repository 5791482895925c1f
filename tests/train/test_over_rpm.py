"""Damping and stiffness over the speed: a train with such rows against trains of
constant numbers, interpolated by numpy.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import check_derivative, tight_plan
from tolerances import ALGEBRAIC

import jaxhb
from jaxhb import Damper, Disk, Ground, Mesh, SceneError, Shaft, Torque
from jaxhb.design.quantities import Objective
from jaxhb.design.tolerances import Tolerance
from jaxhb.scene.workbook.writing import scene_workbook
from jaxhb.train import chain
from jaxhb.train.varying import at_speed

# Below the first row, between rows, and above the last
SPEEDS = [200.0, 1100.0, 1730.0, 5000.0]
ROWS = {
    ("disk", "pump"): {"damping": [(500.0, 0.2), (2000.0, 0.8), (3000.0, 0.5)]},
    ("shaft", "coupling"): {
        "damping": [(500.0, 2.0), (2000.0, 5.0)],
        "stiffness": [(500.0, 2e4), (1500.0, 3e4), (2000.0, 2.6e4)],
    },
    ("mesh", "teeth"): {
        "damping": [(0.0, 150.0), (2500.0, 400.0)],
        "stiffness": [(1000.0, 8e7), (2500.0, 1.2e8)],
    },
    ("damper", "ring"): {
        "damping": [(500.0, 5.0), (2000.0, 12.0)],
        "stiffness": [(500.0, 5e4), (2000.0, 8e4)],
    },
    ("ground", "hold"): {"stiffness": [(500.0, 300.0), (2000.0, 700.0)]},
}


def parts(*, rpm=None, backlash=None, more=()):
    """An engine on a coupling with a rubber damper and a geared pump, with the rows
    over the speed, or with what numpy makes of them at ``rpm``.
    """

    def own(table, name):
        return _given(ROWS[table, name], rpm)

    return [
        Disk(name="engine", inertia=1.2, damping=2.0),
        Disk(name="hub", inertia=0.1),
        Disk(name="gear", inertia=0.3, radius=0.2),
        Disk(name="pinion", inertia=0.02, radius=0.1),
        Disk(name="pump", inertia=0.4, **own("disk", "pump")),
        Shaft(between=("engine", "hub"), stiffness=8e5, loss_factor=0.02),
        Shaft(between=("gear", "hub"), name="coupling", **own("shaft", "coupling")),
        Shaft(between=("pinion", "pump"), stiffness=4e4, damping=1.0),
        Mesh(
            between=("gear", "pinion"),
            name="teeth",
            backlash=backlash,
            epsilon=backlash and 1e-3,
            transition=backlash and 0.04,
            **own("mesh", "teeth"),
        ),
        Damper(name="ring", disk="engine", inertia=0.3, **own("damper", "ring")),
        Ground(disk="engine", name="hold", **own("ground", "hold")),
        Torque(
            disk="engine",
            mean=120.0,
            harmonics=((0.5, 60.0, 30.0), (1.0, 90.0, -40.0), (3.0, 60.0, 80.0)),
        ),
        Torque(disk="pump", mean=-40.0),
        *more,
    ]


def train_of(**changes):
    return jaxhb.build(parts(**changes), reference="engine")


def gears(*, rpm=None, more=()):
    """A pair of spur gears with backlash under an error of 32 orders, as the scene
    "spur_pair", whose teeth part at 3000 rpm.
    """

    def own(**tables):
        return _given(tables, rpm)

    teeth = own(
        stiffness=[(2000.0, 1.9e8), (4000.0, 2.1e8)],
        damping=[(1000.0, 800.0), (3500.0, 1300.0)],
    )
    drag = own(damping=[(1000.0, 0.01), (5000.0, 0.05)])
    inertia = 0.0028
    alternating = {"rated_rpm": 3000.0, "speed_exponent": 2.0}
    elements = [
        Disk(name="gear a", inertia=inertia, radius=0.05, teeth=32, **drag),
        Disk(name="gear b", inertia=inertia, radius=0.05, teeth=32),
        Mesh(
            between=("gear a", "gear b"),
            name="teeth",
            damping_law="always",
            backlash=1e-4,
            epsilon=1e-4,
            transition=0.02,
            **teeth,
        ),
        Torque(disk="gear a", mean=50.0),
        Torque(disk="gear b", mean=-50.0),
        Torque(disk="gear a", harmonics=[(32.0, 0.0, -40.0)], **alternating),
        Torque(disk="gear b", harmonics=[(32.0, 0.0, 40.0)], **alternating),
    ]
    return jaxhb.build(
        [*elements, *more], reference="gear a", revolutions_per_cycle=1 / 32
    )


GEAR_SPEEDS = [1500.0, 3000.0, 4600.0]


def _given(tables, rpm):
    """Rows over the speed by field, or what numpy makes of them at ``rpm``."""
    if rpm is None:
        return {f"{field}_over_rpm": tuple(rows) for field, rows in tables.items()}
    return {
        field: float(np.interp(rpm, *np.transpose(rows)))
        for field, rows in tables.items()
    }


def assert_same(actual, expected):
    """All numbers of two responses are the same, and their statuses."""
    assert int(actual.status) == int(expected.status)
    for name in ("angles", "torques", "forces", "elastic_forces", "ground_reaction"):
        value = np.asarray(getattr(expected, name))
        scale = np.abs(value).max(initial=1e-300)
        # Sweeps fill up with harmonics of 0.
        own = np.asarray(getattr(actual, name))[..., : value.shape[-1]]
        np.testing.assert_allclose(
            own, value, rtol=0, atol=ALGEBRAIC * scale, err_msg=name
        )
    np.testing.assert_allclose(
        actual.law.stiffness, expected.law.stiffness, rtol=ALGEBRAIC
    )


def test_arrays_of_the_system_are_those_of_the_interpolated_numbers():
    train = train_of()
    for rpm in SPEEDS:
        system = chain.assemble(train, rpm)
        expected = chain.assemble(train_of(rpm=rpm))
        for name in ("damping", "ground", "stiffness", "viscous", "mass"):
            np.testing.assert_allclose(
                getattr(system, name), getattr(expected, name), rtol=ALGEBRAIC
            )
    # At traced speeds, too.
    stiffness = jax.vmap(lambda rpm: chain.assemble(train, rpm).stiffness)(
        jnp.array(SPEEDS)
    )
    rows = [chain.assemble(train_of(rpm=rpm)).stiffness for rpm in SPEEDS]
    np.testing.assert_allclose(stiffness, rows, rtol=ALGEBRAIC)


def test_constant_trains_have_nothing_of_it():
    train = train_of(rpm=1000.0)
    assert at_speed(train, 700.0) is train
    tables = (train.disks, train.shafts, train.dampers, train.meshes, train.grounds)
    rows = [
        getattr(table, field.name)
        for table in tables
        for field in dataclasses.fields(table)
        if field.name.endswith("_over_rpm")
    ]
    assert len(rows) == 8
    assert all(values is None for values in rows)


def test_forced_responses_at_every_speed_are_those_of_constant_trains():
    response = jaxhb.forced_response(train_of(), rpm=SPEEDS)
    for i, rpm in enumerate(SPEEDS):
        expected = jaxhb.forced_response(train_of(rpm=rpm), rpm=rpm)
        assert_same(response[i], expected)
        np.testing.assert_allclose(
            response[i].link_power,
            expected.link_power,
            rtol=0,
            atol=ALGEBRAIC * np.abs(expected.link_power).max(),
        )


def test_linear_solutions_at_every_speed_are_those_of_constant_trains():
    train = train_of()
    sweep = jaxhb.solve_speeds(train, rpm=SPEEDS)
    for i, rpm in enumerate(SPEEDS):
        expected = jaxhb.solve(train_of(rpm=rpm), rpm=rpm)
        assert_same(jaxhb.solve(train, rpm=rpm), expected)
        assert_same(sweep[i], expected)


def test_solutions_with_backlash_are_those_of_constant_trains():
    train = gears()
    sweep = jaxhb.solve_speeds(train, rpm=GEAR_SPEEDS)
    states = jaxhb.steady_state(train, rpm=GEAR_SPEEDS)
    separated = []
    for i, rpm in enumerate(GEAR_SPEEDS):
        constant = gears(rpm=rpm)
        expected = jaxhb.solve(constant, rpm=rpm)
        response = jaxhb.solve(train, rpm=rpm)
        assert_same(response, expected)
        assert_same(sweep[i], jaxhb.solve_speeds(constant, rpm=[rpm])[0])
        (steady,) = jaxhb.steady_state(constant, rpm=[rpm])
        assert (states[i].kind, states[i].period) == (steady.kind, steady.period)
        if steady.response is None:  # irregular
            assert states[i].record == steady.record
        else:
            assert_same(states[i].response, steady.response)
        np.testing.assert_allclose(
            jaxhb.stability(response).multipliers,
            jaxhb.stability(expected).multipliers,
            rtol=0,
            atol=ALGEBRAIC,
        )
        separated.append(expected.contacts()["teeth"].separated_fraction)
    # Teeth part at some of these speeds.
    assert max(separated) > 0.01


def test_marches_in_time_are_those_of_constant_trains():
    cycles = jaxhb.Cycles(transient=32, recorded=32)
    train = gears()
    states = jaxhb.steady_state(train, rpm=GEAR_SPEEDS, exact=False, cycles=cycles)
    for state, rpm in zip(states, GEAR_SPEEDS, strict=True):
        (expected,) = jaxhb.steady_state(
            gears(rpm=rpm), rpm=[rpm], exact=False, cycles=cycles
        )
        np.testing.assert_allclose(
            state.motion,
            expected.motion,
            rtol=0,
            atol=ALGEBRAIC * np.abs(expected.motion).max(),
        )


def test_natural_frequencies_and_the_campbell_diagram_are_those_of_each_speed():
    train = train_of()
    with pytest.raises(SceneError) as refusal:
        jaxhb.natural_frequencies(train)
    sentences = refusal.value.sentences
    assert len(sentences) == sum(len(fields) for fields in ROWS.values())
    assert "'pump' has damping_over_rpm" in sentences[0]
    assert all("train.with_constant_links(rpm=...)" in text for text in sentences)
    diagram = jaxhb.campbell(train, rpm=SPEEDS, orders=[3.0])
    for row, rpm in zip(diagram.frequencies_hz, SPEEDS, strict=True):
        expected = jaxhb.natural_frequencies(train_of(rpm=rpm)).frequencies_hz
        np.testing.assert_allclose(row, expected, rtol=1e-9, atol=1e-9)
        fixed = train.with_constant_links(rpm=rpm)
        modes = jaxhb.natural_frequencies(fixed)
        np.testing.assert_allclose(modes.frequencies_hz, expected, rtol=1e-9, atol=1e-9)
    (crossing, *_) = diagram.critical
    there = jaxhb.natural_frequencies(train_of(rpm=crossing.rpm)).frequencies_hz
    # The root is found to 1e-12 of the speed.
    np.testing.assert_allclose(there[crossing.mode], crossing.hz, rtol=1e-9)


def test_order_tuned_absorbers_are_solved_with_backlash_at_the_stiffness_of_the_speed():
    def absorber(order, stiffness):
        return Damper(
            name="pendulum",
            disk="gear b",
            inertia=1e-4,
            damping=0.01,
            order=order,
            stiffness=stiffness,
        )

    rpm = 4600.0
    tuned = gears(more=[absorber(3.0, 0.0)])
    # J n^2 Omega^2 of den Hartog
    stiffness = 1e-4 * (3.0 * rpm * 2 * np.pi / 60) ** 2
    expected = jaxhb.solve(gears(rpm=rpm, more=[absorber(None, stiffness)]), rpm=rpm)
    response = jaxhb.solve(tuned, rpm=rpm)
    assert response.contacts()["teeth"].separated_fraction > 0.01
    # The stiffness rounds otherwise, and sweeps end at 1e-6 of the vibration.
    np.testing.assert_allclose(
        response.forces,
        expected.forces,
        rtol=0,
        atol=1e-5 * np.abs(expected.forces).max(),
    )


def test_traced_rows_out_of_range_are_a_status():
    train = gears()
    rows = jnp.array([[2000.0, -1e8], [4000.0, 2e8]])

    @jax.jit
    def status(rows, rpm):
        changed = train.replace({"teeth.stiffness_over_rpm": rows})
        return jaxhb.forced_response(changed, rpm=rpm).status

    assert status(rows, 2500.0) == jaxhb.Status.INVALID_INPUT
    # Halfway between zero and the last row.
    assert status(rows, 3500.0) == jaxhb.Status.CONVERGED


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["forced", "planned"])
def test_derivatives_by_the_numbers_of_rows_and_the_speed(solver):
    train = gears()
    keys = ["teeth.stiffness_over_rpm", "gear a.damping_over_rpm"]
    rows = [np.asarray(train.value(key)) for key in keys]
    plan = separating_gears() if solver == "planned" else None

    def value(numbers):
        stiffness = jnp.column_stack([rows[0][:, 0], numbers[:2]])
        damping = jnp.column_stack([rows[1][:, 0], numbers[2:4]])
        changed = train.replace({keys[0]: stiffness, keys[1]: damping})
        if solver == "forced":
            response = jaxhb.forced_response(changed, rpm=numbers[4])
        else:
            response = jaxhb.solve(changed, rpm=numbers[4], plan=plan)
        return jnp.stack([response.forces[0, 1].real, response.forces[0, 1].imag])

    at = np.concatenate([rows[0][:, 1], rows[1][:, 1], [3100.0]])
    check_derivative(value, at)
    # Below the first row only that has a part.
    low = jax.jacrev(value)(jnp.asarray(np.append(at[:4], 1500.0)))
    assert np.all(low[:, 1] == 0.0)
    assert np.all(low[:, 0] != 0.0)


def separating_gears():
    """A plan of :func:`gears` solved to rounding."""
    return tight_plan(
        harmonics=24,
        active=(0,),
        flank=(0,),
        start="march",
        time_steps=768,
        tolerance=0.5,
        excited=1,
    )


def test_rows_are_read_changed_and_written(tmp_path):
    train = train_of()
    key = "pump.damping_over_rpm"
    assert train.value(key).tolist() == [[500.0, 0.2], [2000.0, 0.8], [3000.0, 0.5]]
    rows = [[400.0, 0.1], [1000.0, 0.3], [1200.0, 0.9]]
    changed = train.replace({key: rows})
    assert at_speed(changed, 1100.0).value("pump.damping") == pytest.approx(0.6)
    # Rows of other elements stay.
    assert changed.value("ring.damping_over_rpm").tolist() == [
        [500.0, 5.0],
        [2000.0, 12.0],
    ]
    with pytest.raises(SceneError, match="its damping depends on the speed"):
        train.value("pump.damping")
    with pytest.raises(SceneError, match="its stiffness depends on the speed"):
        train.replace({"coupling.stiffness": 1e4})
    with pytest.raises(SceneError, match=r"row 2: rpm 1000 after 1000"):
        train.replace({key: [[1000.0, 0.1], [1000.0, 0.3], [1200.0, 0.9]]})
    with pytest.raises(SceneError, match=r"row 3: damping is -1, must be at least 0"):
        train.replace({key: [[400.0, 0.1], [1000.0, 0.3], [1200.0, -1.0]]})
    with pytest.raises(
        SceneError, match=r"the value has shape \(2, 2\), must have \(0"
    ):
        train.replace({"hub.damping_over_rpm": [[1.0, 2.0], [3.0, 4.0]]})
    path = tmp_path / "scene.toml"
    path.write_text(jaxhb.elements_text(parts(), reference="engine"))
    again = jaxhb.load_scene(path)
    assert again.topology.rpm_tables == train.topology.rpm_tables
    assert again.value(key).tolist() == train.value(key).tolist()


def test_scenarios_replace_rows(tmp_path):
    """In units, too, and from a workbook."""
    path = tmp_path / "scene.toml"
    inverter = Torque(disk="pump", name="inverter", lines=((50.0, 3.0, 0.0),))
    text = jaxhb.elements_text(parts(more=[inverter]), reference="engine")
    path.write_text(
        f"""{text}
[scenario.worn]
"pump.damping_over_rpm" = [[500, 0.1], [2000, "400 N mm s/rad"], ["50 Hz", 0.3]]
"inverter.lines" = [["60 Hz", "0.007 kN m", 1]]
"""
    )
    book = tmp_path / "scene.xlsx"
    book.write_bytes(scene_workbook(str(path)))
    for source in (path, book):
        train = jaxhb.load_scene(source)
        worn = train.scenario("worn")
        rows = [[500.0, 0.1], [2000.0, 0.4], [3000.0, 0.3]]
        np.testing.assert_allclose(
            worn.value("pump.damping_over_rpm"), rows, rtol=ALGEBRAIC
        )
        line = [[60.0, 7.0, 1.0]]
        np.testing.assert_allclose(worn.value("inverter.lines"), line, rtol=ALGEBRAIC)
        # The scene as written is another train.
        assert train.value("inverter.lines").tolist() == [[50.0, 3.0, 0.0]]


def test_elements_left_out_take_their_rows_with_them():
    rest = train_of().without("ring")
    assert ("damper", "damping", 0, 2) not in rest.topology.rpm_tables
    expected = train_of(rpm=1100.0).without("ring")
    np.testing.assert_allclose(
        chain.assemble(rest, 1100.0).stiffness,
        chain.assemble(expected).stiffness,
        rtol=ALGEBRAIC,
    )


def test_laws_of_meshes_follow_from_the_loads_and_the_stiffness_of_each_speed():
    def bare(rpm):
        return [
            dataclasses.replace(part, epsilon=None, transition=None)
            if isinstance(part, Mesh)
            else part
            for part in parts(rpm=rpm, backlash=1e-4)
        ]

    scale = ((1000.0, 1.0), (2500.0, 0.6))
    driven = Torque(disk="engine", mean=50.0, scale=scale)
    built = jaxhb.build([*bare(None), driven], reference="engine")
    each = [
        jaxhb.build([*bare(rpm), driven], reference="engine")
        for rpm in (1000.0, 2500.0)
    ]
    # Each of these chooses from both loads; the least share is at one of the speeds.
    chosen = [float(train.meshes.transition[0]) for train in each]
    assert min(chosen) <= float(built.meshes.transition[0]) <= max(chosen)


def test_mean_loads_with_stages_take_the_stiffness_of_the_speed():
    def staged(rpm):
        elements = parts(rpm=rpm)
        return jaxhb.build(
            [
                dataclasses.replace(part, stages=((0.5, 5e4),))
                if getattr(part, "name", "") == "coupling"
                else part
                for part in elements
            ],
            reference="engine",
        )

    response = jaxhb.forced_response(staged(None), rpm=SPEEDS)
    for i, rpm in enumerate(SPEEDS):
        assert_same(response[i], jaxhb.forced_response(staged(rpm), rpm=rpm))
    solved = jaxhb.solve(staged(None), rpm=1100.0)
    assert_same(solved, jaxhb.solve(staged(1100.0), rpm=1100.0))


def test_certificates_are_those_of_the_constant_train():
    rpm = GEAR_SPEEDS[0]
    bounds = [
        jaxhb.certify(jaxhb.solve(train, rpm=rpm))
        for train in (gears(), gears(rpm=rpm))
    ]
    assert bounds[0].holds
    assert str(bounds[0]) == str(bounds[1])


@pytest.mark.slow
def test_worst_cases_and_their_bounds_are_those_of_the_constant_train():
    rpm = SPEEDS[1]
    spreads = [
        jaxhb.tolerance(
            train,
            rpm=[rpm],
            of=[Objective(quantity="shaft torque", of="coupling")],
            tolerances=[Tolerance(name="gear.inertia", low=0.25, high=0.35)],
        )
        for train in (train_of(), train_of(rpm=rpm))
    ]
    for name in ("nominal", "worst", "bound"):
        own, expected = (getattr(spread, name) for spread in spreads)
        assert np.isfinite(expected).all()
        # Searches end at 1e-6.
        np.testing.assert_allclose(own, expected, rtol=1e-6)


def test_teeth_over_the_speed_have_no_single_mean_load(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = jaxhb.elements_text(parts(), reference="engine")
    (tmp_path / "scene.toml").write_text(text)
    refused = run("campbell scene.toml --rpm 500:1500:3 --at 900", status=2)
    assert "mesh 'teeth' depends on the speed" in refused.err
