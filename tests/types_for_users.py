"""Types that a checker finds for the public names in a user's program; ``python -m
mypy`` reads it, nothing runs it.
"""

from typing import Any, assert_type

import jax
import numpy as np

import jaxhb
from jaxhb.design import Objective, Parameter

train = jaxhb.load_scene("gear_train_30")
assert_type(train, jaxhb.DriveTrain)
assert_type(train.replace({"crank damper.damping": 300.0}), jaxhb.DriveTrain)

r = jaxhb.check(jaxhb.solve(train, rpm=1800.0))
assert_type(r, jaxhb.Response)
assert_type(r.force("crank gear", "idler"), jaxhb.Signal)
assert_type(r.force("crank gear", "idler").max, jax.Array | np.ndarray)
assert_type(r.power("crank damper"), jax.Array | np.ndarray)

sweep = jaxhb.solve_speeds(train, rpm=np.linspace(700, 2450, 8))
assert_type(sweep[4], jaxhb.Response)

assert_type(jaxhb.steady_state(train, rpm=1800.0).kind, str)
assert_type(jaxhb.steady_state(train, rpm=1800.0).irregularity("crank gear"), float)
assert_type(jaxhb.steady_state(train, rpm=[1700.0, 1800.0]), jaxhb.SteadySweep)
up, down = jaxhb.steady_state(train, rpm=[1700.0, 1800.0], direction="both")
assert_type(up, jaxhb.SteadySweep)

forced = jaxhb.forced_response(train, rpm=1800.0)
assert_type(forced[0], jaxhb.ForcedResponse)
assert_type(train.value("crank damper.damping"), Any)

A = jaxhb.harmonic_residual(train, rpm=1800.0, harmonics=32)
assert_type(A, jaxhb.HarmonicResidual)
assert_type(
    jaxhb.block_sweep(A, A.pack(r.angles), A(A.pack(r.angles))), jax.Array | np.ndarray
)
assert_type(A.size, int)

damping = Parameter(name="crank damper.damping", low=20.0, high=600.0)
force = Objective(quantity="tooth force", of="crank gear|idler")
assert_type(
    jaxhb.tune(train, parameters=[damping], rpm=[1800.0], objective=force).train,
    jaxhb.DriveTrain,
)
