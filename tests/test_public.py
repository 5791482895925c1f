"""What a user meets in a session: names, types, short lines for results, tables in
notebooks, read-only trains.
"""

import dataclasses
import functools
import inspect
import re
import warnings

import jax
import numpy as np
import pytest

import jaxhb
from jaxhb import design
from jaxhb.design import objectives
from jaxhb.design.descent import Step
from jaxhb.design.evaluation import Reading
from jaxhb.design.tuning import Tuning
from jaxhb.results.contact import Contact
from jaxhb.results.display import response_html
from jaxhb.results.record import RecordedSignal, SteadyContact, SteadySignal

RESULTS = (Contact, RecordedSignal, SteadyContact, SteadySignal)


def public_functions():
    """Every public function, method and property with its qualified name."""
    found = {name: getattr(jaxhb, name) for name in jaxhb.__all__}
    found |= {name: getattr(design, name) for name in design.__all__} | {
        cls.__name__: cls for cls in RESULTS
    }
    own = {
        name: f
        for name, f in vars(objectives).items()
        if getattr(f, "__module__", "") == objectives.__name__
    }
    found |= {f"objectives.{name}": f for name, f in own.items()}
    for name, value in found.items():
        if not inspect.isclass(value):
            yield name, value
            continue
        for member, inner in vars(value).items():
            if not member.startswith("_") or member in ("__len__", "__getitem__"):
                inner = (
                    inner.func
                    if isinstance(inner, functools.cached_property)
                    else inner
                )
                inner = inner.fget if isinstance(inner, property) else inner
                if inspect.isfunction(inner):
                    yield f"{name}.{member}", inner


def test_every_public_function_says_its_types():
    missing = []
    for name, function in public_functions():
        if (
            name.startswith("objectives._")
            or function.__module__.split(".")[0] != "jaxhb"
        ):
            continue
        signature = inspect.signature(function)
        kinds = [
            p.annotation for p in signature.parameters.values() if p.name != "self"
        ]
        missing += (
            [name]
            if inspect.Signature.empty in (*kinds, signature.return_annotation)
            else []
        )
    assert missing == []


def test_dir_lists_the_public_names_and_help_begins_with_a_map():
    assert set(dir(jaxhb)) == {*jaxhb.__all__, "__doc__", "__version__", "design"}
    table = jaxhb.__doc__.split("=====\n")[1]
    named = {word.strip(".,:;()") for word in table.split()}
    assert {
        "load_scene",
        "solve",
        "steady_state",
        "forced_response",
        "tune",
        "strength",
        "certify",
    } <= named


@pytest.fixture(scope="module")
def train():
    return jaxhb.load_scene("gear_train_30")


@pytest.fixture(scope="module")
def forced(train):
    return jaxhb.forced_response(train, rpm=np.linspace(600, 2450, 30))


def test_results_print_as_one_short_line(train, forced):
    results = [
        train,
        train.meshes,
        forced,
        forced[3],
        forced.force("crank gear", "idler"),
        forced[3].disk("hub"),
    ]
    results += [
        jaxhb.natural_frequencies(train),
        jaxhb.damped_modes(train),
        jaxhb.referred(train),
    ]
    results.append(jaxhb.campbell(train, rpm=[600.0, 2450.0]))
    for result in results:
        assert "\n" not in repr(result) and len(repr(result)) < 700, repr(result)
    assert repr(train).startswith(
        "<DriveTrain gear_train_30: 24 disks, 19 shafts, 4 meshes, 3 dampers, 1"
        " ground, "
    )
    said = (
        "<ForcedResponse of gear_train_30 at 30 speeds from 600 to 2450 rpm: 30"
        " CONVERGED, 24 harmonics>"
    )
    assert repr(forced) == said
    assert repr(forced[0]).startswith(
        "<ForcedResponse of gear_train_30 at 600 rpm: CONVERGED, 24 harmonics"
    )


def test_a_tuning_of_a_few_steps_tells_their_number_alone():
    reading = Reading({"a.inertia": 1.0}, np.ones(2, bool), {"angle of a": np.ones(2)})
    steps = tuple(
        Step(k, 1.0, {"a.inertia": 1.0}, 0.1, 2, 0.1, 0, k, "2 speeds", 1.0)
        for k in range(3)
    )
    given = {
        "rpm": np.ones(2),
        "before": reading,
        "after": reading,
        "stopped": "",
        "interrupted": False,
    }
    tuning = Tuning(
        train=jaxhb.load_scene("spur_pair"), history=steps, outcomes=(), **given
    )
    assert "history=3 of Step, " in repr(tuning) and len(repr(tuning)) < 700


def test_lines_and_tables_of_steady_states_have_kind_and_numbers():
    sweep = jaxhb.steady_state(
        jaxhb.load_scene("six_cylinder_diesel"), rpm=[1200.0, 1500.0]
    )
    assert repr(sweep) == "<SteadySweep up, 2 speeds from 1200 to 1500 rpm: 2 periodic>"
    assert repr(sweep[1]).startswith(
        "<SteadyState of six_cylinder_diesel at 1500 rpm: periodic; CONVERGED, "
    )
    told = [row[:2] for row in cells(sweep._repr_html_())]
    assert told == [["rpm", "motion"], ["1200", "periodic"], ["1500", "periodic"]]
    largest = f"{float(sweep[1].torque('cyl6', 'flywheel').max):.4g}"
    assert (
        largest
        in {row[0]: row[3] for row in cells(sweep[1]._repr_html_())}["cyl6|flywheel"]
    )


def cells(text):
    """The cells of the rows of a table in HTML."""
    return [
        re.findall(r"<t[dh]>(.*?)</t[dh]>", row)
        for row in re.findall(r"<tr>(.*?)</tr>", text)
    ]


def test_tables_in_notebooks_have_the_numbers_of_the_response(forced):
    one = forced[3]
    rows = {row[0]: row for row in cells(one._repr_html_())}
    force = one.force("crank gear", "idler")
    told = [f"{float(v):.4g}" for v in (force.mean, force.half_peak_to_peak, force.max)]
    assert rows["crank gear|idler"][1:4] == told
    assert rows["crank damper"][4] == "N m"
    several = cells(forced._repr_html_())
    assert len(several) == 1 + 20 and several[20][0] == f"{float(forced[19].rpm):.4g}"
    failed = dataclasses.replace(one, status=np.asarray(4))
    # The last iterate of a solve that failed is no motion: its numbers are in no table.
    assert not cells(response_html(failed)) and "STALLED" in response_html(failed)


def test_traced_results_print_without_their_numbers(train):
    def peak(damping):
        changed = train.replace({"crank damper.damping": damping})
        response = jaxhb.linear_response(changed, rpm=1800.0)
        assert "traced" in repr(response) and "traced" in repr(
            response.force("crank gear", "idler")
        )
        assert "traced" in repr(changed.dampers)
        return response.load_power

    jax.eval_shape(peak, 220.0)


def test_a_status_prints_its_name(forced):
    assert (
        f"{jaxhb.Status(3)} {jaxhb.Status.CONVERGED:>10}" == "MAX_STEPS  CONVERGED"
        and jaxhb.Status(3) == 3
    )
    assert forced[0].status_name == "CONVERGED"
    assert forced.status_name.tolist() == ["CONVERGED"] * 30


def test_arrays_of_a_train_cannot_be_changed_in_place(train):
    changed = train.replace({"hub.inertia": 0.5, "crank damper.damping": 300.0})
    for leaf in jax.tree.leaves(
        [
            train,
            changed,
            train.with_viscous_damping(hz=100.0),
            train.misfire("cylinder A1"),
        ]
    ):
        with pytest.raises(ValueError, match="read-only"):
            leaf[...] = 0.0
    given = np.array(train.disks.inertia)
    held = dataclasses.replace(train.disks, inertia=given)
    given[0] = 7.0  # an array of the user's own stays his
    assert held.inertia[0] == 7.0 and not held.inertia.flags.writeable


def test_parts_that_keys_of_programs_are_made_of_print_whole(train):
    other = dataclasses.replace(train.topology, teeth=(*train.topology.teeth[:-1], 99))
    assert repr(other) != repr(train.topology) and len(repr(train.topology)) > 1000


def test_samples_that_miss_the_peak_are_warned_of_with_a_count_that_does_not(forced):
    signal = forced[20].force("crank gear", "idler")
    with pytest.warns(
        UserWarning,
        match=r"30 samples miss the peak of the signal by [\d.]+ %: take \d+,",
    ) as told:
        coarse = signal.samples(30)
    assert told[0].filename == __file__
    enough = int(str(told[0].message).split("take ")[1].split(",")[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (
            abs(signal.samples(enough)).max() >= 0.99 * signal.peak > abs(coarse).max()
        )
        jax.jit(lambda s: s.samples(30))(signal)


def test_a_response_that_has_lost_its_train_is_refused_with_a_sentence(forced):
    lost = jax.tree.map(np.asarray, forced[0])
    with pytest.raises(
        ValueError,
        match="comes out of a transformation without its train: solve outside of it",
    ):
        jaxhb.shooting_correction(lost)
