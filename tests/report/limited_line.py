"""A line of shafts with limits of stresses, tooth torques and heat."""

import numpy as np
from reference_data import text_of

import jaxhb

SCENE = text_of("limited_line.toml")


def write_scene(folder):
    """Write the scene to a file of a folder."""
    path = folder / "line.toml"
    path.write_text(SCENE)
    return path


def strength_of(scene):
    """The linear forced response at 23 speeds beside its limits."""
    rpm = np.linspace(300.0, 960.0, 23)
    return jaxhb.strength(jaxhb.forced_response(jaxhb.load_scene(scene), rpm=rpm))
