"""Sweeps end at the solution of harmonic balance, whatever their march does wrong.

Second ways: Newton's method on the same equations (``jaxhb.solve``), a march with twice the steps, closed forms.
"""

import dataclasses
from functools import partial

import jax
import numpy as np
import pytest

import jaxhb
from jaxhb.balance.map_newton import solve_map
from jaxhb.balance.march import InstantSolve, modes_for_march
from jaxhb.balance.plan import Request
from jaxhb.balance.problem import problem_at, reduced_equation
from jaxhb.balance.sweeps import (
    SweepPlan,
    SweepPoint,
    equation_program,
    first_point,
    force_size,
    settle_program,
    sweep,
    vibration_size,
)
from jaxhb.elements.elements import Damper, Disk, Ground, Mesh, Shaft, Torque
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.solutions import planning
from jaxhb.train.assembly import build

RPM = 600.0
STEPS = 512
GOAL = 1e-7  # change of the motion in the last sweep


def pair(*, mesh=(), coupling=(), gear_inertia=0.03, ground=True, more=()):
    """A flywheel with a ring, two gears whose teeth part at RPM, and what they drive."""
    teeth = {"stiffness": 1e7, "damping": 1500.0, "backlash": 2e-4}
    teeth |= {"epsilon": 1e-3, "transition": 0.1}
    shaft = {"stiffness": 1e4, "damping": 8.0}
    parts = [
        Disk(name="flywheel", inertia=2.0, damping=0.5),
        Disk(name="gear a", inertia=0.01, radius=0.05, teeth=20),
        Disk(name="gear b", inertia=gear_inertia, radius=0.1, teeth=40),
        Disk(name="driven", inertia=0.1, damping=1.0),
        Shaft(between=("flywheel", "gear a"), stiffness=2e4, damping=8.0),
        Shaft(between=("gear b", "driven"), **(shaft | dict(coupling))),
        Mesh(between=("gear a", "gear b"), **(teeth | dict(mesh))),
        Damper(name="ring", disk="flywheel", inertia=0.2, damping=20.0),
        Torque(disk="flywheel", mean=10.0, harmonics=[(1.0, 50.0, -20.0), (2.0, 10.0, 60.0)]),
        Torque(disk="driven", mean=-20.0, harmonics=[(1.0, 30.0, 10.0), (3.0, 20.0, 0.0)]),
        *more,
    ]
    if ground:
        parts.append(Ground(disk="driven", stiffness=10.0))
    return build(parts, revolutions_per_cycle=1, reference="flywheel", name="pair")


TRAINS = {
    "damping in contact": {},
    "damping always": {"mesh": {"damping_law": "always"}},
    "sharp teeth": {"mesh": {"transition": 0.01, "epsilon": 0.0}},
    "a floating train": {"ground": False},
    "a gear without inertia": {"gear_inertia": 0.0},
    "a loss factor": {"coupling": {"loss_factor": 0.1}},
    "a stage": {"coupling": {"stages": ((0.2, 3e4),)}},
    "a clearance": {"coupling": {"clearance": 0.1}},
    "a stop": {"coupling": {"stops": ((0.3, 3e4),)}},
    "friction": {"coupling": {"friction": 3.0}},
    "a stiffness that varies": {"mesh": {"stiffness_orders": ((1.0, 0.1, 0.05),)}},
    "a transmission error": {"mesh": {"transmission_error": ((1.0, 3e-6, 1e-6),)}},
}


@dataclasses.dataclass(frozen=True)
class Case:
    """A train at RPM, ready for sweeps."""

    train: jaxhb.DriveTrain
    plan: SweepPlan
    active: tuple
    equation: object
    modes: object


@partial(jax.jit, static_argnames="harmonics")
def condensed(problem, meshes, harmonics):
    return reduced_equation(problem, harmonics, meshes)[0]


def case_of(train, *, steps=STEPS, instant=None):
    """All meshes with a law are unknowns."""
    request = Request.of(train)
    (planned,) = planning.plan_speeds(train, np.array([RPM]), request)
    planned = planning.all_active(train, planned, request)
    if instant is None:
        instant = InstantSolve(2, coupled=True) if train.topology.springs else InstantSolve()
    plan = SweepPlan(steps, instant)
    problem = problem_at(train, RPM, listed_harmonic(train.topology))
    meshes = planned.active_meshes
    equation = condensed(problem, meshes, plan.harmonics)
    return Case(train, plan, planned.active, equation, modes_for_march(problem, meshes))


def settled(case, most=200):
    return settle_program(case.equation, case.modes, goal=GOAL, most=most, plan=case.plan)


def distance(case, one, other):
    """Of two motions, over the vibration of the first."""
    size = force_size(case.equation, one - other) / vibration_size(case.equation, one)
    return float(size)


@pytest.mark.parametrize("name", TRAINS)
def test_sweeps_end_at_the_solution_of_harmonic_balance(name):
    """Newton's method takes the law at 16 samples a harmonic, sweeps at 6: what that changes is below 1e-4 here."""
    case = case_of(pair(**TRAINS[name]))
    found = settled(case)
    print(name, int(found.sweeps), float(found.change), float(found.error))

    teeth = np.asarray(case.equation.sampled(found.deflection, 4096)[0])[0]
    law = case.equation.law
    print("   apart", np.mean(np.abs(teeth) < float(law.gap[0])), teeth.min(), teeth.max())
