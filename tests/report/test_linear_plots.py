"""Pictures of the linear train: shapes along its branches, Holzer's residual, the
Campbell diagram.
"""

import numpy as np
import pytest
from trains import build, gearbox_parts

import jaxhb
from jaxhb.linear.critical import campbell
from jaxhb.linear.damped import damping_ratios
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.linear import (
    counting,
    mode_nodes,
    plot_campbell,
    plot_holzer,
    plot_modes,
)
from jaxhb.report.figures.ways import train_lines

DIESEL = "six_cylinder_diesel"
SCENES = ["gear_train_30", "engine_with_damper", DIESEL]


@pytest.mark.parametrize(
    "train", [*map(jaxhb.load_scene, SCENES), build(gearbox_parts(), reference="motor")]
)
def test_every_link_lies_on_one_line_and_branches_begin_on_earlier_lines(train):
    topology = train.topology
    lines = train_lines(topology)
    joined = set()
    links = [
        tuple(sorted(pair))
        for line in lines
        for pair in zip(line, line[1:], strict=False)
    ]
    assert sorted(links) == sorted(tuple(sorted(ends)) for ends in topology.link_ends)
    for number, line in enumerate(lines):
        assert not number or line[0] in joined
        joined.update(line)


@pytest.mark.parametrize("name", SCENES)
def test_the_picture_marks_as_many_nodes_as_the_modes_have(name):
    train = jaxhb.load_scene(name)
    modes = jaxhb.natural_frequencies(train)
    ratios = damping_ratios(train, modes)
    figure = plot_modes(train, modes, [2, 3, 4, 5], ratios)
    for axes, k in zip(figure.axes, (2, 3, 4, 5), strict=True):
        (nodes,) = [line for line in axes.get_lines() if line.get_marker() == "x"]
        assert len(nodes.get_xdata()) == modes.node_count[k]
        (title,) = [text.get_text() for text in axes.texts]
        assert (
            title == f"mode {k}: {modes.frequencies_hz[k]:.4g} Hz, damping ratio"
            f" {ratios[k]:.3g}"
        )


def test_a_disk_at_rest_between_two_that_move_against_each_other_is_one_node():
    assert mode_nodes([[0, 1, 2]], [0], np.array([1.0, 0.0, -1.0])) == [1.0]
    assert mode_nodes([[0, 1], [1, 2]], [0, 3], np.array([1.0, 0.0, -1.0])) == [1.0]
    assert mode_nodes([[0, 1, 2]], [0], np.array([1.0, 0.0, 0.0])) == []
    assert mode_nodes([[0, 1]], [0], np.array([1.0, -3.0])) == [0.25]


def test_angles_refer_to_the_reference_rotor_so_that_teeth_in_contact_do_not_jump():
    parts = [
        jaxhb.Disk(name="a", inertia=0.1, radius=0.1),
        jaxhb.Disk(name="b", inertia=0.1, radius=0.05),
        jaxhb.Disk(name="c", inertia=1.0),
        jaxhb.Shaft(between=("b", "c"), stiffness=1e4),
        jaxhb.Mesh(between=("a", "b"), stiffness=1e12),
    ]
    train = jaxhb.build(parts, reference="a")
    modes = jaxhb.natural_frequencies(train)
    (axes,) = plot_modes(train, modes, [1], np.full(3, np.nan)).axes
    a, b, c = axes.get_lines()[0].get_ydata()
    assert a == pytest.approx(b, rel=1e-6)
    assert b * c < 0
    assert axes.texts[0].get_text() == f"mode 1: {modes.frequencies_hz[1]:.4g} Hz"


def test_the_picture_has_modes_rays_and_circles_at_the_critical_speeds():
    diagram = campbell(
        jaxhb.load_scene(DIESEL), rpm=[1000.0, 2600.0], orders=[3.0, 6.0]
    )
    (axes,) = plot_campbell(diagram, 6, DIESEL).axes
    lines = axes.get_lines()
    (ray,) = [
        line
        for line in lines
        if line.get_linestyle() == "--" and line.get_ydata()[1] == 260.0
    ]
    assert ray.get_ydata()[0] == 100.0
    circles = [line for line in lines if line.get_marker() == "o"]
    places = sorted(np.concatenate([line.get_xdata() for line in circles]))
    assert places == pytest.approx(
        [c.rpm for c in diagram.critical], rel=0.5 * 10 ** (1 - DIGITS)
    )
    filled = [
        line.get_xdata() for line in circles if line.get_markerfacecolor() != "none"
    ]
    assert [len(speeds) for speeds in filled] == [len(counting(diagram))]
    assert {text.get_text().strip() for text in axes.texts} == {
        "mode 0: rigid",
        "mode 1: 216.6 Hz",
        "3",
        "6",
    }


def test_the_picture_has_the_residual_and_its_zeros():
    train = jaxhb.load_scene(DIESEL)
    hz = float(jaxhb.natural_frequencies(train).frequencies_hz[1])
    tables = [(None, jaxhb.holzer_table(train, hz=400.0))]
    figure = plot_holzer(train, tables, {1: hz, 2: 592.7})
    curve, zero, chosen, _ = figure.axes[0].get_lines()
    changes = curve.get_xdata()[:-1][np.diff(np.sign(curve.get_ydata())) != 0]
    assert zero.get_xdata() == pytest.approx([hz], rel=1e-4)
    assert changes == pytest.approx([hz], abs=1.0)
    assert chosen.get_xdata()[0] == 400.0
    below = plot_holzer(train, [(None, jaxhb.holzer_table(train, hz=100.0))], {1: hz})
    assert [text.get_text() for text in below.axes[0].get_legend().get_texts()] == [
        "residual",
        "frequency asked for",
    ]


def test_ticks_of_holzers_residual_are_decades_beyond_the_linear_part_and_0():
    train = jaxhb.load_scene(DIESEL)
    hz = jaxhb.natural_frequencies(train).frequencies_hz.tolist()
    (axes,) = plot_holzer(
        train, [(None, jaxhb.holzer_table(train, hz=hz[1]))], {1: hz[1]}
    ).axes
    ticks = axes.get_yticks()
    decades = np.log10(np.abs(ticks[ticks != 0]))
    np.testing.assert_allclose(decades, np.round(decades))
    linear = axes.yaxis.get_transform().linthresh
    assert 0.0 in ticks
    assert np.abs(ticks[ticks != 0]).min() > linear
    assert len(ticks) >= 3
