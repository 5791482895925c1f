"""Everything that a user meets in a session: names, types, short lines for results,
tables in notebooks, read-only trains.
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
from jaxhb.design.task import Reading
from jaxhb.design.tuning import Tuning
from jaxhb.results.contact import Contact
from jaxhb.results.record import RecordedSignal, SteadyContact, SteadySignal

RESULTS = (Contact, RecordedSignal, SteadyContact, SteadySignal)


def public_functions():
    """Every public function, method and property with its qualified name."""
    public = {name: getattr(jaxhb, name) for name in jaxhb.__all__}
    public |= {name: getattr(design, name) for name in design.__all__}
    public |= {cls.__name__: cls for cls in RESULTS}
    public |= {
        f"objectives.{name}": value
        for name, value in vars(objectives).items()
        if getattr(value, "__module__", "") == objectives.__name__
    }
    for name, value in public.items():
        if not inspect.isclass(value):
            yield name, value
            continue
        for member, inner in vars(value).items():
            if not member.startswith("_") or member in ("__len__", "__getitem__"):
                if isinstance(inner, functools.cached_property):
                    inner = inner.func
                if isinstance(inner, property):
                    inner = inner.fget
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
        if inspect.Signature.empty in (*kinds, signature.return_annotation):
            missing.append(name)
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


@pytest.mark.slow
def test_results_print_as_one_short_line(train, forced):
    results = [
        train,
        train.meshes,
        forced,
        forced[3],
        forced.force("crank gear", "idler"),
        forced[3].disk("hub"),
        jaxhb.natural_frequencies(train),
        jaxhb.damped_modes(train),
        jaxhb.referred(train),
        jaxhb.campbell(train, rpm=[600.0, 2450.0]),
    ]
    for result in results:
        assert "\n" not in repr(result), repr(result)
        assert len(repr(result)) < 700, repr(result)
    assert repr(train).startswith(
        "<DriveTrain gear_train_30: 24 disks, 19 shafts, 4 meshes, 3 dampers, 1"
        " ground, "
    )
    expected = (
        "<ForcedResponse of gear_train_30 at 30 speeds from 600 to 2450 rpm: 30"
        " CONVERGED, 24 harmonics>"
    )
    assert repr(forced) == expected
    assert repr(forced[0]).startswith(
        "<ForcedResponse of gear_train_30 at 600 rpm: CONVERGED, 24 harmonics"
    )


def test_a_tuning_of_a_few_steps_tells_their_number_alone():
    reading = Reading({"a.inertia": 1.0}, np.ones(2, bool), {"angle of a": np.ones(2)})
    steps = tuple(
        Step(k, 1.0, {"a.inertia": 1.0}, 0.1, 2, 0.1, 0, k, "2 speeds", 1.0)
        for k in range(3)
    )
    tuning = Tuning(
        train=jaxhb.load_scene("spur_pair"),
        history=steps,
        outcomes=(),
        rpm=np.ones(2),
        before=reading,
        after=reading,
        stopped="",
        interrupted=False,
    )
    assert "history=3 of Step, " in repr(tuning)
    assert len(repr(tuning)) < 700


def test_lines_and_tables_of_steady_states_have_kind_and_numbers():
    sweep = jaxhb.steady_state(
        jaxhb.load_scene("six_cylinder_diesel"), rpm=[1200.0, 1500.0]
    )
    assert repr(sweep) == "<SteadySweep up, 2 speeds from 1200 to 1500 rpm: 2 periodic>"
    assert repr(sweep[1]).startswith(
        "<SteadyState of six_cylinder_diesel at 1500 rpm: periodic; CONVERGED, "
    )
    heads = [row[:2] for row in cells(sweep._repr_html_())]
    assert heads == [["rpm", "motion"], ["1200", "periodic"], ["1500", "periodic"]]
    largest = f"{float(sweep[1].torque('cyl6', 'flywheel').max):.4g}"
    largest_of_link = {row[0]: row[3] for row in cells(sweep[1]._repr_html_())}
    assert largest in largest_of_link["cyl6|flywheel"]


def cells(text):
    """Cells of the rows of a table in HTML."""
    return [
        re.findall(r"<t[dh]>(.*?)</t[dh]>", row)
        for row in re.findall(r"<tr>(.*?)</tr>", text)
    ]


@pytest.mark.slow
def test_tables_in_notebooks_have_the_numbers_of_the_response(forced):
    response = forced[3]
    rows = {row[0]: row for row in cells(response._repr_html_())}
    force = response.force("crank gear", "idler")
    numbers = [
        f"{float(v):.4g}" for v in (force.mean, force.half_peak_to_peak, force.max)
    ]
    assert rows["crank gear|idler"][1:4] == numbers
    assert rows["crank damper"][4] == "N m"
    table = cells(forced._repr_html_())
    assert len(table) == 1 + 20
    assert table[20][0] == f"{float(forced[19].rpm):.4g}"
    failed = dataclasses.replace(response, status=np.asarray(4))
    # The last iterate of a solve that failed is no motion: its numbers are in no table.
    assert not cells(failed._repr_html_())
    assert "STALLED" in failed._repr_html_()


@pytest.mark.slow
def test_traced_results_print_without_their_numbers(train):
    def peak(damping):
        changed = train.replace({"crank damper.damping": damping})
        response = jaxhb.linear_response(changed, rpm=1800.0)
        assert "traced" in repr(response)
        assert "traced" in repr(response.force("crank gear", "idler"))
        assert "traced" in repr(changed.dampers)
        return response.load_power

    jax.eval_shape(peak, 220.0)


@pytest.mark.slow
def test_a_status_prints_its_name(forced):
    assert f"{jaxhb.Status(3)} {jaxhb.Status.CONVERGED:>10}" == "MAX_STEPS  CONVERGED"
    assert jaxhb.Status(3) == 3
    assert forced[0].status_name == "CONVERGED"
    assert forced.status_name.tolist() == ["CONVERGED"] * 30


@pytest.mark.slow
def test_arrays_of_a_train_cannot_be_changed_in_place(train):
    changed = train.replace({"hub.inertia": 0.5, "crank damper.damping": 300.0})
    trains = [
        train,
        changed,
        train.with_viscous_damping(hz=100.0),
        train.misfire("cylinder A1"),
    ]
    for leaf in jax.tree.leaves(trains):
        with pytest.raises(ValueError, match="read-only"):
            leaf[...] = 0.0
    inertia = np.array(train.disks.inertia)
    disks = dataclasses.replace(train.disks, inertia=inertia)
    # An array of the user stays the user's.
    inertia[0] = 7.0
    assert disks.inertia[0] == 7.0
    assert not disks.inertia.flags.writeable


@pytest.mark.slow
def test_parts_that_keys_of_programs_are_made_of_print_whole(train):
    other = dataclasses.replace(train.topology, teeth=(*train.topology.teeth[:-1], 99))
    assert repr(other) != repr(train.topology)
    assert len(repr(train.topology)) > 1000


@pytest.mark.slow
def test_samples_that_miss_the_peak_are_warned_of_with_a_count_that_does_not(forced):
    signal = forced[20].force("crank gear", "idler")
    with pytest.warns(
        UserWarning,
        match=r"30 samples miss the peak of the signal by [\d.]+ %: take \d+,",
    ) as record:
        coarse = signal.samples(30)
    assert record[0].filename == __file__
    enough = int(str(record[0].message).split("take ")[1].split(",")[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (
            abs(signal.samples(enough)).max() >= 0.99 * signal.peak > abs(coarse).max()
        )
        jax.jit(lambda s: s.samples(30))(signal)


@pytest.mark.slow
def test_a_response_that_has_lost_its_train_is_refused_with_a_sentence(forced):
    lost = jax.tree.map(np.asarray, forced[0])
    with pytest.raises(
        ValueError,
        match="comes out of a transformation without its train: solve outside of it",
    ):
        jaxhb.shooting_correction(lost)
