"""Holzer's table as text and as plain numbers."""

import numpy as np

from jaxhb.elements.elements import SceneError
from jaxhb.linear.critical import ELASTIC
from jaxhb.report.text.columns import NONE, aligned

FIRST = 3
"""Tables that are shown where none is asked for."""

FIELDS = ("inertia", "ordinate", "torque", "torque_sum", "stiffness", "twist", "kinetic_energy", "strain_energy")
"""Of a HolzerTable, in the file; the first six in the text."""


def chosen_modes(kinds, name, asked=None):
    """Numbers of the modes of the tables: those asked for, or the first ones that strain links.

    Parameters
    ----------
    kinds : sequence of str, see :func:`jaxhb.linear.critical.mode_kinds`
    name : str, of the scene
    asked : sequence of int, optional

    Returns
    -------
    list of int

    Raises
    ------
    SceneError
        If a mode is not there or strains no link.

    Examples
    --------
    >>> chosen_modes(("rigid", "elastic", "elastic"), "pair")
    [1, 2]
    """
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC]
    if not elastic:
        raise SceneError(f"{name}: no mode strains a link. Give a frequency with --hz.")
    errors = [
        f"{name}: --mode {k}: there are modes 0 to {len(kinds) - 1}."
        if k >= len(kinds)
        else f"{name}: --mode {k}: this mode is {kinds[k]}, no link is strained. The first that strains one is"
        f" {elastic[0]}."
        for k in asked or ()
        if k not in elastic
    ]
    if errors:
        raise SceneError(errors)
    return list(dict.fromkeys(asked)) if asked else elastic[:FIRST]


def holzer_text(tables, name, teeth=""):
    """Tables for people.

    Parameters
    ----------
    tables : list of (int or None, HolzerTable), number of the mode or None
    name : str, of the scene
    teeth : str, how stiff they are; empty of a train without

    Returns
    -------
    str
    """
    how = ", ".join(filter(None, ["undamped", teeth]))
    meshes = "; of a mesh c N/m, sum/c m" if teeth else ""
    parts = [
        f"{name}: Holzer's table, {how}. J kg m2, theta rad, torques N m,\nc N m/rad, sum/c rad{meshes}. Energies of"
        " disk and link in % of the kinetic energy.\nThe sum of a row passes through its link."
    ]
    return "\n\n".join([*parts, *(_table(*one) for one in tables)])


def _table(mode, table):
    kinetic = table.kinetic_energy.sum()
    energies = [[f"{100 * share:.1f}" for share in e / kinetic] for e in (table.kinetic_energy, table.strain_energy)]
    columns = [_numbers(getattr(table, field)) for field in FIELDS[:6]]
    for column in (*columns[4:], energies[1]):
        column[-1] = NONE  # behind the last disk is no link
    links = [*table.links[:-1], NONE]
    heads = ["disk", "J", "theta", "J w2 theta", "sum", "disk %", "link", "c", "sum/c", "link %"]
    cells = [table.names, *columns[:4], energies[0], links, *columns[4:], energies[1]]
    what = "" if mode is None else f"mode {mode}, "
    return f"{what}{table.hz:.6g} Hz, residual {table.residual + 0.0:.4g} N m\n" + aligned(heads, cells, left=(6,))


def _numbers(values):
    return [f"{value:#.5g}".rstrip(".") for value in values + 0.0]


def holzer_record(tables, name):
    """What ``holzer --json`` writes.

    Parameters
    ----------
    tables : list of (int or None, HolzerTable)
    name : str, of the scene

    Returns
    -------
    dict
        ``scene`` and ``tables``: ``hz``, ``mode`` (null where a frequency was given), ``residual`` in N m, and one
        list over the rows each of ``disks``, ``links`` and the numbers of :class:`jaxhb.HolzerTable`, SI units,
        ``kinetic_energy`` and ``strain_energy`` in J at the ordinates of the table.
    """
    return {
        "scene": name,
        "tables": [
            {"hz": table.hz, "mode": mode, "residual": table.residual}
            | {"disks": list(table.names), "links": list(table.links)}
            | {field: np.asarray(getattr(table, field)).tolist() for field in FIELDS}
            for mode, table in tables
        ],
    }
