"""Fits to measured orders: a closed form, derivatives, intervals, numbers that data
leave open, files, and refusals.
"""

import numpy as np
import pytest
from reference_data import reference

import jaxhb
from jaxhb import Disk, SceneError, Shaft, Torque, build
from jaxhb.design import Measured, Parameter, identify, read_measured, weak_cylinder
from jaxhb.design.identification import Fit

RPM = np.array([700.0, 850.0, 950.0, 1000.0, 1300.0])
TRUE = {"a|b.stiffness": 6.2e3, "a|b.damping": 5.5, "b.inertia": 2.3}
PARAMETERS = [
    Parameter(name="a|b.stiffness", low=3e3, high=1.2e4),
    Parameter(name="a|b.damping", low=1.0, high=20.0),
    Parameter(name="b.inertia", low=1.0, high=4.0, scale="linear"),
]


def pair():
    """Two disks on a shaft, driven once a revolution with 5 N m."""
    parts = [Disk(name="a", inertia=1.0), Disk(name="b", inertia=2.0)]
    parts += [Shaft(between=("a", "b"), stiffness=6.7e3, damping=4.0)]
    return build(
        [*parts, Torque(disk="a", harmonics=[(1.0, 5.0, 0.0)])],
        name="pair",
        revolutions_per_cycle=1,
    )


def torque_of(rpm, stiffness, damping, inertia):
    """Complex amplitude of the torque of the shaft: one equation of the twist."""
    omega = np.pi / 30 * rpm
    reduced = inertia / (1 + inertia)
    force = stiffness + 1j * omega * damping
    return force * 5.0 * reduced / (force - reduced * omega**2)


def rows(torque, phases=True):
    count = len(torque)
    return Measured(
        rpm=np.resize(RPM, count),
        order=np.ones(count),
        element=("a|b",) * count,
        quantity=("torque",) * count,
        amplitude=np.abs(torque),
        phase=np.rad2deg(np.angle(torque)) if phases else np.full(count, np.nan),
    )


def true_torque(rpm):
    """Complex amplitude of the torque with the true numbers."""
    return torque_of(rpm, TRUE["a|b.stiffness"], TRUE["a|b.damping"], TRUE["b.inertia"])


@pytest.mark.slow
@pytest.mark.parametrize("phases", [True, False])
def test_the_numbers_of_a_closed_form_are_found_again(phases):
    fit = identify(pair(), rows(true_torque(RPM), phases), parameters=PARAMETERS)
    np.testing.assert_allclose(fit.values, list(TRUE.values()), rtol=1e-6)
    assert fit.misfit < 1e-6
    assert not fit.open
    assert not fit.at_bound
    assert fit.train.value("b.inertia") == fit.values[2]


@pytest.mark.slow
def test_derivatives_of_residuals_are_those_of_differences():
    # One row with and one without a phase, and a prior.
    measured = rows(true_torque(RPM))
    measured.phase[::2] = np.nan
    fit = Fit(pair(), measured, tuple(PARAMETERS), 0.03, {"a|b.damping": 1.0})
    u = np.array([0.4, 0.5, 0.3])
    step = 1e-6
    slopes = fit.residuals(u)[1]
    for k in range(3):
        sides = [fit.residuals(u + step * sign * np.eye(3)[k])[0] for sign in (1, -1)]
        np.testing.assert_allclose(
            slopes[:, k], (sides[0] - sides[1]) / (2 * step), rtol=1e-6, atol=1e-6
        )


@pytest.mark.slow
def test_true_numbers_lie_inside_the_intervals_as_often_as_they_say():
    # 40 fits of 3 numbers: 114 of 120 inside on average, fewer than 104 once in 10,000
    # seeds.
    inside = []
    rng = np.random.default_rng(5)
    torque = np.tile(true_torque(RPM), 4)
    for _ in range(40):
        noisy = torque * (1 + 0.03 * (rng.normal(size=20) + 1j * rng.normal(size=20)))
        measured = rows(noisy)
        measured.rpm[:] = np.tile(RPM, 4)
        fit = identify(pair(), measured, parameters=PARAMETERS)
        inside.append(fit.within(list(TRUE.values())))
    assert np.sum(inside) >= 104


@pytest.mark.slow
def test_a_number_that_no_row_sees_is_told_as_open_and_a_prior_keeps_it():
    # Far below resonance the amplitude is that of the rigid train: the stiffness has no
    # part in it.
    rpm = np.array([20.0, 30.0, 40.0])
    measured = Measured(
        rpm=rpm,
        order=np.ones(3),
        element=("a|b",) * 3,
        quantity=("torque",) * 3,
        amplitude=np.abs(torque_of(rpm, 6.2e3, 4.0, 2.3)),
        phase=np.full(3, np.nan),
    )
    fit = identify(pair(), measured, parameters=[PARAMETERS[0], PARAMETERS[2]])
    assert fit.open == ("a|b.stiffness",)
    with_prior = identify(
        pair(),
        measured,
        parameters=[PARAMETERS[0], PARAMETERS[2]],
        priors={"a|b.stiffness": 50.0},
    )
    assert not with_prior.open
    assert with_prior.values[0] == pytest.approx(6.7e3, abs=50.0)
    assert with_prior.std[0] == pytest.approx(50.0, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("phases", [True, False])
def test_the_weak_cylinder_is_found_from_low_orders_of_the_flywheel(phases):
    train = jaxhb.load_scene("six_cylinder_diesel")
    rng = np.random.default_rng(7)
    names = train.topology.cylinder_names
    truth = train.replace(
        {f"{name}.injection": 0.7 if name == names[4] else 1.0 for name in names}
    )
    rpm = np.array([1200.0, 1800.0, 2300.0])
    orders = np.arange(0.5, 3.5, 0.5)
    speed = jaxhb.forced_response(truth, rpm=rpm).speed("flywheel")
    exact = 2 * np.asarray(speed.coefficients)[:, 1:7]
    noise = rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape)
    noisy = (exact * (1 + 0.03 * noise)).ravel()
    measured = Measured(
        rpm=np.repeat(rpm, 6),
        order=np.tile(orders, 3),
        element=("flywheel",) * 18,
        quantity=("speed",) * 18,
        amplitude=np.abs(noisy),
        phase=np.rad2deg(np.angle(noisy)) if phases else np.full(noisy.size, np.nan),
    )
    weak = weak_cylinder(train, measured)
    assert weak.names[0] == names[4]
    assert weak.likely == (names[4],)
    assert weak.all_equal > 100
    assert abs(weak.gas_factor[0] - 0.7) < 4 * weak.std[0]


@pytest.mark.slow
def test_a_file_is_read_with_comments_and_sums(tmp_path):
    path = tmp_path / "measured.csv"
    head = "# of a run\nrpm,order,element,quantity,amplitude,phase\n"
    path.write_text(head + "900,1,a|b,torque,20,-30\n900,sum,a|b,torque,21,\n")
    measured = read_measured(path, pair())
    assert measured.element == ("a|b", "a|b")
    assert np.isnan(measured.order[1])
    assert np.isnan(measured.phase[1])
    fit = Fit(pair(), measured, (PARAMETERS[0],), 0.03, {})
    single, total = fit.computed(np.array([0.5]))[0]
    assert abs(single) == pytest.approx(total.real)  # one order alone is excited


MEASUREMENT = (
    "rpm,order,element,quantity,amplitude,phase\n"
    "900,1,a|b,torque,20.5,-30.25\n"
    "900,sum,a|b,torque,21,\n"
)


@pytest.mark.parametrize(
    "text",
    [
        MEASUREMENT.replace(",", "\t"),
        MEASUREMENT.replace(",", ";"),
        MEASUREMENT.replace(",", ";").replace(".", ","),
        MEASUREMENT.replace("\n", "\r\n"),
    ],
    ids=["tabs", "semicolons", "decimal commas", "lines of Windows"],
)
def test_a_measurement_has_the_same_rows_however_it_is_written(text, tmp_path):
    path = tmp_path / "measured.csv"
    path.write_bytes(text.encode())
    measured = read_measured(path, pair())
    assert measured.amplitude.tolist() == [20.5, 21.0]
    assert measured.phase[0] == -30.25
    assert np.isnan(measured.phase[1])


def test_a_fault_that_many_lines_have_is_told_once(tmp_path):
    path = tmp_path / "measured.csv"
    rows = "".join(f"{rpm},1,a|b,torsion,20,\n" for rpm in range(900, 940))
    path.write_text(
        "rpm,order,element,quantity,amplitude,phase\n" + rows + "950,1,a|b,torque,-1,\n"
    )
    with pytest.raises(SceneError) as caught:
        read_measured(path, pair())
    first, second = caught.value.sentences
    assert first.startswith(
        "measured.csv, line 2 and 39 others: there is no quantity 'torsion'."
    )
    assert second == "measured.csv, line 42: amplitude is '-1', must be at least 0."


def test_a_measurement_with_decimal_commas_between_commas_is_refused(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text(
        "rpm,order,element,quantity,amplitude\n"
        "900,1,a|b,torque,20,5\n"
        "910,1,a|b,torque,21,5\n"
    )
    with pytest.raises(
        SceneError,
        match=(
            r"line 2 and 1 other: there are 6 cells under 5 heads\. .*semicolons or"
            r" tabs"
        ),
    ):
        read_measured(path, pair())


@pytest.mark.parametrize(
    ("text", "sentence"), reference("cases")["files of measurements"]
)
def test_a_file_that_cannot_be_is_refused_in_a_sentence(text, sentence, tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        read_measured(path, pair())
    assert sentence in str(caught.value)
    assert len(caught.value.sentences) == 1


def test_what_cannot_be_fitted_is_refused_in_sentences():
    single_row = rows(true_torque(RPM[:1]), phases=False)
    with pytest.raises(
        SceneError, match="1 measured numbers and 0 priors are fewer than 3 parameters"
    ):
        identify(pair(), single_row, parameters=PARAMETERS)
    with pytest.raises(SceneError, match="the prior 'x.y' is of no parameter"):
        identify(pair(), single_row, parameters=PARAMETERS[:1], priors={"x.y": 1.0})
    with pytest.raises(SceneError, match="no cylinder fires"):
        weak_cylinder(pair(), single_row)
