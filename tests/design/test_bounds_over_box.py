"""Bounds over tolerances: beside closed forms, dense grids and thousands of trains; and
where there is none.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import jaxhb
from jaxhb import Disk, Mesh, Shaft, Torque, build
from jaxhb.design import Objective, Tolerance, read_tolerances
from jaxhb.design.bounds_over_box import _solved, bounds_over_box
from jaxhb.design.quantities import QUANTITIES
from jaxhb.design.tolerances import box_of
from jaxhb.report.text.tolerances import tolerance_parts, tolerance_rows

DRIVE = 5.0  # N m on a
INERTIA = 2.0  # kg m2 of b
TORQUE = Objective(quantity="shaft torque", of="a|b")
NOMINAL = {
    "a|b.stiffness": 6.7e3,
    "a|b.damping": 4.0,
    "a|b.loss_factor": 0.02,
    "a.inertia": 1.0,
    "t.mean": 0.0,
}


def pair():
    """Two disks on a shaft, driven once a revolution."""
    shaft = Shaft(
        between=("a", "b"),
        stiffness=NOMINAL["a|b.stiffness"],
        damping=NOMINAL["a|b.damping"],
        loss_factor=NOMINAL["a|b.loss_factor"],
    )
    parts = [
        Disk(name="a", inertia=NOMINAL["a.inertia"]),
        Disk(name="b", inertia=INERTIA),
        shaft,
        Torque(name="t", disk="a", harmonics=[(1.0, DRIVE, 0.0)]),
    ]
    return build(parts, name="pair", revolutions_per_cycle=1)


def torque_of(rpm, stiffness, damping, loss, inertia):
    """Amplitude of the torque of the shaft: one equation of the twist."""
    omega = np.pi / 30 * rpm
    reduced = inertia * INERTIA / (inertia + INERTIA)
    force = stiffness * (1 + 1j * loss) + 1j * omega * damping
    return np.abs(force * DRIVE * reduced / inertia / (force - reduced * omega**2))


def within(share, *names, together=None):
    """Tolerances of numbers of the pair, each a share of its nominal value."""
    together = together or {}
    return [
        Tolerance(
            name=name,
            low=(1 - share) * NOMINAL[name],
            high=(1 + share) * NOMINAL[name],
            together=together.get(name, ()),
        )
        for name in names
    ]


def bounds(train, rpm, tolerances, of):
    """Bounds and reasons, without any response to start from."""
    box = box_of(train, tuple(tolerances), tuple(of))
    bound, why, _ = bounds_over_box(
        train, np.array(rpm), box, np.zeros((len(rpm), len(of)))
    )
    return bound, why


FOUR = "a|b.stiffness", "a|b.damping", "a|b.loss_factor", "a.inertia"


def largest_of(rpm, share):
    """The largest torque of all pairs: the best of a grid, then a local search."""
    axes = [np.linspace(1 - share, 1 + share, count) for count in (61, 3, 3, 61)]
    grid = np.meshgrid(*axes, indexing="ij")
    nominal = [NOMINAL[name] for name in FOUR]

    def torque(ratios):
        stiffness, damping, loss, inertia = (
            value * ratio for value, ratio in zip(nominal, ratios, strict=True)
        )
        return torque_of(rpm, stiffness, damping, loss, inertia)

    values = torque(grid)
    best = np.unravel_index(values.argmax(), values.shape)
    start = [ratio[best] for ratio in grid]
    optimum = minimize(
        lambda ratios: -torque(ratios),
        start,
        bounds=[(1 - share, 1 + share)] * 4,
        method="Nelder-Mead",
        options={"xatol": 1e-9},
    )
    return max(values.max(), -optimum.fun)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_no_pair_of_disks_exceeds_the_bound_which_is_hardly_more_than_the_worst(share):
    # Below, at and above the resonance, and where the box holds it for some trains.
    rpm = np.array([500.0, 800.0, 955.0, 1000.0, 1200.0, 2000.0])
    bound, why = bounds(pair(), rpm, within(share, *FOUR), [TORQUE])
    dense = np.array([largest_of(speed, share) for speed in rpm])
    assert (why == "").all()
    assert (bound[:, 0] >= dense * (1 - 1e-12)).all()
    # 2 %, and what the grid misses.
    np.testing.assert_array_less(bound[:, 0], 1.0205 * dense)


def test_numbers_together_have_one_share():
    # Stiffness, loss factor and inertia in one ratio: k eta goes with its square.
    tolerances = within(
        0.1,
        "a|b.stiffness",
        together={"a|b.stiffness": ("a|b.loss_factor", "a.inertia")},
    )
    rpm = np.array([800.0, 955.0, 1200.0])
    bound, _ = bounds(pair(), rpm, tolerances, [TORQUE])
    ratio = np.linspace(0.9, 1.1, 20001)
    stiffness, damping, loss, inertia = (
        NOMINAL[name] * (1.0 if name == "a|b.damping" else ratio) for name in FOUR
    )
    dense = np.array(
        [torque_of(speed, stiffness, damping, loss, inertia).max() for speed in rpm]
    )
    assert (bound[:, 0] >= dense * (1 - 1e-12)).all()
    assert (bound[:, 0] < 1.0205 * dense).all()
    apart, _ = bounds(
        pair(),
        rpm,
        within(0.1, "a|b.stiffness", "a|b.loss_factor", "a.inertia"),
        [TORQUE],
    )
    # Stiffness and inertia in one ratio leave the frequency as it is.
    assert (bound[:, 0] < 0.9 * apart[:, 0]).any()


def test_a_resonance_without_damping_within_the_tolerances_has_no_bound():
    train = pair().replace({"a|b.damping": 0.0, "a|b.loss_factor": 0.0})
    tolerances = [Tolerance(name="a|b.stiffness", low=6e3, high=7.4e3)]
    bound, why = bounds(train, [955.0, 2000.0], tolerances, [TORQUE])
    assert np.isnan(bound[0, 0])
    assert why[0, 0] == "no bound was found, as at a resonance without damping"
    assert (
        bound[1, 0]
        >= torque_of(2000.0, np.linspace(6e3, 7.4e3, 2001), 0.0, 0.0, 1.0).max()
    )


def test_a_singular_matrix_is_no_error_and_its_box_not_regular():
    matrices = np.array([[[2.0, 0.0], [0.0, 4.0]], [[1.0, 1.0], [1.0, 1.0]]])
    solved, regular = _solved(matrices, np.ones((2, 2, 1)))
    assert regular.tolist() == [True, False]
    assert solved[..., 0].tolist() == [
        [0.5, 0.25],
        [0.0, 0.0],
    ]
    # A stiffness down to nothing: half of its range is as large as its middle,
    # |G| d = 1 where no torque alternates.
    train = build(
        [
            Disk(name="a", inertia=1.0),
            Disk(name="b", inertia=INERTIA),
            Shaft(between=("a", "b"), stiffness=5e3, damping=4.0),
            Torque(disk="a", harmonics=[(1.0, DRIVE, 0.0)]),
        ],
        revolutions_per_cycle=1,
    )
    bound, why = bounds(
        train, [955.0], [Tolerance(name="a|b.stiffness", low=0.0, high=1e4)], [TORQUE]
    )
    dense = torque_of(955.0, np.linspace(0.0, 1e4, 100001), 4.0, 0.0, 1.0).max()
    assert why[0, 0] == ""
    assert dense * (1 - 1e-12) <= bound[0, 0] < 1.0205 * dense


def sampled(train, rpm, tolerances, of, count, seed=0):
    """Responses ``(T, Q)`` of the linear train of ``count`` trains within the
    tolerances, and of corners.
    """
    box = box_of(train, tuple(tolerances), tuple(of))
    rng = np.random.default_rng(seed)
    shares = rng.uniform(-1.0, 1.0, (count, len(tolerances)))
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=len(tolerances))))
    shares = np.concatenate([shares, corners[rng.permutation(len(corners))[:1024]]])

    @jax.jit
    @jax.vmap
    def read(u):
        changed = train.replace(box.named(u))
        response = jaxhb.forced_response(changed, rpm=rpm)
        values = [
            QUANTITIES[objective.quantity].exact_value(
                response, objective.of, objective.order, changed
            )
            for objective in of
        ]
        return jnp.stack(values)

    return np.asarray(
        jax.lax.map(read, jnp.asarray(shares.reshape(-1, 16, len(tolerances))))
    ).reshape(-1, len(of))


ASKED = {
    "six_cylinder_diesel": [
        Objective(quantity="shaft torque", of="cyl6|flywheel"),
        Objective(quantity="shaft torque order", of="cyl6|flywheel", order=6.0),
        Objective(quantity="damper power", of="cyl6|flywheel"),
        Objective(quantity="angle", of="pulley"),
    ],
    "engine_with_damper": [
        Objective(quantity="tooth force", of="crank gear|idler"),
        Objective(quantity="tooth force peak", of="crank gear|idler"),
        Objective(quantity="gear torque", of="idler"),
        # The numbers of this damper have tolerances themselves.
        Objective(quantity="shaft torque", of="rubber damper"),
        Objective(quantity="damper power", of="rubber damper"),
        Objective(quantity="damper power", of="viscous damper"),
        Objective(quantity="angle order", of="hub", order=3.0),
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "rpm"), [("six_cylinder_diesel", 1200.0), ("engine_with_damper", 1000.0)]
)
def test_no_train_of_thousands_exceeds_the_bounds(scene, rpm):
    train = jaxhb.load_scene(scene)
    of = ASKED[scene]
    if train.tolerance:
        tolerances = read_tolerances(train)
    else:
        first, second, *_ = train.topology.cylinder_names
        names = ["cyl4|cyl5.stiffness", "cyl5|cyl6.stiffness", "pulley.inertia"]
        names += [
            f"{first}.gas_factor",
            f"{second}.reciprocating_mass",
            "cyl6|flywheel.stiffness",
        ]
        nominal = [float(train.value(name)) for name in names]
        tolerances = [
            Tolerance(name=name, low=0.9 * value, high=1.1 * value)
            for name, value in zip(names, nominal, strict=True)
        ]
    bound, why = bounds(train, [rpm], tolerances, of)
    assert (why == "").all()
    values = sampled(train, rpm, tolerances, of, 2048)
    assert np.isfinite(values).all()
    assert (values <= bound[0] * (1 + 1e-9)).all()
    np.testing.assert_array_less(bound[0], 1.05 * values.max(0))


def parting():
    """Two gears whose mean force holds them together, but not where the drive is
    resonant.
    """
    parts = [
        Disk(name="a", inertia=0.02, radius=0.05),
        Disk(name="b", inertia=0.03, radius=0.05),
        Mesh(between=("a", "b"), stiffness=1e8, damping=2e3, backlash=1e-4),
        Torque(
            name="t",
            disk="a",
            mean=200.0,
            harmonics=[(1.0, 60.0, 0.0), (2.0, 30.0, 10.0)],
        ),
        jaxhb.Load(disk="b"),
        jaxhb.Ground(disk="b", stiffness=1.0),
    ]
    return build(parts, name="gears", reference="a", revolutions_per_cycle=1)


FORCE = Objective(quantity="tooth force", of="a|b")


@pytest.mark.slow
def test_teeth_that_part_in_one_corner_leave_no_bound():
    train = parting()
    rpm = 38800.0

    def tolerances(share):
        nominal = {"a|b.stiffness": 1e8, "b.inertia": 0.03}
        return [
            Tolerance(name=name, low=(1 - share) * value, high=(1 + share) * value)
            for name, value in nominal.items()
        ]

    def apart(share):
        stiffness, inertia = tolerances(share)
        ends = itertools.product(
            (stiffness.low, stiffness.high), (inertia.low, inertia.high)
        )
        corners = [train.replace({"a|b.stiffness": k, "b.inertia": j}) for k, j in ends]
        return [
            jaxhb.solve(corner, rpm=rpm).mesh("a", "b").separated_fraction > 0
            for corner in corners
        ]

    assert apart(0.05) == [False, True, False, False]
    assert apart(0.02) == [False] * 4
    bound, why = bounds(train, [rpm], tolerances(0.05), [FORCE])
    assert np.isnan(bound[0, 0])
    assert why[0, 0] == "teeth of a|b may separate"
    bound, why = bounds(train, [rpm], tolerances(0.02), [FORCE])
    values = sampled(train, rpm, tolerances(0.02), [FORCE], 508)
    assert why[0, 0] == ""
    assert values.max() <= bound[0, 0] < 1.05 * values.max()


@pytest.mark.slow
def test_where_teeth_hammer_there_is_no_bound_and_a_sentence_says_so():
    tolerances = [Tolerance(name="a|b.stiffness", low=0.98e8, high=1.02e8)]
    result = jaxhb.tolerance(
        parting(),
        rpm=[30000.0, 43500.0],
        of=[FORCE],
        tolerances=tolerances,
        harmonics=32,
    )
    assert result.no_bound[:, 0].tolist() == ["", "teeth of a|b may separate"]
    assert result.worst[0, 0] <= result.bound[0, 0] < 1.03 * result.worst[0, 0]
    assert np.isnan(result.bound[1, 0])
    text = "\n\n".join(tolerance_parts(result, None))
    assert (
        "more than stands under 'at most', as long as its teeth stay in contact" in text
    )
    assert "No bound at 43500 rpm: teeth of a|b may separate." in text
    assert "There the worst case is the largest response found: another train" in text
    (row,) = [
        line.split() for line in text.splitlines() if line.startswith("  43500 ")
    ][:1]
    assert row[3] == "-"
    rows = list(tolerance_rows(result, None))
    reasons = [row["no bound"] for row in rows]
    assert reasons == ["", "teeth of a|b may separate"]
    assert np.isnan(rows[1]["bound"])


@pytest.mark.slow
def test_backlash_in_a_closed_loop_preloads_the_teeth():
    # Two meshes side by side: the more play in one, the more of the mean the other
    # carries.
    errors = [(1.0, 2e-6, 0.0), (2.0, 0.0, 1e-6)]
    parts = [Disk(name=n, inertia=0.02, radius=0.05, teeth=20) for n in ("a", "c")]
    parts += [Disk(name=n, inertia=0.03, radius=0.1, teeth=40) for n in ("b", "d")]
    parts += [
        Shaft(between=("a", "c"), stiffness=2e5, damping=20.0),
        Shaft(between=("b", "d"), stiffness=4e5),
    ]
    parts += [
        Mesh(
            between=("a", "b"),
            stiffness=1e8,
            damping=2e3,
            backlash=1e-4,
            first_gear_error=errors,
        )
    ]
    parts += [Mesh(between=("c", "d"), stiffness=1e8, damping=2e3, backlash=1e-4)]
    parts += [
        Torque(
            name="t",
            disk="a",
            mean=400.0,
            harmonics=[(1.0, 60.0, 0.0), (2.0, 30.0, 10.0)],
        )
    ]
    train = build(
        [*parts, jaxhb.Load(disk="b")],
        name="loop",
        reference="a",
        revolutions_per_cycle=1,
    )
    tolerances = [
        Tolerance(name="a|b.backlash", low=0.9e-4, high=1.2e-4),
        Tolerance(name="c|d.stiffness", low=0.9e8, high=1.1e8),
        Tolerance(name="a|c.stiffness", low=1.8e5, high=2.2e5),
        Tolerance(name="t.mean", low=390.0, high=410.0),
    ]
    of = [Objective(quantity="tooth force peak", of=name) for name in ("a|b", "c|d")]
    bound, why = bounds(train, [12000.0], tolerances, of)
    assert (why == "").all()
    box = box_of(train, tuple(tolerances), tuple(of))
    largest = np.zeros(2)
    for u in [
        *itertools.product((-1.0, 1.0), repeat=4),
        *np.random.default_rng(1).uniform(-1.0, 1.0, (10, 4)),
    ]:
        response = jaxhb.solve(train.replace(box.named(np.array(u))), rpm=12000.0)
        peaks = np.array([float(response.force(objective.of).peak) for objective in of])
        assert (peaks <= bound[0] * (1 + 1e-9)).all()
        largest = np.maximum(largest, peaks)
    assert (bound[0] < 1.03 * largest).all()
    preloaded = [
        jaxhb.solve(train.replace({"a|b.backlash": backlash}), rpm=12000.0)
        for backlash in (9e-5, 1.2e-4)
    ]
    less, more = (float(response.force("c|d").mean) for response in preloaded)
    assert more > 1.1 * less


@pytest.mark.slow
def test_what_cannot_be_bounded_says_why():
    train = parting()
    fraction = Objective(quantity="separated fraction", of="a|b")
    _, why = bounds(
        train,
        [30000.0],
        [Tolerance(name="t.mean", low=190.0, high=210.0)],
        [FORCE, fraction],
    )
    assert why[0].tolist() == ["", "no bound of separated fraction is known"]
    _, why = bounds(
        train, [30000.0], [Tolerance(name="a|b.epsilon", low=1e-3, high=2e-3)], [FORCE]
    )
    assert why[0, 0] == "the response is no simple function of a|b.epsilon"
    loose = build(
        [
            *(Disk(name=n, inertia=1.0) for n in "ab"),
            Shaft(between=("a", "b"), stiffness=1e4, clearance=0.1, damping=1.0),
            Torque(disk="a", harmonics=[(1.0, DRIVE, 0.0)]),
        ],
        revolutions_per_cycle=1,
    )
    _, why = bounds(
        loose, [100.0], [Tolerance(name="a.inertia", low=0.9, high=1.1)], [TORQUE]
    )
    assert why[0, 0] == "the stiffness of a|b is not constant"
    result = jaxhb.tolerance(
        train,
        rpm=30000.0,
        of=[FORCE],
        tolerances=[Tolerance(name="t.mean", low=190.0, high=210.0)],
        bounds=False,
    )
    assert np.isnan(result.bound).all()
    assert result.no_bound[0, 0] == "it was not asked for"


@pytest.mark.slow
def test_what_bounds_find_beyond_the_search_counts_as_found(monkeypatch):
    # Without the search only the scene as it is, corners and a few others are known.
    monkeypatch.setattr(
        "jaxhb.design.worst_case._Search.explore", lambda self, seed: None
    )
    monkeypatch.setattr("jaxhb.design.worst_case._Search.climb", lambda self: None)
    tolerances = within(0.1, "a|b.stiffness", "a.inertia")

    def worst_cases(bounds):
        return jaxhb.tolerance(
            pair(), rpm=[955.0], of=[TORQUE], tolerances=tolerances, bounds=bounds
        )

    alone = worst_cases(bounds=False)
    bounded = worst_cases(bounds=True)
    assert bounded.worst[0, 0] > alone.worst[0, 0] == alone.nominal[0, 0]
    worst = bounded.values(0, 0)
    torque = torque_of(955.0, worst["a|b.stiffness"], 4.0, 0.02, worst["a.inertia"])
    assert torque == pytest.approx(bounded.worst[0, 0], rel=1e-5)
    assert bounded.worst[0, 0] <= bounded.bound[0, 0]
