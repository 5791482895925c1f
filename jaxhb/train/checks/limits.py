"""Sections of shafts as rules see them, and whether rules that users write give limits
of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from jaxhb._jax import on_host, traced
from jaxhb.elements.rules import RULES, Section
from jaxhb.elements.sentences import shown

if TYPE_CHECKING:
    from jaxhb.train.tables import TrainArrays

SPEEDS = 200  # between standstill and the highest speed of a rule, at which it is read


def section_of(train: TrainArrays, shaft: int) -> Section:
    """Return the :class:`Section` at which a shaft is judged: its ``diameter`` and
    ``bore``, else those of its stiffness, and its numbers for rules.
    """
    shafts = train.shafts
    has_key = train.topology.has_key
    if has_key(shaft, "diameter"):
        diameters = shafts.diameter
        bores = shafts.bore
    else:
        diameters = shafts.outer
        bores = shafts.inner
    absent = {"yield_strength": 0.0}
    numbers = {
        key: getattr(shafts, key)[shaft]
        if has_key(shaft, key)
        else absent.get(key, math.nan)
        for key in (
            "tensile_strength",
            "stress_concentration",
            "yield_strength",
            "nominal_torque",
        )
    }
    rated = train.topology.rated_rpm
    return Section(
        # A field that no shaft of the train has is None, not zeros.
        diameter=math.nan if diameters is None else diameters[shaft],
        bore=0.0 if bores is None else bores[shaft],
        rated_rpm=math.nan if rated is None else rated,
        **numbers,
    )


def limit_errors(train: TrainArrays) -> list[str]:
    """Check that limits after rules of files are numbers, the continuous ones greater
    than 0 and the transient ones at least 0; the shaft begins each sentence.
    """
    if traced(train):
        return []
    topology = train.topology
    train = on_host(train)
    errors = []
    for shaft, name in enumerate(topology.shaft_names):
        if not topology.link_keys or not topology.has_key(shaft, "tensile_strength"):
            continue
        rule = topology.rule_of(shaft)
        if rule.name in RULES:
            continue
        ratio = np.linspace(0.0, rule.highest, SPEEDS + 1)[1:]
        continuous, transient = rule.limits(section_of(train, shaft), ratio)
        kinds = (
            ("continuous", continuous, ~(continuous > 0.0), "greater than"),
            ("transient", transient, ~(transient >= 0.0), "at least"),
        )
        texts = [
            f"[[shaft]] no. {shaft + 1} {shown(name)}: the {kind} limit of"
            f" {rule.name} is {limit[missing][0]:.4g} Pa at lambda ="
            f" {ratio[missing][0]:.4g}, must be {words} 0 Pa. Correct its formulas, or"
            " the numbers of the shaft."
            for kind, limit, missing, words in kinds
            if missing.any()
        ]
        # One limit is often a multiple of the other.
        errors += texts[:1]
    return errors
