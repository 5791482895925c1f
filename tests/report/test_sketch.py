"""The sketch of a train: gears in mesh touch, nothing overlaps, names can be read."""

import itertools

import numpy as np
import pytest
from reference_data import DATA
from trains import build, gearbox_parts

import jaxhb
from jaxhb.report.figures.layout import Layout, disk_radii
from jaxhb.report.figures.sketch import plot_train

TOUCHING = {
    "gear_train_30": 4,
    "engine_with_damper": 3,
    "six_cylinder_diesel": 0,
    "spur_pair": 1,
    "branched": 1,
    "loop": 1,
}
"""Pairs of gears that touch in the sketch of a train: all of a scene of the package, one
of three where branches or loops leave no place for more.
"""


def branched():
    """A crankshaft with branches of shafts at one disk, a ring, and two rotors in mesh,
    which have branches too.
    """
    return jaxhb.load_scene(DATA / "scenes" / "branched.toml")


def train_of(name):
    if name == "branched":
        return branched()
    if name == "loop":
        return build(gearbox_parts(), reference="motor")
    return jaxhb.load_scene(name)


@pytest.mark.parametrize("name", TOUCHING)
def test_gears_in_mesh_touch_and_other_circles_lie_apart(name):
    train = train_of(name)
    layout = Layout(train)
    topology = train.topology
    mates = {frozenset(topology.link_ends[link]) for link in layout.touching}
    assert len(mates) == TOUCHING[name]
    if name in jaxhb.scene_names():
        assert len(mates) == len(topology.mesh_names)
    size = np.maximum(layout.disk, layout.pitch)
    for a, b in itertools.combinations(range(topology.n_disks), 2):
        distance = np.hypot(layout.x[a] - layout.x[b], layout.y[a] - layout.y[b])
        if frozenset((a, b)) in mates:
            np.testing.assert_allclose(
                distance, layout.pitch[a] + layout.pitch[b], rtol=1e-9
            )
        else:
            assert distance > size[a] + size[b]


@pytest.mark.parametrize("name", TOUCHING)
def test_every_disk_has_its_name_and_no_name_lies_on_another_or_on_a_disk(name):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    train = train_of(name)
    figure = plot_train(train)
    renderer = FigureCanvasAgg(figure).get_renderer()
    (axes,) = figure.axes
    assert sorted(text.get_text() for text in axes.texts) == sorted(
        [*train.topology.disk_names, train.topology.name]
    )
    boxes = [text.get_window_extent(renderer) for text in axes.texts]
    boxes.append(axes.get_legend().get_window_extent(renderer))
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]
    disks = [patch.get_window_extent(renderer) for patch in axes.patches]
    assert len(disks) == train.topology.n_disks
    assert not [(box, disk) for box in boxes for disk in disks if box.overlaps(disk)]
    for box in boxes:
        assert figure.bbox.x0 <= box.x0
        assert box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0
        assert box.y1 <= figure.bbox.y1


def test_radii_grow_with_the_fourth_root_of_inertias_and_in_proportion_to_gears():
    disk, pitch = disk_radii(branched())
    names = branched().topology.disk_names
    assert disk[names.index("crank")] / disk[names.index("flywheel")] == pytest.approx(
        (2 / 9) ** 0.25
    )
    assert pitch[names.index("gear 1")] / pitch[names.index("gear 3")] == pytest.approx(
        1 / 3
    )
    assert disk.argmin() == names.index("wheel")
    assert not pitch[names.index("crank")]


def test_a_shaft_that_closes_a_loop_passes_the_disks_between_its_ends():
    parts = [jaxhb.Disk(name=name, inertia=0.1) for name in "abc"]
    parts += [
        jaxhb.Shaft(between=ends, stiffness=1e4)
        for ends in (("a", "b"), ("b", "c"), ("c", "a"))
    ]
    train = jaxhb.build(parts, revolutions_per_cycle=1)
    layout = Layout(train)
    curves = [line.get_xydata() for line in plot_train(train).axes[0].lines]
    points = np.concatenate([curve for curve in curves if len(curve) > 2])
    distances = np.hypot(points[:, 0] - layout.x[1], points[:, 1] - layout.y[1])
    assert distances.min() > layout.disk[1]


def test_scene_draws_the_train_prints_it_on_request_and_refuses_401_disks(
    tmp_path, run
):
    completed = run("scene spur_pair", "plot")
    assert completed.out == f"{completed.path('plot')} is written.\n"
    completed = run("scene spur_pair --expand", "plot")
    assert "[[mesh]]" in completed.out
    rows = "".join(f"d{i},1\n" for i in range(401))
    links = "".join(f"d{i},d{i + 1},1e5\n" for i in range(400))
    long = tmp_path / "long.csv"
    long.write_text(f"name,inertia\n{rows}\nfrom,to,stiffness\n{links}")
    completed.path("plot").unlink()
    completed = run(f"scene {long}", "plot", status=2)
    assert "401 disks" in completed.err
    assert not completed.path("plot").exists()
