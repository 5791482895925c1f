"""Every public verb under ``jit``, ``grad`` and ``vmap`` traces, or says in a sentence
why not and what to do.
"""

import inspect
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxhb
from jaxhb import Cylinder, Disk, Load, Shaft, Torque, build, design
from jaxhb.design import Measured, Objective, Parameter, Tolerance, weak_cylinder

PAIR = jaxhb.load_scene("spur_pair")
MESH = "gear a|gear b"
PLAN = jaxhb.plan(PAIR, rpm=3000.0)
SHAFT = build(
    [
        *(Disk(name=name, inertia=2.0) for name in "ab"),
        Shaft(
            between=("a", "b"),
            stiffness=100.0,
            damping=0.5,
            diameter=0.01,
            power_limit=10.0,
        ),
        Torque(name="drive", disk="a", harmonics=[(1.0, 10.0, 0.0), (2.0, 5.0, 0.0)]),
        Torque(name="other", disk="a", harmonics=[(1.0, 1.0, 0.0)]),
        jaxhb.Phase(name="turn", of=["other"], angle=30.0),
    ],
    revolutions_per_cycle=1,
)
ENGINE = build(
    [
        *(Disk(name=name, inertia=2.0) for name in "ab"),
        Shaft(between=("a", "b"), stiffness=100.0, damping=0.5),
        Cylinder(
            name="one",
            disk="a",
            gas_torque_mean=5.0,
            gas_torque=[(0.5, 3.0, 0.0)],
            firing_angle=0.0,
        ),
        Load(disk="b"),
    ],
)
BURNING = build(
    [
        *(Disk(name=name, inertia=2.0) for name in "ab"),
        Shaft(between=("a", "b"), stiffness=100.0, damping=0.5),
        Cylinder(
            name="one",
            disk="a",
            bore=0.1,
            stroke=0.12,
            rod=0.2,
            combustion=jaxhb.Combustion(
                compression_ratio=16.0,
                charge_pressure=2e5,
                start=-5.0,
                duration=60.0,
                imep=1e6,
            ),
        ),
        Load(disk="b"),
    ],
)
TORQUE = Objective(quantity="shaft torque", of="a|b")
MEASURED = Measured(
    np.full(2, 40.0),
    np.array([1.0, 2.0]),
    ("a|b",) * 2,
    ("torque",) * 2,
    np.ones(2),
    np.full(2, np.nan),
)
MODES = jaxhb.damped_modes(SHAFT)
(CRITICAL,) = jaxhb.campbell(SHAFT, rpm=[20.0, 100.0], orders=[1.0]).critical


def pair(x):
    """Pair of gears with another stiffness."""
    return PAIR.replace({f"{MESH}.stiffness": x * PAIR.value(f"{MESH}.stiffness")})


def shaft(x):
    """Two disks on a shaft with another stiffness."""
    return SHAFT.replace({"a|b.stiffness": 100.0 * x})


def excited(x):
    """Two disks on a shaft with another excitation."""
    return SHAFT.replace({"turn.angle": 30.0 * x})


def solved(x):
    return jaxhb.solve(pair(x), rpm=3000.0, plan=PLAN)


def forced(x):
    return jaxhb.forced_response(shaft(x), rpm=40.0)


def balanced(x):
    """Equations of two harmonics."""
    return jaxhb.harmonic_residual(shaft(x), rpm=40.0, harmonics=2)


ONES = jnp.ones(2 * 5)  # their unknowns: two disks, the mean and two waves
STIFFNESS = Parameter(name="a|b.stiffness", low=50.0, high=200.0)
SPREAD = Tolerance(name="a|b.stiffness", low=90.0, high=110.0)

CALLS = {
    "all_frequencies": lambda x: jaxhb.all_frequencies(shaft(x))[1],
    "at_mean_load": lambda x: jaxhb.at_mean_load(pair(x), rpm=3000.0).stiffness[0],
    "barred_ranges": lambda x: (
        jaxhb.barred_ranges(
            [1.0, 2.0, 3.0],
            x * jnp.array([1.0, 4.0, 1.0]),
            2 * np.ones(3),
            3 * np.ones(3),
        )[0].low
    ),
    "campbell": lambda x: jaxhb.campbell(shaft(x), rpm=[20.0, 100.0]).critical[0].rpm,
    "certify": lambda x: jaxhb.certify(solved(x)).force_bound[0],
    "characteristic_coefficients": lambda x: jnp.sum(
        jaxhb.characteristic_coefficients(shaft(x))[0]
    ),
    "check": lambda x: jaxhb.check(forced(x)).torque("a", "b").rms,
    "cluster_sums_hz": lambda x: jaxhb.cluster_sums_hz(shaft(x), (0, 1)).sum(),
    "clusters_of": lambda x: jaxhb.clusters_of(x * jnp.array([1.0, 2.0])),
    "critical_speed": lambda x: jaxhb.critical_speed(shaft(x), CRITICAL).rpm,
    "cut_off_each": lambda x: jaxhb.cut_off_each(
        ENGINE.replace({"a|b.stiffness": 100.0 * x}), rpm=[40.0]
    ),
    "cylinder_contributions": lambda x: jaxhb.cylinder_contributions(
        ENGINE.replace({"a|b.stiffness": 100.0 * x}),
        lambda response: response.torque("a", "b"),
        rpm=[40.0],
    ).total[0, 0],
    "damped_eigenvalues": (
        lambda x: jnp.abs(jaxhb.damped_eigenvalues(shaft(x), MODES)).sum()
    ),
    "damped_modes": lambda x: jaxhb.damped_modes(shaft(x)).eigenvalues,
    "damping_ratios": lambda x: jaxhb.damping_ratios(
        shaft(x), jaxhb.natural_frequencies(SHAFT)
    )[1],
    "follow": lambda x: jaxhb.follow(pair(x), "rpm", start=3000.0, to=3100.0).value[0],
    "forced_response": lambda x: forced(x).torque("a", "b").rms,
    "frequencies_hz": lambda x: jaxhb.frequencies_hz(shaft(x))[1],
    "gradient_and_error": None,
    "block_sweep": lambda x: jaxhb.block_sweep(balanced(x), ONES, ONES).sum(),
    "harmonic_residual": lambda x: balanced(x)(ONES).sum(),
    "heat_balance": lambda x: jaxhb.heat_balance(shaft(x), rpm=40.0).status,
    "holzer_residual": lambda x: jaxhb.holzer_residual(shaft(x), hz=1.0),
    "holzer_table": lambda x: jaxhb.holzer_table(shaft(x), hz=1.0).residual,
    "measured_orders": (
        lambda x: jaxhb.measured_orders(jnp.arange(9.0), speed=x * jnp.ones(9)).rpm[0]
    ),
    "identify": (
        lambda x: jaxhb.identify(shaft(x), MEASURED, parameters=[STIFFNESS]).values[0]
    ),
    "inertia_and_stiffness": lambda x: jaxhb.inertia_and_stiffness(shaft(x))[1].sum(),
    "integrate": lambda x: jaxhb.integrate(pair(x), rpm=3000.0).elastic.max(),
    "lift_off": lambda x: jaxhb.lift_off(pair(x), rpm=[3000.0, 5000.0]).rpm[0],
    "linear_response": lambda x: (
        jaxhb.linear_response(shaft(x), rpm=40.0 * x).torque("a", "b").rms
    ),
    "misfire_each": (
        lambda x: jaxhb.misfire_each(
            ENGINE.replace({"a|b.stiffness": 100.0 * x}), rpm=[40.0]
        ).firing.rpm[0]
    ),
    "mode_shares": lambda x: jaxhb.mode_shares(shaft(x)).strain_share.sum(),
    "natural_frequencies": (
        lambda x: jaxhb.natural_frequencies(shaft(x)).frequencies_hz[1]
    ),
    "permissible_stress": lambda x: jaxhb.permissible_stress(
        tensile_strength=6e8,
        speed_ratio=0.5 * x,
        diameter=0.4,
        stress_concentration=1.0,
    )[0],
    "plan": lambda x: jaxhb.plan(pair(x), rpm=3000.0).harmonics,
    "plausibility": lambda x: jaxhb.plausibility(shaft(x)),
    "referred": lambda x: jaxhb.referred(shaft(x)).stiffness.sum(),
    "shooting_correction": lambda x: jaxhb.shooting_correction(solved(x)).error,
    "solve": lambda x: jaxhb.solve(pair(x), rpm=3000.0).force(MESH).rms,
    "solve_all": lambda x: len(jaxhb.solve_all(pair(x), rpm=3000.0)),
    "solve_speeds": lambda x: (
        jaxhb.solve_speeds(SHAFT, rpm=40.0 * x * jnp.ones(2)).torque("a", "b").rms[0]
    ),
    "stability": lambda x: jaxhb.stability(solved(x)).largest,
    "steady_state": lambda x: jaxhb.steady_state(pair(x), rpm=3000.0).rpm,
    "strength": lambda x: (
        jaxhb.strength(forced(x), train=shaft(x)).stresses["a|b"].stress
    ),
    "tangential_pressure": lambda x: jaxhb.tangential_pressure(
        BURNING.replace({"one.combustion.imep": 1e6 * x}), "one", rpm=40.0 * x
    ).amplitude[1, 0],
    "tolerance": lambda x: jaxhb.tolerance(
        shaft(x), tolerances=[SPREAD], rpm=[40.0], of=[TORQUE]
    ).worst[0, 0],
    "tooth_damping_ratios": lambda x: sum(
        jnp.sum(v) for v in jax.tree.leaves(jaxhb.tooth_damping_ratios(pair(x)))
    ),
    "torsional_stress": lambda x: jaxhb.torsional_stress(x, diameter=0.1),
    "transient": lambda x: (
        jaxhb.transient(shaft(x), seconds=0.01, speed=600.0, start="rest")
        .torque("a", "b")
        .max
    ),
    "tune": lambda x: (
        jaxhb.tune(shaft(x), parameters=[STIFFNESS], rpm=[40.0], objective=TORQUE).after
    ),
    "tune_transient": lambda x: (
        jaxhb.tune_transient(
            shaft(x),
            parameters=[STIFFNESS],
            objectives=[
                jaxhb.design.TransientObjective(
                    name="torque",
                    value=lambda motion: motion.torque("a", "b").max,
                    seconds=0.01,
                    speed=600.0,
                )
            ],
        ).after.objective
    ),
    "weak_cylinder": (
        lambda x: weak_cylinder(
            ENGINE.replace({"a|b.stiffness": 100.0 * x}), MEASURED
        ).std[0]
    ),
    "vector_sums": lambda x: jnp.abs(
        jaxhb.vector_sums(ENGINE.replace({"one.firing_angle": 10.0 * x})).sums[0]
    ),
    "worst_phase": (
        lambda x: jaxhb.worst_phase(excited(x), "turn", rpm=[40.0], of=[TORQUE]).worst[
            0, 0
        ]
    ),
    "build": lambda x: build([Disk(name="a", inertia=x)]),
    "response.mesh": lambda x: solved(x).mesh(MESH).separated_fraction,
    "response.to_xarray": lambda x: forced(x).to_xarray(),
    "response.status_name": lambda x: len(forced(x).status_name) * x,
    "response.highest_harmonic": lambda x: forced(x).highest_harmonic * x,
    "if response": lambda x: bool(forced(x)) * x,
    "signal.summary": lambda x: forced(x).torque("a|b").summary(),
}
WITHOUT_NUMBERS = {
    "cache_programs",
    "campaign",
    "load_scene",
    "load_study",
    "scene_names",
    "scene_text",
    "scene_workbook",
    "read_recorded",
    "elements_text",
    "read_measured",
    "read_tolerances",
}
"""Verbs that take no numbers."""
FORMULAS = {
    "characteristic",
    "damped_approximation",
    "frequency_response",
    "kinetic_energy",
    "strain_energy",
    "shaft_stiffness",
    "viscous_damping",
}
"""Formulas whose derivatives are compared where they are tested."""

WAYS = {
    "jit": lambda f: jax.jit(f)(1.0),
    "grad": lambda f: jax.grad(f)(1.0),
    "vmap": lambda f: jax.vmap(f)(jnp.ones(2)),
}


def test_every_public_verb_is_tried():
    verbs = {
        name
        for name in (*jaxhb.__all__, *design.__all__)
        if inspect.isfunction(getattr(jaxhb, name, None))
    }
    verbs |= {
        name for name in design.__all__ if inspect.isfunction(getattr(design, name))
    }
    assert verbs <= {*CALLS, *WITHOUT_NUMBERS, *FORMULAS}


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, call in CALLS.items() if call])
def test_a_verb_traces_or_says_why_not_and_what_to_do(name):
    for way, transformed in WAYS.items():
        try:
            value = transformed(CALLS[name])
        except (TypeError, ValueError) as refusal:
            sentence = str(refusal)
            answer = f"{way}: {sentence}"
            assert not isinstance(refusal, jax.errors.JAXTypeError), answer
            assert "\n" not in sentence, answer
            assert "outside" in sentence or "train.replace" in sentence, answer
            assert any(word in sentence for word in ("jit", "vmap", "grad")), answer
        else:
            assert np.isfinite(np.asarray(value)).all(), way


def test_the_linear_response_has_derivatives_by_the_excitation_and_the_speed():
    def swing(x):
        train = SHAFT.replace({"drive.harmonics": [[10.0 * x, 0.0], [5.0 * x, 0.0]]})
        return jaxhb.linear_response(train, rpm=40.0).torque("a", "b").order(2.0)

    # A linear train: the amplitude of an order that this torque alone excites is
    # proportional to it.
    assert float(jax.jit(jax.grad(swing))(1.0)) == pytest.approx(
        float(swing(1.0)), rel=1e-9
    )


@pytest.mark.parametrize(
    ("rpm", "sentence"),
    [
        ("4000", "the speed is '4000', must be a number"),
        (True, "the speed is True, must be a number"),
        (4000j, "the speed is 4000j, must be a number"),
        (None, "the speed is None, must be a number"),
        (np.nan, "the speed is nan rpm, must be greater than 0"),
        (-1.0, "the speed is -1 rpm, must be greater than 0"),
        ([[1.0, 2.0]], "the speeds are an array of 1 x 2, must be numbers in one row"),
        ([[1.0], [2.0, 3.0]], "must be a number"),
    ],
)
def test_what_is_no_speed_is_refused_in_a_sentence_by_every_verb(rpm, sentence):
    verbs = [
        jaxhb.solve,
        jaxhb.plan,
        jaxhb.linear_response,
        jaxhb.solve_speeds,
        jaxhb.steady_state,
        jaxhb.solve_all,
        jaxhb.forced_response,
        jaxhb.heat_balance,
        jaxhb.campbell,
        jaxhb.integrate,
        jaxhb.at_mean_load,
        jaxhb.lift_off,
    ]
    calls = [partial(verb, PAIR, rpm=rpm) for verb in verbs]
    calls += [
        partial(jaxhb.solve, PAIR, rpm=rpm, plan=PLAN),
        partial(jaxhb.misfire_each, ENGINE, rpm=rpm),
        partial(jaxhb.tune, SHAFT, parameters=[STIFFNESS], rpm=rpm, objective=TORQUE),
        partial(jaxhb.tolerance, SHAFT, tolerances=[SPREAD], rpm=rpm, of=[TORQUE]),
        partial(jaxhb.worst_phase, SHAFT, "turn", rpm=rpm),
    ]
    if not isinstance(rpm, list):
        calls += [partial(jaxhb.follow, PAIR, "rpm", start=rpm, to=3000.0)]
    for call in calls:
        with pytest.raises(jaxhb.SceneError) as refusal:
            call()
        assert sentence in str(refusal.value), call
