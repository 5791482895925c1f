"""Every table and picture names the geared rotor that makes an order."""

import numpy as np
import pytest

import jaxhb
from jaxhb.linear.critical import campbell
from jaxhb.report.figures import speeds
from jaxhb.report.figures.linear import campbell_figure
from jaxhb.report.figures.speeds import plot_forced
from jaxhb.report.orders import order_names
from jaxhb.report.text.forced import forced_text, readings
from jaxhb.report.text.linear import campbell_text


@pytest.fixture(scope="module")
def train():
    """An engine with a propeller of four blades behind a reduction of 5."""
    parts = [
        jaxhb.Disk(name="engine", inertia=60.0),
        jaxhb.Disk(name="propeller", inertia=900.0),
        jaxhb.Disk(name="pinion", inertia=2.0, radius=0.1),
        jaxhb.Disk(name="wheel", inertia=60.0, radius=0.5),
        jaxhb.Shaft(between=("engine", "pinion"), stiffness=2e5, damping=300.0),
        jaxhb.Shaft(between=("wheel", "propeller"), stiffness=4e6, damping=3000.0),
        jaxhb.Mesh(between=("pinion", "wheel"), stiffness=1e9, damping=2e4),
        jaxhb.Torque(
            disk="engine", mean=4000.0, harmonics=[(1.0, 500.0, 0.0), (3.0, 900.0, 0.0)]
        ),
        jaxhb.Load(disk="propeller", harmonics=[(4.0, 0.1, 0.0), (5.0, 0.1, 0.0)]),
    ]
    return jaxhb.build(parts, reference="engine", revolutions_per_cycle=5, name="plant")


def test_an_order_is_named_by_a_geared_rotor_that_alone_makes_it(train):
    names = order_names(train)
    numbers = [names.number(order) for order in (0.8, 1.0, 3.0)]
    assert numbers == ["0.8 (4 of propeller)", "1", "3"]


@pytest.mark.slow
def test_tables_and_pictures_of_the_linear_train_name_the_rotor(train, monkeypatch):
    rpm = np.linspace(300.0, 750.0, 7)
    names = order_names(train)
    diagram = campbell(train, rpm=rpm, orders=[0.8, 1.0, 3.0], count=2)
    text = campbell_text(diagram, 2, "plant", {}, names)
    assert "Orders: 0.8 (4 of propeller), 1, 3." in text
    figure = campbell_figure(diagram, 2, "plant", names)
    notes = [note["text"] for note in figure.notes]
    assert "0.8 (4 of propeller)" in notes
    response = jaxhb.forced_response(train, rpm=rpm)
    shaft = readings(response, ["wheel|propeller"])
    assert "order 0.8 (4 of propeller)" in forced_text({"": response}, shaft, each=True)
    monkeypatch.setattr(speeds, "drawn", lambda *figures, title: figures)
    figure, *_ = plot_forced({"": response}, shaft)
    assert "order 0.8 (4 of propeller)" in [trace["name"] for trace in figure.traces]
