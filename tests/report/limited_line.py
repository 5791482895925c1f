"""A line of shafts with limits: of stresses, tooth torques and heat."""

import numpy as np

import jaxhb

SCENE = """
[scene]
name = "line"
reference = "engine"
rated_rpm = 900
[[disk]]
name = "engine"
inertia = 20.0
damping = 2.0
[[disk]]
name = "pinion"
inertia = 1.0
radius = 0.1
[[disk]]
name = "wheel"
inertia = 8.0
radius = 0.3
[[disk]]
name = "propeller"
inertia = 90.0
damping = 20.0
[[shaft]]
name = "coupling"
between = ["engine", "pinion"]
stiffness = 1e5
magnifier = 12
damping_hz = 15
power_limit = 300
[[shaft]]
name = "line shaft"
between = ["wheel", "propeller"]
length = 3.0
outer = 0.11
shear_modulus = 8e10
damping_ratio = 0.01
damping_hz = 15
stress_concentration = 0.45
tensile_strength = 5e8
[[mesh]]
between = ["pinion", "wheel"]
stiffness = 5e8
damping = 2e4
rated_torque = 1500
[[damper]]
name = "ring"
disk = "engine"
inertia = 3.0
damping = 100.0
power_limit = 40
[[load]]
disk = "propeller"
[[torque]]
disk = "engine"
mean = 1200.0
harmonics = [[0.5, 100.0, 0.0], [1.5, 1100.0, 300.0], [3.0, 150.0, 0.0]]
scale = [[300, 0.4], [900, 1.0]]
"""


def written(folder):
    """The scene as a file in a folder of its own."""
    path = folder / "line.toml"
    path.write_text(SCENE)
    return path


def strength_of(scene):
    """What the linear forced response does beside the limits, at 23 speeds."""
    return jaxhb.strength(jaxhb.forced_response(jaxhb.load_scene(scene), rpm=np.linspace(300.0, 960.0, 23)))
