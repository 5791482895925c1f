"""Trains in the files of other programs, as the content of a scene: TORS (JSON) and two
tables in one CSV file.

**TORS** is the format of openTorsion 0.3: ``components`` with ``elements`` in a row,
and ``structure`` with the connections ``["component.element", "component.element"]``
from an element to the beginning of another component. Read are ``Disk`` (inertia,
damping), ``ShaftDiscrete`` (stiffness, damping), ``ShaftContinuous`` (length,
innerDiameter, outerDiameter in mm, density; shear modulus 80 GPa, half its inertia at
each end) and ``GearElement`` (inertia, damping; teeth, diameter in mm, or radius;
parent in the same component). A component goes on from the node at which another one is
connected; one that begins with a gear without parent, and is connected to a gear,
meshes with it. Gears are rigid there: here they are meshes, and several gears of one
node are joined by shafts, all so stiff that they change natural frequencies by about
1e-5. Gears of which only teeth are given get a module of 5 mm. ``excitation`` is a list
of rows (order, amplitude), or a table with these as ``values``; it acts at the node
where its element begins, in the phase of a cosine, and its frequencies are multiples of
the one speed of an analysis, that of the reference rotor here. Amplitudes are in N m.
Those of the type ``excitationValuesRpmPercentage`` are shares of a torque over the
speed that an analysis adds and no file has: they cannot be read. What is not read and
what had to be guessed stands in the ``notes`` of the scene.

**CSV** has a table of inertias and one of links: docs/how_to/other_programs.md.
"""

import dataclasses
import difflib
import json
import math
from collections import Counter, defaultdict
from typing import Any

from jaxhb.elements.elements import (
    Disk,
    Mesh,
    SceneError,
    Shaft,
    cut,
    shown,
    suggestion,
)
from jaxhb.elements.value_checks import plain_number
from jaxhb.scene.csv_tables import CsvText, read_csv
from jaxhb.train.train_checks import fitting_cycle

SHEAR_MODULUS = 80e9  # Pa, of steel: TORS gives none
# In m, of a gear of which only the number of teeth is given: ratios are those of the
# teeth whatever it is
MODULE = 5e-3
# a gear of which a larger radius is given has it in mm: no drive train has larger gears
LARGEST_IN_METRES = 2.0
RIGID = 1e5  # stiffness of a rigid link over that of the stiffest shaft


def tors_content(text: str, source: str, errors: list[str]) -> dict:
    """Tables of a scene from the JSON of TORS; ``errors`` gets sentences, beginning
    with the file ``source``.

    What could not be read has harmless numbers there, so that the checks of a scene
    find what else is wrong and nothing twice. Raises :class:`SceneError` if the text is
    no JSON or no TORS.
    """
    try:
        content = json.loads(text)
    except ValueError as error:
        raise SceneError(
            f"{source}: invalid JSON: {cut(str(error))}. Correct it."
        ) from None
    try:
        reader = _Tors(source, content["components"], content.get("structure", []))
        reader.note_unread("the file", content, ("name", "components", "structure"))
        found = reader.read()
        if isinstance(content.get("name"), str):
            found["scene"]["name"] = content["name"]
    except (KeyError, TypeError, AttributeError, IndexError, ValueError):
        raise SceneError(
            f"{source}: this is not TORS, which has 'components', each with 'name' and"
            " 'elements', and 'structure', a list of pairs 'component.element'. Give"
            " such a file."
        ) from None
    errors += dict.fromkeys(reader.errors)
    return found


_READ = {
    "Disk": ("inertia", "damping"),
    "ShaftDiscrete": ("stiffness", "damping"),
    "ShaftContinuous": (
        "damping",
        "length",
        "innerDiameter",
        "outerDiameter",
        "density",
    ),
    "GearElement": ("inertia", "damping", "teeth", "diameter", "radius", "parent"),
}
"""Keys that are read of each type of element, besides those of all."""
_OF_ALL = "name", "type", "excitation"
_SIZES = "teeth", "diameter", "radius"
CYCLE = 2  # revolutions of the reference rotor, unless orders need more
# Amplitudes that are all below it may be shares of a torque, as in the examples of
# openTorsion
LARGEST_SHARE = 1.0


class _Tors:
    """Nodes, shafts and gears that are found on the way through the components."""

    def __init__(self, source, components, structure):
        self.source = source
        self.errors = []
        self.connections = {}
        self.nodes, self.walked = [], set()
        self.shafts = []
        self.gears = {}
        self.meshes = []
        self.notes = []
        self.excitations: dict[str, tuple[int, list]] = {}  # node and rows by element
        for name, count in Counter(
            component["name"] for component in components
        ).items():
            if count > 1:
                self._tell(
                    f"component {shown(name)} is given twice. Rename one of them."
                )
        for component in components:
            self.note_unread(
                f"component {shown(component['name'])}", component, ("name", "elements")
            )
        self.components = {
            component["name"]: self._named(component) for component in components
        }
        for begin, end in structure:
            for own in (begin, end):
                elements = self.components.get(own.partition(".")[0])
                if elements is not None and own not in elements:
                    self._tell(
                        f"'structure' names {own!r}, which does not"
                        f" exist.{suggestion(own, elements)}"
                    )
                elif (
                    elements is None and own is begin
                ):  # ends that are not there are found on the way
                    self._no_component(own.partition(".")[0])
            self.connections.setdefault(begin, []).append(end.partition(".")[0])

    def _tell(self, sentence, own=""):
        self.errors.append(f"{self.source}{f', {own!r}' if own else ''}: {sentence}")

    def note_unread(self, what, content, read):
        """Note the keys of a part of the file that hold something and are not read."""
        for key, value in content.items():
            if key not in read and value not in (None, 0, "", [], {}):
                self.notes.append(f"{shown(key)} of {what} is not read")

    def _no_component(self, name, why="does not exist"):
        self._tell(f"component {name!r} {why}. Correct 'structure'.")

    def _named(self, component):
        """Elements of a component by their full names, without those that have none."""
        found = {}
        for number, element in enumerate(component["elements"]):
            own = f"{component['name']}.{element.get('name')}"
            if "name" not in element:
                where = (
                    f"{self.source}, component {component['name']!r}, element no."
                    f" {number + 1}"
                )
                self.errors.append(f"{where}: the key 'name' is missing. Give it.")
            elif own in found:
                self._tell("the element is given twice. Rename one of them.", own)
            else:
                found[own] = element
        return found

    def read(self):
        """The scene, on the way through the train from the component that no other one
        leads to.
        """
        reached = {end for ends in self.connections.values() for end in ends}
        first = [name for name in self.components if name not in reached]
        if len(first) != 1:
            which = ", ".join(map(repr, first)) or "none"
            self._tell(
                f"the train must begin at one component, not {which}. Correct"
                " 'structure'."
            )
        for name in first:
            self._walk(name, self._node(), ())
        left = [name for name in self.components if name not in self.walked]
        for name in left if len(first) == 1 else ():
            self._no_component(name, "is not connected to the others")
        for name in left:  # what is wrong in them is told too
            if name not in self.walked:
                self._walk(name, self._node(), ())
        return self._content()

    def _node(self):
        """Make a node; its number."""
        self.nodes.append({"inertia": 0.0, "damping": 0.0})
        return len(self.nodes) - 1

    def _walk(self, name, node, above, gear=""):
        """Go through a component from a node on, at which there may be a gear, and
        through those connected to it.
        """
        if name not in self.components:
            self._no_component(name)
        elif name in self.walked:
            self._no_component(
                name, "leads back to itself" if name in above else "is connected twice"
            )
        else:
            self.walked.add(name)
            for own, element in self.components[name].items():
                node = self._add(name, own, element, node, gear)
                gear = ""
                for other in self.connections.get(own, ()):
                    self._walk(
                        other, node, (*above, name), own if own in self.gears else ""
                    )

    def _add(self, component, own, element, node, gear):
        """Put one element at a node, that of ``gear`` if the component begins there;
        where the component goes on.
        """
        kind = element.get("type")
        self.note_unread(repr(own), element, (*_OF_ALL, *_READ.get(kind, element)))
        if kind in ("ShaftDiscrete", "ShaftContinuous"):
            self._excite(node, own, element)
        if kind == "Disk":
            self._load(
                node,
                own,
                self._take(own, element, "inertia"),
                self._take(own, element, "damping", 0.0),
            )
            self._excite(node, own, element)
        elif kind in ("ShaftDiscrete", "ShaftContinuous"):
            end = self._node()
            discrete = kind == "ShaftDiscrete"
            stiffness, inertia = (
                (self._take(own, element, "stiffness"), 0.0)
                if discrete
                else self._round(own, element)
            )
            for at in (node, end):
                self.nodes[at]["inertia"] += inertia / 2
            row = {
                "name": own,
                "stiffness": stiffness,
                "damping": self._take(own, element, "damping", 0.0),
            }
            self.shafts.append((node, end, row))
            return end
        elif kind == "GearElement":
            node = self._gear(component, own, element, node, gear)
            self._excite(node, own, element)
        else:
            self._tell(f"unknown type {shown(kind)}.{suggestion(kind, _READ)}", own)
        return node

    def _gear(self, component, own, element, node, gear):
        """Put a gear at a node, one in mesh with a parent or another component at a
        node of its own; this node.
        """
        parent = f"{component}.{element.get('parent')}"
        if parent not in self.gears and element.get("parent"):
            known = [
                name.partition(".")[2]
                for name in self.gears
                if name.startswith(f"{component}.")
            ]
            said = (
                f"its parent {shown(element['parent'])} is no gear before it in"
                f" {component!r}"
            )
            self._tell(f"{said}.{suggestion(element['parent'], known)}", own)
        elif parent not in self.gears and gear:
            self.notes.append(
                f"{own!r} and {gear!r}, gears that are connected, are taken to be in"
                " mesh"
            )
            parent = gear
        if parent in self.gears:
            node = self._node()
            self.meshes.append((parent, own))
        self._load(
            node,
            own,
            self._take(own, element, "inertia"),
            self._take(own, element, "damping", 0.0),
        )
        sizes = [key for key in _SIZES if element.get(key) is not None] or ["diameter"]
        found = {key: self._take(own, element, key) for key in sizes}
        for key, size in found.items():
            if not size > 0.0:
                self._tell(f"{key} is {size:g}, must be greater than 0.", own)
                found[key] = 1.0
        self.gears[own] = {"node": node, **found}
        return node

    def _excite(self, node: int, name: str, element: dict):
        """Keep the excitation of an element at a node, or note why it cannot be
        read.
        """
        excitation = element.get("excitation")
        if excitation in (None, [], {}):
            return
        rows: Any = (
            excitation.get("values") if isinstance(excitation, dict) else excitation
        )
        kind = excitation.get("type") if isinstance(excitation, dict) else None
        why = _unread_excitation(kind, rows)
        if why:
            self.notes.append(
                f"the excitation of {name!r} is not read: {why}. Give it as [[torque]]"
            )
        else:
            self.excitations[name] = node, [row for row in rows if row[0] != 0]
            if len(self.excitations[name][1]) < len(rows):
                self.notes.append(
                    f"order 0 of the excitation of {name!r} is not read: no load takes"
                    " up a mean torque here"
                )

    def _load(self, node, own, inertia, damping):
        """Add an inertia to a node, which is called as its first."""
        at = self.nodes[node]
        at.setdefault("name", own)
        at["inertia"] += inertia
        at["damping"] += damping

    def _take(self, own, element, key, default=None):
        """A number of an element; without a default the key must be there."""
        value = element.get(key, default)
        if not plain_number(value):
            self._tell(f"the key {key!r} is missing or no number. Give it.", own)
            return 1.0
        return float(value)

    def _round(self, own, element):
        """Stiffness and inertia of a round shaft."""
        length, outer = (
            1e-3 * self._take(own, element, key) for key in ("length", "outerDiameter")
        )
        inner, density = (
            self._take(own, element, *both)
            for both in (("innerDiameter", 0.0), ("density", 8000.0))
        )
        area = math.pi * (outer**4 - (1e-3 * inner) ** 4) / 32.0
        if not (length > 0.0 and area > 0.0):
            self._tell("length and wall must be greater than 0 mm. Correct them.", own)
            return 1.0, 0.0
        return SHEAR_MODULUS * area / length, density * area * length

    def _radii(self):
        """Radii of the gears in m."""
        given = {
            own: gear["radius"] for own, gear in self.gears.items() if "radius" in gear
        }
        in_metres = max(given.values(), default=0.0) <= LARGEST_IN_METRES
        if given:
            unit = "m" if in_metres else "mm"
            self.notes.append(
                f"radius of {', '.join(map(repr, given))} is taken to be in {unit}"
            )

        def radius(gear):
            if "diameter" in gear:
                return 0.5e-3 * gear["diameter"]
            if "radius" in gear:
                return gear["radius"] * (1.0 if in_metres else 1e-3)
            return 0.5 * MODULE * gear["teeth"]

        return {own: radius(gear) for own, gear in self.gears.items()}

    def _content(self):
        """The scene."""
        disks = [{"name": f"node {k}"} | node for k, node in enumerate(self.nodes)]
        shafts = [
            {"between": [disks[a]["name"], disks[b]["name"]], **row}
            for a, b, row in self.shafts
        ]
        rigid = RIGID * max((row["stiffness"] for row in shafts), default=1e6)
        seats = {}
        radii = self._radii()
        for own, gear in self.gears.items():
            place = disks[gear["node"]]
            radius = radii[own]
            # A disk has one radius: a further gear of the node sits on a disk of its
            # own.
            if place.get("radius", radius) != radius:
                disks.append(
                    {
                        "name": own if own != place["name"] else f"{own} gear",
                        "inertia": 0.0,
                    }
                )
                shafts.append(
                    {"between": [place["name"], disks[-1]["name"]], "stiffness": rigid}
                )
                place = disks[-1]
            place["radius"] = radius
            if "teeth" in gear:
                place["teeth"] = round(gear["teeth"])
            seats[own] = place
        meshes = []
        for pair in self.meshes:
            if (
                len(
                    {
                        "diameter" in self.gears[own] or "radius" in self.gears[own]
                        for own in pair
                    }
                )
                > 1
            ):
                text = (
                    f"{pair[0]!r} and {pair[1]!r} mesh, one with teeth, one with a"
                    " diameter"
                )
                self._tell(f"{text}. Give both alike.")
            ends = [seats[own] for own in pair]
            # As stiff in N m/rad as a rigid shaft at the smaller gear, and stiffer at
            # the larger.
            stiffness = rigid / min(end["radius"] for end in ends) ** 2
            meshes.append(
                {"between": [end["name"] for end in ends], "stiffness": stiffness}
            )
        said = f"From {self.source}" + "; rigid gears are stiff meshes" * bool(meshes)
        reference = disks[0]["name"]
        content = {"scene": {"description": said, "reference": reference}}
        torques = [
            _torque(name, disks[node]["name"], excitation_rows)
            for name, (node, excitation_rows) in self.excitations.items()
        ]
        if torques:
            content["scene"]["revolutions_per_cycle"] = _cycle_of(torques)
            names = ", ".join(map(repr, self.excitations))
            rows_are = (
                f"rows are taken to be orders of the turn of {reference!r} and"
                " amplitudes in N m, of cosines"
            )
            self.notes.append(f"excitation of {names}: {rows_are}")
        if self.notes:
            content["scene"]["notes"] = [
                f"{self.source}: {text}." for text in dict.fromkeys(self.notes)
            ]
        for table, rows in {
            "disk": disks,
            "shaft": shafts,
            "mesh": meshes,
            "torque": torques,
        }.items():
            if rows:
                content[table] = [
                    {k: value for k, value in row.items() if k != "damping" or value}
                    for row in rows
                ]
        return content


def _unread_excitation(kind: Any, rows: Any) -> str:
    """Why rows of an excitation of a type (None: it has none) cannot be read; empty
    where they can.
    """
    pairs = isinstance(rows, list) and all(
        isinstance(row, list) and len(row) == 2 for row in rows
    )
    if not (pairs and all(plain_number(number) for row in rows for number in row)):
        return "it has no 'values' that are rows of order and amplitude"
    if isinstance(kind, str) and kind.lower().endswith("percentage"):
        return "its amplitudes are shares of a torque, which the file does not have"
    if kind is not None:
        return f"its type {shown(kind)} is unknown"
    if all(abs(amplitude) < LARGEST_SHARE for _, amplitude in rows):
        return "its amplitudes are below 1, and may be N m or shares of a torque"
    return ""


def _torque(name: str, disk: str, rows: list) -> dict:
    """The ``[[torque]]`` of rows of order and amplitude."""
    amplitudes: dict[float, float] = defaultdict(float)
    for order, amplitude in rows:
        amplitudes[float(order)] += float(amplitude)
    harmonics = [
        [order, amplitude, 0.0] for order, amplitude in sorted(amplitudes.items())
    ]
    return {"name": f"{name} excitation", "disk": disk, "harmonics": harmonics}


def _cycle_of(torques: list[dict]) -> float:
    """Revolutions of the reference rotor after which all orders of torques repeat."""
    fitting = fitting_cycle(
        {order for torque in torques for order, *_ in torque["harmonics"]}
    )
    return math.lcm(CYCLE, int(fitting)) if fitting else CYCLE


def csv_content(text: str, source: str, errors: list[str]) -> dict:
    """Read two tables, inertias and links; arguments and result as for
    :func:`tors_content`.

    Rows above the first heads are left out, and told. Without inertias links have disks
    with harmless ones.
    """
    whole = read_csv(text, source)
    lines = [line for line in whole.lines if any(line.cells)]
    content = {}
    heads = None
    for line in lines:
        cells = line.cells
        where = f"{source}, line {line.number}"
        if cells[0] in ("name", "from"):
            heads = _heads(list(cells), source, errors)
            continue
        if heads is None:
            continue
        if any(cells[len(heads) :]):
            cure = (
                "Correct the line; where decimals have commas separate by semicolons or"
                " tabs."
            )
            errors.append(
                f"{where}: {len(cells)} cells under {len(heads)} heads. {cure}"
            )
        row = {
            head: _cell(whole, head, cell)
            for head, cell in zip(heads, cells, strict=False)
            if head and cell
        }
        table = "disk"
        if heads[0] == "from":
            table = row.pop("link", "shaft")
            row = {
                "between": [row.pop(end) for end in ("from", "to") if end in row]
            } | row
        if table not in ("disk", "shaft", "mesh"):
            errors.append(
                f"{where}: link is {shown(table)}, must be 'shaft' or 'mesh'."
                " Correct it."
            )
            continue
        content.setdefault(table, []).append(row)
    if lines and lines[0].cells[0] not in ("name", "from"):
        begin = "'name', of inertias, or 'from', of links"
        errors.append(
            f"{source}: the first line must name columns, beginning with {begin}. Give"
            " the heads."
        )
    elif "disk" not in content:
        errors.append(
            f"{source}: there is no table of inertias, whose first column is 'name'."
            " Give one."
        )
    if "disk" not in content:  # the disks of the links, so that these are checked
        ends = [
            name for rows in content.values() for row in rows for name in row["between"]
        ]
        content["disk"] = [
            {"name": name, "inertia": 1.0} for name in dict.fromkeys(ends or ["disk"])
        ]
    return {
        "scene": {
            "description": f"From {source}",
            "reference": content["disk"][0].get("name"),
        }
    } | content


def _heads(heads, source, errors):
    """The columns by the keys that they mean; None for one that means no key of what
    the table holds.
    """
    known = [f.name for f in dataclasses.fields(Disk)]
    if heads[0] == "from":
        of_links = dict.fromkeys(
            f.name for cls in (Shaft, Mesh) for f in dataclasses.fields(cls)
        )
        known = [
            "from",
            "to",
            "link",
            *(name for name in of_links if name != "between"),
        ]
    wrong = [head for head in heads if head not in known]
    errors += [
        f"{source}: unknown column {shown(head)}.{suggestion(head, known)}"
        for head in wrong
    ]
    errors += [
        f"{source}: two columns are called {head!r}. Keep one."
        for head in known
        if heads.count(head) > 1
    ]
    free = [key for key in known if key not in heads]
    meant = {
        head: next(iter(difflib.get_close_matches(head, free, n=1)), None)
        for head in wrong
    }
    return [meant.get(head, head) for head in heads]


def _cell(table: CsvText, head: str, cell: str):
    """A number where it is one; names stay text."""
    if head in ("name", "from", "to", "link") or not table.is_number(cell):
        return cell
    return int(cell) if cell.isdecimal() else table.number(cell)
