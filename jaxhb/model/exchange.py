"""Trains in the files of other programs, as the content of a scene: TORS (JSON) and two tables in one CSV file.

**TORS** is the format of openTorsion 0.3: ``components`` with ``elements`` in a row, and ``structure`` with the
connections ``["component.element", "component.element"]`` from an element to the beginning of another component. Read
are ``Disk`` (inertia, damping), ``ShaftDiscrete`` (stiffness, damping), ``ShaftContinuous`` (length, innerDiameter,
outerDiameter in mm, density; shear modulus 80 GPa, half its inertia at each end) and ``GearElement`` (inertia; teeth,
or diameter in mm; parent in the same component). A component goes on from the node at which another one is connected.
Gears are rigid there: here they are meshes, and several gears of one node are joined by shafts, all so stiff that they
change natural frequencies by about 1e-5. Give them real stiffnesses before tooth forces are read. Gears with teeth get
a module of 5 mm. Excitations are not read.

**CSV**: a table whose first column is ``name``, with keys of ``[[disk]]`` as its other columns, and a table whose first
columns are ``from`` and ``to``, with keys of ``[[shaft]]`` and ``[[mesh]]``; a column ``link`` says ``shaft`` (or
nothing) or ``mesh``. Empty cells are keys left out, lines that begin with ``#`` comments. The first disk is the
reference.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import math

from jaxhb.model.elements import Disk, Mesh, SceneError, Shaft
from jaxhb.model.topology import suggestion

SHEAR_MODULUS = 80e9
MODULE = 5e-3
RIGID = 1e5
"""Stiffness of a rigid link over that of the stiffest shaft."""


def tors_content(text: str, source: str) -> dict:
    """Read TORS.

    Parameters
    ----------
    text : str
        The JSON.
    source : str
        Name of the file, for errors.

    Returns
    -------
    dict
        The tables of a scene.

    Raises
    ------
    SceneError
        All that cannot be read, one sentence each.

    Examples
    --------
    >>> parts = [{"type": "Disk", "name": "rotor", "inertia": 2.0}]
    >>> tors_content(json.dumps({"structure": [], "components": [{"name": "c", "elements": parts}]}), "c.json")["disk"]
    [{'name': 'c.rotor', 'inertia': 2.0}]
    """
    try:
        content = json.loads(text)
    except ValueError as error:
        raise SceneError(f"{source}: invalid JSON: {error}. Correct it.") from None
    try:
        reader = _Tors(source, content["components"], content.get("structure", []))
        reader.walk(reader.first(), 0, ())
        if reader.errors:
            raise SceneError(dict.fromkeys(reader.errors))
        return reader.content()
    except SceneError:
        raise
    except (KeyError, TypeError, AttributeError, IndexError, ValueError):
        raise SceneError(
            f"{source}: this is not TORS, which has 'components', each with 'name' and 'elements', and 'structure', a"
            " list of pairs 'component.element'. Give such a file."
        ) from None


class _Tors:
    """Nodes, shafts and gears that are found on the way through the components."""

    def __init__(self, source, components, structure):
        self.source, self.errors = source, []
        self.components = {component["name"]: component for component in components}
        self.connections = {}
        for begin, end in structure:
            self.connections.setdefault(begin, []).append(end.partition(".")[0])
        self.nodes = [{"inertia": 0.0, "damping": 0.0}]
        self.shafts, self.gears, self.meshes = [], {}, []

    def first(self):
        """The component that no other one leads to."""
        reached = {end for ends in self.connections.values() for end in ends}
        found = [name for name in self.components if name not in reached]
        if len(found) != 1:
            which = ", ".join(map(repr, found)) or "none"
            raise SceneError(f"{self.source}: the train must begin at one component, not {which}. Correct 'structure'.")
        return found[0]

    def walk(self, name, node, above):
        """Go through a component from a node on, and through those connected to it."""
        if name not in self.components or name in above:
            why = "leads back to itself" if name in above else "does not exist"
            self.errors.append(f"{self.source}: component {name!r} {why}. Correct 'structure'.")
            return
        for element in self.components[name]["elements"]:
            own = f"{name}.{element['name']}"
            node = self._add(name, own, element, node)
            for other in self.connections.get(own, ()):
                self.walk(other, node, (*above, name))

    def _add(self, component, own, element, node):
        """Put one element at a node; the node at which the component goes on."""
        kind = element.get("type")
        number = {key: value for key, value in element.items() if _number(value)}
        if kind == "Disk":
            self._load(node, own, self._need(own, number, "inertia"), number.get("damping", 0.0))
        elif kind in ("ShaftDiscrete", "ShaftContinuous"):
            self.nodes.append({"inertia": 0.0, "damping": 0.0})
            read = self._continuous if kind == "ShaftContinuous" else self._discrete
            stiffness, inertia = read(own, number)
            for end in (node, len(self.nodes) - 1):
                self.nodes[end]["inertia"] += inertia / 2
            row = {"name": own, "stiffness": stiffness, "damping": float(number.get("damping", 0.0))}
            self.shafts.append((node, len(self.nodes) - 1, row))
            return len(self.nodes) - 1
        elif kind == "GearElement":
            parent = f"{component}.{element.get('parent')}"
            if parent in self.gears:
                self.nodes.append({"inertia": 0.0, "damping": 0.0})
                node = len(self.nodes) - 1
                self.meshes.append((parent, own))
            self._load(node, own, self._need(own, number, "inertia"), 0.0)
            toothed = "teeth" in number
            size = self._need(own, number, "teeth" if toothed else "diameter")
            if not size > 0.0:
                self.errors.append(f"{self.source}, {own!r}: teeth or diameter is {size:g}, must be greater than 0.")
            self.gears[own] = {"node": node, "toothed": toothed, "size": size}
        else:
            known = ["Disk", "ShaftDiscrete", "ShaftContinuous", "GearElement"]
            self.errors.append(f"{self.source}, {own!r}: unknown type {kind!r}.{suggestion(kind, known)}")
        return node

    def _load(self, node, own, inertia, damping):
        """Add an inertia to a node, which is called as its first."""
        at = self.nodes[node]
        at.setdefault("name", own)
        at["inertia"] += inertia
        at["damping"] += damping

    def _need(self, own, number, key):
        if key not in number:
            self.errors.append(f"{self.source}, {own!r}: the key {key!r} is missing or no number. Give it.")
        return float(number.get(key, 1.0))

    def _discrete(self, own, number):
        return self._need(own, number, "stiffness"), 0.0

    def _continuous(self, own, number):
        """Stiffness and inertia of a round shaft."""
        length, outer = (1e-3 * self._need(own, number, key) for key in ("length", "outerDiameter"))
        inner = 1e-3 * float(number.get("innerDiameter", 0.0))
        area = math.pi * (outer**4 - inner**4) / 32.0
        if not (length > 0.0 and area > 0.0):
            self.errors.append(f"{self.source}, {own!r}: length and wall must be greater than 0 mm. Correct them.")
            return 1.0, 0.0
        return SHEAR_MODULUS * area / length, float(number.get("density", 8000.0)) * area * length

    def content(self):
        """The scene."""
        for k, node in enumerate(self.nodes):
            node.setdefault("name", f"node {k}")
        disks = [{key: node[key] for key in ("name", "inertia", "damping")} for node in self.nodes]
        shafts = [{"between": [disks[a]["name"], disks[b]["name"]], **row} for a, b, row in self.shafts]
        rigid = RIGID * max((row["stiffness"] for row in shafts), default=1e6)
        seats = {}
        for own, gear in self.gears.items():
            place = disks[gear["node"]]
            radius = 0.5e-3 * gear["size"] if not gear["toothed"] else 0.5 * MODULE * gear["size"]
            if place.get("radius", radius) != radius:
                disks.append({"name": own if own != place["name"] else f"{own} gear", "inertia": 0.0})
                shafts.append({"between": [place["name"], disks[-1]["name"]], "stiffness": rigid})
                place = disks[-1]
            place["radius"] = radius
            if gear["toothed"]:
                place["teeth"] = round(gear["size"])
            seats[own] = place
        meshes = []
        for pair in self.meshes:
            if len({self.gears[own]["toothed"] for own in pair}) > 1:
                text = f"{pair[0]!r} and {pair[1]!r} mesh, one with teeth, one with a diameter"
                raise SceneError(f"{self.source}: {text}. Give both alike.")
            ends = [seats[own] for own in pair]
            stiffness = rigid / min(end["radius"] for end in ends) ** 2
            meshes.append({"between": [end["name"] for end in ends], "stiffness": stiffness})
        said = f"From {self.source}; rigid gears are stiff meshes" if meshes else f"From {self.source}"
        rows = {"disk": disks, "shaft": shafts, "mesh": meshes}
        tables = {table: [_sparse(row) for row in found] for table, found in rows.items() if found}
        return {"scene": {"description": said, "reference": disks[0]["name"]}} | tables


def _number(value):
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _sparse(row):
    """A row without dampings of 0."""
    return {key: value for key, value in row.items() if key != "damping" or value}


def csv_content(text: str, source: str) -> dict:
    """Read two tables, inertias and links; arguments, result and errors as for :func:`tors_content`.

    Examples
    --------
    >>> text = "name,inertia\\na,1\\nb,2\\n\\nfrom,to,stiffness\\na,b,1e5\\n"
    >>> csv_content(text, "pair.csv")["shaft"]
    [{'between': ['a', 'b'], 'stiffness': 100000.0}]
    """
    lines = [line for line in text.splitlines() if line.strip(" ,;") and not line.lstrip().startswith("#")]
    delimiter = ";" if lines and ";" in lines[0] else ","
    errors, content, heads = [], {}, None
    for number, cells in enumerate(csv.reader(lines, delimiter=delimiter)):
        cells = [cell.strip() for cell in cells]
        if cells[0] in ("name", "from"):
            heads = cells
            errors += _head_errors(heads, source)
            continue
        if heads is None:
            begin = "'name', of inertias, or 'from', of links"
            raise SceneError(f"{source}: the first line must name columns, beginning with {begin}. Give the heads.")
        if len(cells) > len(heads):
            errors.append(f"{source}, row {number + 1}: {len(cells)} cells under {len(heads)} heads. Correct the row.")
            continue
        row = {head: _cell(head, cell) for head, cell in zip(heads, cells, strict=False) if cell}
        table = "disk"
        if heads[0] == "from":
            table = row.pop("link", "shaft")
            row = {"between": [row.pop(end) for end in ("from", "to") if end in row]} | row
        if table not in ("disk", "shaft", "mesh"):
            errors.append(f"{source}, row {number + 1}: link is {table!r}, must be 'shaft' or 'mesh'. Correct it.")
        content.setdefault(table, []).append(row)
    if not content.get("disk"):
        errors.append(f"{source}: there is no table of inertias, whose first column is 'name'. Give one.")
    if errors:
        raise SceneError(errors)
    return {"scene": {"description": f"From {source}", "reference": content["disk"][0].get("name")}} | content


def _head_errors(heads, source):
    """Find columns that are no keys of what the table holds."""
    if heads[0] == "name":
        known = [f.name for f in dataclasses.fields(Disk)]
    else:
        of_links = {f.name: None for cls in (Shaft, Mesh) for f in dataclasses.fields(cls)}
        known = ["from", "to", "link", *(name for name in of_links if name != "between")]
    wrong = [head for head in heads if head not in known]
    return [f"{source}: unknown column {head!r}.{suggestion(head, known)}" for head in wrong]


def _cell(head, cell):
    """A number where it is one; names stay text."""
    if head in ("name", "from", "to", "link"):
        return cell
    try:
        return int(cell) if cell.isdecimal() else float(cell)
    except ValueError:
        return cell
