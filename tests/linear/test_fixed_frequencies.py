"""Torques with lines at fixed frequencies: the linear answers against dense solves, and
the sentences of all calculations that have no answer.
"""

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import check_derivative
from tolerances import ALGEBRAIC
from trains import build, gearbox_parts

import jaxhb
from jaxhb import Damper, Disk, Mesh, Phase, SceneError, Shaft, Torque
from jaxhb.design import Objective, Tolerance
from jaxhb.train.excitation import without_lines

SPEEDS = np.array([300.0, 900.0])
BALANCE = 1e-10
"""Power brought in less power turned into heat, over the first."""


def lined_parts():
    """A closed loop of linear meshes, massless disks and a viscous ring, under two
    orders and three lines, of which two have one frequency.
    """
    parts = [
        Mesh(between=part.between, stiffness=part.stiffness, damping=part.damping)
        if isinstance(part, Mesh)
        else part
        for part in gearbox_parts()
        if not isinstance(part, Torque)
    ]
    return [
        *parts,
        Torque(name="motor orders", disk="motor", harmonics=[(1.0, 3.0, -1.0)]),
        Torque(
            name="grid",
            disk="motor",
            lines=[(61.3, 4.0, 1.0), (17.9, 0.0, 2.0)],
            scale=[(0.0, 0.0), (600.0, 2.0), (1200.0, 3.0)],
        ),
        Torque(name="inverter", disk="mill", lines=[(61.3, -1.0, 0.5)]),
    ]


SCALES = {300.0: 1.0, 900.0: 2.5}


def dense_angles(parts, hz, torques):
    """Complex amplitudes ``(S,)`` of the angles under torques by disk."""
    names = dense.disk_names(parts)
    load = np.zeros(len(names), complex)
    for disk, amplitude in torques.items():
        load[names.index(disk)] = amplitude
    return np.linalg.solve(dense.dynamic_stiffness(parts, 2 * np.pi * hz), load)


def lines_at(parts, rpm):
    """Complex amplitudes of the angles at both frequencies."""
    scale = SCALES[rpm]
    return {
        61.3: dense_angles(parts, 61.3, {"motor": scale * (4 + 1j), "mill": -1 + 0.5j}),
        17.9: dense_angles(parts, 17.9, {"motor": scale * 2j}),
    }


@pytest.fixture(scope="module")
def case():
    parts = lined_parts()
    train = build(parts, reference="motor")
    return parts, train, jaxhb.forced_response(train, rpm=SPEEDS)


def test_lines_are_those_of_a_dense_solve(case):
    parts, _, response = case
    for place, rpm in enumerate(SPEEDS):
        motion = response[place]
        for hz, angles in lines_at(parts, rpm).items():
            omega = 2 * np.pi * hz
            for name, expected in zip(dense.disk_names(parts), angles, strict=True):
                size = ALGEBRAIC * 1e2 * np.abs(angles).max()
                assert abs(motion.disk(name).line(hz) - abs(expected)) < size
                speed = motion.speed(name).line(hz)
                assert abs(speed - omega * abs(expected)) < omega * size
            for part, row in dense.links(parts):
                stiffness = dense.link_stiffness(part, omega)
                passed = abs(stiffness * (row @ angles))
                if isinstance(part, Mesh):
                    signal = motion.force(*part.between)
                elif isinstance(part, Damper):
                    signal = motion.torque(part.name)
                else:
                    signal = motion.torque(*part.between)
                # Differences of the dense angles lose the digits of stiff links.
                tolerance = ALGEBRAIC * 1e3 * abs(stiffness) * np.abs(angles).max()
                assert abs(signal.line(hz) - passed) < tolerance


def test_orders_are_those_without_lines(case):
    _, train, response = case
    alone = jaxhb.forced_response(without_lines(train), rpm=SPEEDS)
    assert alone.lines is None
    np.testing.assert_allclose(response.angles, alone.angles, rtol=0, atol=1e-18)
    torque = response.torque("motor", "coupling")
    of_orders = alone.torque("motor", "coupling")
    lines = torque.line(61.3) + torque.line(17.9)
    assert (lines > 0.1).all()
    np.testing.assert_allclose(torque.max, of_orders.max + lines)
    np.testing.assert_allclose(torque.min, of_orders.min - lines)
    np.testing.assert_allclose(torque.peak, of_orders.peak + lines)
    half = of_orders.half_peak_to_peak + lines
    np.testing.assert_allclose(torque.half_peak_to_peak, half)
    sums = of_orders.sum_of_amplitudes + lines
    np.testing.assert_allclose(torque.sum_of_amplitudes, sums)


def test_extremes_bound_the_motion_and_are_reached(case):
    parts, _, response = case
    motion = response[1]
    signal = motion.disk("mill")
    # In 3 000 s lines and order, which have no common period below 600 s, meet.
    t = np.arange(0.0, 3000.0, 1e-3)
    names = dense.disk_names(parts)
    values = np.zeros_like(t)
    for hz, angles in lines_at(parts, 900.0).items():
        values += (angles[names.index("mill")] * np.exp(2j * np.pi * hz * t)).real
    order = dense_angles(parts, 15.0, {"motor": 3 - 1j})[names.index("mill")]
    values += (order * np.exp(2j * np.pi * 15.0 * t)).real
    swing = float(signal.max - signal.mean)
    assert values.max() <= swing * (1 + 1e-9)
    # Between two instants the phase of 61.3 Hz turns by 22 deg: 1 % may be missed.
    assert values.max() > 0.99 * swing
    rms = np.sqrt(np.mean(values**2) + float(signal.mean) ** 2)
    assert abs(float(signal.rms) - rms) < 1e-4 * rms


def test_lines_bring_in_the_heat_that_they_make(case):
    _, train, response = case
    heat = response.disk_power.sum(-1) + response.link_power.sum(-1)
    np.testing.assert_allclose(response.input_power, heat, rtol=BALANCE)
    alone = jaxhb.forced_response(without_lines(train), rpm=SPEEDS)
    assert (response.input_power > 1.01 * alone.input_power).all()


def test_a_line_on_an_order_is_that_order(case):
    parts, _, _ = case
    parts = [part for part in parts if not isinstance(part, Torque)]
    rpm = 60 * 17.9

    def torque_under(excitation):
        train = build([*parts, excitation], reference="motor")
        return jaxhb.forced_response(train, rpm=rpm).torque("motor", "coupling")

    one = torque_under(Torque(disk="motor", lines=[(17.9, 3.0, 4.0)]))
    other = torque_under(Torque(disk="motor", harmonics=[(1.0, 3.0, 4.0)]))
    np.testing.assert_allclose(one.line(17.9), other.order(1.0), rtol=ALGEBRAIC)
    np.testing.assert_allclose(one.lines.phases_deg, other.phases_deg, atol=1e-9)
    for statistic in ("max", "rms", "half_peak_to_peak"):
        # The largest sample of the order misses its peak by (pi / 4096)^2 / 2.
        np.testing.assert_allclose(
            getattr(one, statistic), getattr(other, statistic), rtol=1e-6
        )


@pytest.mark.slow
def test_rows_have_derivatives(case):
    _, train, _ = case

    def bound(numbers):
        changed = train.replace({"grid.lines": numbers.reshape(2, 3)})
        response = jaxhb.forced_response(changed, rpm=900.0)
        return response.torque("motor", "coupling").half_peak_to_peak

    check_derivative(bound, [60.1, 4.0, 1.0, 17.9, 0.5, 2.0])


@pytest.mark.slow
def test_frequencies_may_be_mapped_over(case):
    _, train, _ = case

    def amplitudes(hz):
        rows = jnp.stack([jnp.stack([hz, 4.0, 1.0]), jnp.array([17.9, 0.0, 2.0])])
        response = jaxhb.forced_response(train.replace({"grid.lines": rows}), rpm=900.0)
        return response.torque("motor", "coupling").lines.amplitudes, response.status

    # At 61.3 Hz the row meets that of the inverter, and 0 Hz is none.
    many, status = jax.vmap(amplitudes)(jnp.array([50.0, 61.3, 0.0]))
    assert status.tolist() == [0, 0, jaxhb.Status.INVALID_INPUT]
    for place, hz in enumerate((50.0, 61.3)):
        alone = train.replace({"grid.lines": [(hz, 4.0, 1.0), (17.9, 0.0, 2.0)]})
        signal = jaxhb.forced_response(alone, rpm=900.0).torque("motor", "coupling")
        np.testing.assert_allclose(many[place], signal.lines.amplitudes, rtol=1e-12)
    assert float(many[1, 2]) == 0.0


def test_values_are_read_and_changed_by_row(case):
    _, train, _ = case
    assert train.value("grid.lines").tolist() == [[61.3, 4.0, 1.0], [17.9, 0.0, 2.0]]
    assert train.value("inverter.lines").tolist() == [[61.3, -1.0, 0.5]]
    changed = train.replace({"inverter.lines": [(40.0, 1.0, 0.0)]})
    signal = jaxhb.forced_response(changed, rpm=900.0).torque("motor", "coupling")
    assert list(signal.by_line()) == [17.9, 40.0, 61.3]
    with pytest.raises(SceneError, match=r"frequency is -1 Hz, must be greater than 0"):
        train.replace({"inverter.lines": [(-1.0, 1.0, 0.0)]})
    with pytest.raises(SceneError, match=r"has shape \(2, 3\), must have \(1, 3\)"):
        train.replace({"inverter.lines": [(1.0, 1.0, 0.0), (2.0, 1.0, 0.0)]})
    with pytest.raises(ValueError, match=r"no line at 5 Hz; lines in Hz: 17.9, 40"):
        signal.line(5.0)


def test_a_scene_is_written_with_its_lines(tmp_path):
    parts = [
        Disk(name="a", inertia=1.0),
        Disk(name="b", inertia=1.0),
        Shaft(between=("a", "b"), stiffness=1e4),
        Torque(name="grid", disk="a", lines=[(100.0, 50.0, 0.25), (50.0, 1.0, -2.0)]),
    ]
    path = tmp_path / "lines.toml"
    path.write_text(jaxhb.elements_text(parts, reference="a"))
    train = jaxhb.load_scene(path)
    assert train.value("grid.lines").tolist() == [[100.0, 50.0, 0.25], [50, 1, -2]]


def two_disks(*more):
    return [
        Disk(name="a", inertia=1.0),
        Disk(name="b", inertia=2.0),
        Shaft(between=("a", "b"), stiffness=1e4, damping=1.0),
        Torque(
            name="grid",
            disk="a",
            lines=[(19.0, 5.0, 0.0), (90.0, 1.0, 0.0)],
            scale=[(0.0, 0.5), (1500.0, 2.0), (3000.0, 0.0)],
        ),
        *more,
    ]


def test_campbell_has_the_nearest_mode_at_every_speed():
    natural = np.sqrt(1e4 * (1 / 1.0 + 1 / 2.0)) / (2 * np.pi)
    diagram = jaxhb.campbell(build(two_disks()), rpm=[100.0, 1500.0, 2000.0])
    assert diagram.critical == ()
    first, second = diagram.lines
    assert (first.hz, second.hz) == (19.0, 90.0)
    assert first.rpm is second.rpm is None
    assert first.mode == second.mode == 1
    assert abs(first.mode_hz - natural) < 1e-9 * natural
    assert abs(first.apart - (natural / 19.0 - 1)) < 1e-9
    # Those of the speed with the largest scale, on the light disk.
    assert abs(first.torque - 2 * 5.0) < 1e-9
    assert abs(second.torque - 2 * 1.0) < 1e-9


def test_campbell_has_the_speeds_at_which_modes_cross_a_line():
    parts = [part for part in two_disks() if not isinstance(part, Shaft)]
    # Stiffness that grows with the speed: 19 Hz lies between.
    rows = [(100.0, 5e3), (2100.0, 2.5e4)]
    parts.append(Shaft(between=("a", "b"), stiffness_over_rpm=rows))
    train = build(parts)
    diagram = jaxhb.campbell(train, rpm=np.linspace(100.0, 2000.0, 9))
    crossing, nearest = diagram.lines
    stiffness = (2 * np.pi * 19.0) ** 2 / 1.5
    expected = np.interp(stiffness, [5e3, 2.5e4], [100.0, 2100.0])
    assert abs(crossing.rpm - expected) < 1e-8 * expected
    assert abs(crossing.apart) < 1e-9
    assert nearest.rpm == 2000.0
    assert nearest.apart < -0.5


def hammering_parts():
    pair = [
        Disk(name="a", inertia=0.01, radius=0.1),
        Disk(name="b", inertia=0.02, radius=0.1),
        Mesh(between=("a", "b"), stiffness=1e8, damping=1e3, backlash=1e-4),
        Torque(name="drive", disk="a", mean=10.0, harmonics=[(2.0, 30.0, 0.0)]),
        Torque(name="brake", disk="b", mean=-10.0),
        Torque(name="ripple", disk="b", lines=[(210.0, 1.0, 0.0)]),
    ]
    return [*pair, Phase(name="turn", of=["drive"])]


CALCULATIONS = {
    "solve": lambda train: jaxhb.solve(train, rpm=900.0),
    "solve_all": lambda train: jaxhb.solve_all(train, rpm=900.0),
    "solve_speeds": lambda train: jaxhb.solve_speeds(train, rpm=[900.0, 950.0]),
    "plan": lambda train: jaxhb.plan(train, rpm=900.0),
    "linear_response": lambda train: jaxhb.linear_response(train, rpm=900.0),
    "steady_state": lambda train: jaxhb.steady_state(train, rpm=[900.0]),
    "integrate": lambda train: jaxhb.integrate(train, rpm=900.0),
    "harmonic_residual": lambda train: jaxhb.harmonic_residual(
        train, rpm=900.0, harmonics=8
    ),
    "lift_off": lambda train: jaxhb.lift_off(train, rpm=[900.0, 950.0]),
    "worst_phase": lambda train: jaxhb.worst_phase(train, "turn", rpm=[900.0]),
    "tune": lambda train: jaxhb.tune(
        train,
        rpm=[900.0],
        parameters=[jaxhb.design.Parameter(name="b.inertia", low=0.01, high=0.03)],
        objective=[Objective(quantity="tooth force", of="a|b")],
    ),
    "tolerance": lambda train: jaxhb.tolerance(
        train,
        rpm=[900.0],
        of=[Objective(quantity="tooth force", of="a|b")],
        tolerances=[Tolerance(name="b.inertia", low=0.01, high=0.03)],
    ),
}


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "with backlash"])
@pytest.mark.parametrize("calculation", CALCULATIONS)
def test_periodic_motions_are_refused(calculation, linear):
    train = build(hammering_parts(), reference="a")
    if linear:
        train = jaxhb.forced_response(train, rpm=900.0).train
    with pytest.raises(SceneError, match=r"\[\[torque\]\] 'ripple' has lines at fixed"):
        CALCULATIONS[calculation](train)


def test_nothing_is_sampled_over_a_cycle():
    response = jaxhb.forced_response(build(hammering_parts(), reference="a"), rpm=900.0)
    with pytest.raises(ValueError, match="no cycle is like the next"):
        response.force("a", "b").samples(64)
    with pytest.raises(ValueError, match="no cycle is like the next"):
        response.deflection_samples(64)
    # A linear mesh never parts, whatever its cycles are.
    assert response.mesh("a", "b").separated_fraction == 0.0


def test_a_data_set_has_lines():
    pytest.importorskip("xarray")
    response = jaxhb.forced_response(build(two_disks()), rpm=[300.0, 600.0])
    data = response.to_xarray()
    assert data.line.values.tolist() == [19.0, 90.0]
    torque = response.torque("a", "b")
    written = data.torque_line_amplitude.sel(shaft="a|b", line=19.0).values
    np.testing.assert_array_equal(written, torque.line(19.0))
    half = data.torque_half_peak_to_peak.sel(shaft="a|b").values
    np.testing.assert_array_equal(half, torque.half_peak_to_peak)


def test_a_line_at_an_undamped_resonance_has_no_answer():
    parts = [part for part in two_disks() if not isinstance(part, Shaft | Torque)]
    parts.append(Shaft(between=("a", "b"), stiffness=1e4))
    natural = float(np.sqrt(1.5e4) / (2 * np.pi))
    parts.append(Torque(disk="a", lines=[(natural, 1.0, 0.0)]))
    response = jaxhb.forced_response(build(parts), rpm=[300.0, 600.0])
    assert response.status.tolist() == [jaxhb.Status.NEAR_SINGULAR] * 2


def test_a_train_without_the_torque_has_periodic_motions():
    train = build(two_disks(Torque(disk="b", harmonics=[(1.0, 2.0, 0.0)])))
    alone = train.without("grid")
    solved = jaxhb.solve(alone, rpm=600.0).torque("a", "b").order(1.0)
    beside = jaxhb.forced_response(train, rpm=600.0).torque("a", "b").order(1.0)
    assert abs(solved - beside) < ALGEBRAIC * 1e2 * beside
