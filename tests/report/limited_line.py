"""A line of shafts with limits: of stresses, tooth torques and heat."""

import numpy as np
from reference_data import text_of

import jaxhb

SCENE = text_of("limited_line.toml")


def written(folder):
    """The scene as a file in a folder of its own."""
    path = folder / "line.toml"
    path.write_text(SCENE)
    return path


def strength_of(scene):
    """What the linear forced response does beside the limits, at 23 speeds."""
    return jaxhb.strength(
        jaxhb.forced_response(
            jaxhb.load_scene(scene), rpm=np.linspace(300.0, 960.0, 23)
        )
    )
