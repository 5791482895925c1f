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
1e-5. Gears with teeth alone get a module of 5 mm. ``excitation`` is a list of rows
(order, amplitude), or a table with these as ``values``; it acts at the node where its
element begins, in the phase of a cosine, and its frequencies are multiples of the
single speed of an analysis, that of the reference rotor here. Amplitudes are in N m.
Amplitudes of the type ``excitationValuesRpmPercentage`` are shares of a torque over the
speed that an analysis adds and no file has: they cannot be read. All that is not read
or guessed stands in the ``notes`` of the scene.

**CSV** has a table of inertias and one of links: docs/how_to/other_programs.md.
"""

import dataclasses
import difflib
import json
import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from jaxhb.elements.elements import Disk, Mesh, Shaft
from jaxhb.elements.sentences import SceneError, cut, shown, suggestion
from jaxhb.elements.values import plain_number
from jaxhb.scene.csv_tables import CsvText, name_and_unit, read_csv
from jaxhb.train.checks.consistency import fitting_cycle

SHEAR_MODULUS = 80e9  # Pa, of steel: TORS has none
# In m, of a gear with a number of teeth alone: ratios are those of the teeth whatever
# the module
MODULE = 5e-3
# Larger radii of gears are in mm: no drive train has larger gears
LARGEST_IN_METRES = 2.0
RIGID = 1e5  # stiffness of a rigid link over that of the stiffest shaft


def tors_content(text: str, source: str, errors: list[str]) -> dict:
    """Convert the JSON of TORS to tables of a scene; sentences that begin with the file
    ``source`` are added to ``errors``.

    Numbers that cannot be read become harmless ones, so that the checks of a scene find
    other faults and nothing twice. Raises :class:`SceneError` if the text is no JSON or
    no TORS.
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
        scene = reader.read()
        if isinstance(content.get("name"), str):
            scene["scene"]["name"] = content["name"]
    except (KeyError, TypeError, AttributeError, IndexError, ValueError):
        raise SceneError(
            f"{source}: this is not TORS, which has 'components', each with 'name' and"
            " 'elements', and 'structure', a list of pairs 'component.element'. Give"
            " such a file."
        ) from None
    errors += dict.fromkeys(reader.errors)
    return scene


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
"""Keys that are read of each type of element, besides the common ones."""
_COMMON = "name", "type", "excitation"
_SIZES = "teeth", "diameter", "radius"
CYCLE = 2  # revolutions of the reference rotor, unless orders need more
# Amplitudes that are all below it may be shares of a torque, as in the examples of
# openTorsion
LARGEST_SHARE = 1.0


class _Tors:
    """Reader of TORS: the nodes, shafts and gears on the way through the components.

    Elements go by their full names, "component.element".
    """

    def __init__(
        self,
        source: str,
        components: Sequence[Mapping[str, Any]],
        structure: Iterable[Sequence[str]],
    ) -> None:
        self.source = source
        self.errors: list[str] = []
        self.connections: dict[str, list[str]] = {}  # components by element
        self.nodes: list[dict[str, Any]] = []
        self.walked: set[str] = set()
        self.shafts: list[tuple[int, int, dict[str, Any]]] = []  # ends and row
        self.gears: dict[str, dict[str, Any]] = {}
        self.meshes: list[tuple[str, str]] = []
        self.notes: list[str] = []
        self.excitations: dict[str, tuple[int, list]] = {}  # node and rows by element
        counts = Counter(component["name"] for component in components)
        for name, count in counts.items():
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
            for name in (begin, end):
                component_name = name.partition(".")[0]
                elements = self.components.get(component_name)
                if elements is not None and name not in elements:
                    self._tell(
                        f"'structure' names {name!r}, which does not"
                        f" exist.{suggestion(name, elements)}"
                    )
                # Ends that are not there are found on the way.
                elif elements is None and name is begin:
                    self._no_component(component_name)
            self.connections.setdefault(begin, []).append(end.partition(".")[0])

    def _tell(self, sentence: str, name: str = "") -> None:
        """Add a sentence to the errors, on an element if it has a name."""
        place = f", {name!r}" if name else ""
        self.errors.append(f"{self.source}{place}: {sentence}")

    def note_unread(
        self, part: str, content: Mapping[str, Any], read: Collection[str]
    ) -> None:
        """Note the keys of a part of the file that have a value and are not read."""
        for key, value in content.items():
            if key not in read and value not in (None, 0, "", [], {}):
                self.notes.append(f"{shown(key)} of {part} is not read")

    def _no_component(self, name: str, why: str = "does not exist") -> None:
        """Add a sentence on a component that the structure names wrongly."""
        self._tell(f"component {name!r} {why}. Correct 'structure'.")

    def _named(self, component: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
        """Elements of a component by their full names; refuses those without a name."""
        elements: dict[str, Mapping[str, Any]] = {}
        for number, element in enumerate(component["elements"]):
            name = f"{component['name']}.{element.get('name')}"
            if "name" not in element:
                where = (
                    f"{self.source}, component {component['name']!r}, element no."
                    f" {number + 1}"
                )
                self.errors.append(f"{where}: the key 'name' is missing. Give it.")
            elif name in elements:
                self._tell("the element is given twice. Rename one of them.", name)
            else:
                elements[name] = element
        return elements

    def read(self) -> dict[str, Any]:
        """Read the scene, on the way through the train from the component to which no
        other component leads.
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
        for name in left:  # their faults are errors, too
            if name not in self.walked:
                self._walk(name, self._node(), ())
        return self._content()

    def _node(self) -> int:
        """Make a node, and return its number."""
        self.nodes.append({"inertia": 0.0, "damping": 0.0})
        return len(self.nodes) - 1

    def _walk(
        self, name: str, node: int, above: tuple[str, ...], gear: str = ""
    ) -> None:
        """Go through the component ``name`` from a node on, at which there may be a
        gear, and through those connected to it; ``above`` are the components on the
        way.
        """
        if name not in self.components:
            self._no_component(name)
        elif name in self.walked:
            self._no_component(
                name, "leads back to itself" if name in above else "is connected twice"
            )
        else:
            self.walked.add(name)
            for element_name, element in self.components[name].items():
                node = self._add(name, element_name, element, node, gear)
                gear = ""
                end_gear = element_name if element_name in self.gears else ""
                for connected in self.connections.get(element_name, ()):
                    self._walk(connected, node, (*above, name), end_gear)

    def _add(
        self,
        component: str,
        name: str,
        element: Mapping[str, Any],
        node: int,
        gear: str,
    ) -> int:
        """Put one element at a node, that of ``gear`` if the component begins there,
        and return the node at which the component goes on.
        """
        kind: Any = element.get("type")
        read = (*_COMMON, *_READ.get(kind, element))
        self.note_unread(repr(name), element, read)
        if kind in ("ShaftDiscrete", "ShaftContinuous"):
            self._excite(node, name, element)
        if kind == "Disk":
            inertia = self._number(name, element, "inertia")
            self._load(node, name, inertia, self._number(name, element, "damping", 0.0))
            self._excite(node, name, element)
        elif kind in ("ShaftDiscrete", "ShaftContinuous"):
            end = self._node()
            if kind == "ShaftDiscrete":
                stiffness = self._number(name, element, "stiffness")
                inertia = 0.0
            else:
                stiffness, inertia = self._round(name, element)
            for shaft_node in (node, end):
                self.nodes[shaft_node]["inertia"] += inertia / 2
            row = {
                "name": name,
                "stiffness": stiffness,
                "damping": self._number(name, element, "damping", 0.0),
            }
            self.shafts.append((node, end, row))
            return end
        elif kind == "GearElement":
            node = self._gear(component, name, element, node, gear)
            self._excite(node, name, element)
        else:
            self._tell(f"unknown type {shown(kind)}.{suggestion(kind, _READ)}", name)
        return node

    def _gear(
        self,
        component: str,
        name: str,
        element: Mapping[str, Any],
        node: int,
        gear: str,
    ) -> int:
        """Put a gear at a node, or at a new node where it meshes with its parent or
        with ``gear`` of another component, and return the node.
        """
        parent = f"{component}.{element.get('parent')}"
        if parent not in self.gears and element.get("parent"):
            candidates = [
                gear_name.partition(".")[2]
                for gear_name in self.gears
                if gear_name.startswith(f"{component}.")
            ]
            self._tell(
                f"its parent {shown(element['parent'])} is no gear before it in"
                f" {component!r}.{suggestion(element['parent'], candidates)}",
                name,
            )
        elif parent not in self.gears and gear:
            self.notes.append(
                f"{name!r} and {gear!r}, gears that are connected, are taken to be in"
                " mesh"
            )
            parent = gear
        if parent in self.gears:
            node = self._node()
            self.meshes.append((parent, name))
        inertia = self._number(name, element, "inertia")
        self._load(node, name, inertia, self._number(name, element, "damping", 0.0))
        keys = [key for key in _SIZES if element.get(key) is not None] or ["diameter"]
        sizes = {key: self._number(name, element, key) for key in keys}
        for key, size in sizes.items():
            if not size > 0.0:
                self._tell(f"{key} is {size:g}, must be greater than 0.", name)
                sizes[key] = 1.0
        self.gears[name] = {"node": node, **sizes}
        return node

    def _excite(self, node: int, name: str, element: Mapping[str, Any]) -> None:
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

    def _load(self, node: int, name: str, inertia: float, damping: float) -> None:
        """Add an inertia to a node, which gets the name of its first one."""
        row = self.nodes[node]
        row.setdefault("name", name)
        row["inertia"] += inertia
        row["damping"] += damping

    def _number(
        self,
        name: str,
        element: Mapping[str, Any],
        key: str,
        default: float | None = None,
    ) -> float:
        """A number of an element; without a default the key must be there."""
        value = element.get(key, default)
        if not plain_number(value):
            self._tell(f"the key {key!r} is missing or no number. Give it.", name)
            return 1.0
        return float(value)

    def _round(self, name: str, element: Mapping[str, Any]) -> tuple[float, float]:
        """Stiffness in N m/rad and inertia in kg m2 of a round shaft."""
        length = 1e-3 * self._number(name, element, "length")
        outer = 1e-3 * self._number(name, element, "outerDiameter")
        inner = self._number(name, element, "innerDiameter", 0.0)
        density = self._number(name, element, "density", 8000.0)
        area = math.pi * (outer**4 - (1e-3 * inner) ** 4) / 32.0
        if not (length > 0.0 and area > 0.0):
            self._tell("length and wall must be greater than 0 mm. Correct them.", name)
            return 1.0, 0.0
        return SHEAR_MODULUS * area / length, density * area * length

    def _radii(self) -> dict[str, float]:
        """Radii of the gears in m by their names."""
        read = {
            name: gear["radius"]
            for name, gear in self.gears.items()
            if "radius" in gear
        }
        in_metres = max(read.values(), default=0.0) <= LARGEST_IN_METRES
        if read:
            unit = "m" if in_metres else "mm"
            self.notes.append(
                f"radius of {', '.join(map(repr, read))} is taken to be in {unit}"
            )

        def radius(gear: Mapping[str, Any]) -> float:
            if "diameter" in gear:
                return 0.5e-3 * gear["diameter"]
            if "radius" in gear:
                return gear["radius"] * (1.0 if in_metres else 1e-3)
            return 0.5 * MODULE * gear["teeth"]

        return {name: radius(gear) for name, gear in self.gears.items()}

    def _content(self) -> dict[str, Any]:
        """The tables of the scene."""
        disks: list[dict[str, Any]] = [
            {"name": f"node {k}"} | node for k, node in enumerate(self.nodes)
        ]
        shafts: list[dict[str, Any]] = [
            {"between": [disks[a]["name"], disks[b]["name"]], **row}
            for a, b, row in self.shafts
        ]
        rigid = RIGID * max((row["stiffness"] for row in shafts), default=1e6)
        seats = {}
        radii = self._radii()
        for name, gear in self.gears.items():
            disk = disks[gear["node"]]
            radius = radii[name]
            # A disk has a single radius: a further gear of the node sits on a disk of
            # its own.
            if disk.get("radius", radius) != radius:
                disk_name = name if name != disk["name"] else f"{name} gear"
                disks.append({"name": disk_name, "inertia": 0.0})
                shafts.append(
                    {"between": [disk["name"], disk_name], "stiffness": rigid}
                )
                disk = disks[-1]
            disk["radius"] = radius
            if "teeth" in gear:
                disk["teeth"] = round(gear["teeth"])
            seats[name] = disk
        meshes = []
        for first, second in self.meshes:
            has_length = {
                "diameter" in self.gears[name] or "radius" in self.gears[name]
                for name in (first, second)
            }
            if len(has_length) > 1:
                self._tell(
                    f"{first!r} and {second!r} mesh, one with teeth, one with a"
                    " diameter. Give both alike."
                )
            ends = [seats[first], seats[second]]
            # As stiff in N m/rad as a rigid shaft at the smaller gear, and stiffer at
            # the larger.
            stiffness = rigid / min(end["radius"] for end in ends) ** 2
            meshes.append(
                {"between": [end["name"] for end in ends], "stiffness": stiffness}
            )
        description = f"From {self.source}"
        if meshes:
            description += "; rigid gears are stiff meshes"
        reference = disks[0]["name"]
        scene = {"description": description, "reference": reference}
        content: dict[str, Any] = {"scene": scene}
        torques = [
            _torque(name, disks[node]["name"], excitation_rows)
            for name, (node, excitation_rows) in self.excitations.items()
        ]
        if torques:
            scene["revolutions_per_cycle"] = _cycle_of(torques)
            names = ", ".join(map(repr, self.excitations))
            self.notes.append(
                f"excitation of {names}: rows are taken to be orders of the turn of"
                f" {reference!r} and amplitudes in N m, of cosines"
            )
        if self.notes:
            scene["notes"] = [
                f"{self.source}: {text}." for text in dict.fromkeys(self.notes)
            ]
        tables = {"disk": disks, "shaft": shafts, "mesh": meshes, "torque": torques}
        for table, rows in tables.items():
            if rows:
                content[table] = [
                    {k: value for k, value in row.items() if k != "damping" or value}
                    for row in rows
                ]
        return content


def _unread_excitation(kind: Any, rows: Any) -> str:
    """Why rows of an excitation of a type (None: without a type) cannot be read; empty
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
    """Read two tables, inertias and links; arguments and result are those of
    :func:`tors_content`.

    Rows above the first heads are left out, which is an error. Without a table of
    inertias the ends of links become disks with harmless ones.
    """
    csv_text = read_csv(text, source)
    lines = [line for line in csv_text.lines if any(line.cells)]
    content: dict[str, list[dict[str, Any]]] = {}
    heads = None
    units: list[str] = []
    for line in lines:
        cells = line.cells
        where = f"{source}, line {line.number}"
        if cells[0] in ("name", "from"):
            units = [name_and_unit(cell)[1] for cell in cells]
            names = [name_and_unit(cell)[0] for cell in cells]
            heads = _heads(names, source, errors)
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
        row: dict[str, Any] = {
            head: _cell(csv_text, head, cell, unit)
            for head, cell, unit in zip(heads, cells, units, strict=False)
            if head and cell
        }
        table = "disk"
        if heads[0] == "from":
            table = row.pop("link", "shaft")
            between = [row.pop(end) for end in ("from", "to") if end in row]
            row = {"between": between} | row
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
    reference = content["disk"][0].get("name")
    scene = {"description": f"From {source}", "reference": reference}
    return {"scene": scene} | content


def _heads(heads: list[str], source: str, errors: list[str]) -> list[str | None]:
    """Keys that the heads of columns mean; None for a head that means no key of the
    table.
    """
    keys = [f.name for f in dataclasses.fields(Disk)]
    if heads[0] == "from":
        link_keys = dict.fromkeys(
            f.name for cls in (Shaft, Mesh) for f in dataclasses.fields(cls)
        )
        link_keys.pop("between")
        keys = ["from", "to", "link", *link_keys]
    unknown = [head for head in heads if head not in keys]
    errors += [
        f"{source}: unknown column {shown(head)}.{suggestion(head, keys)}"
        for head in unknown
    ]
    errors += [
        f"{source}: two columns are called {key!r}. Keep one."
        for key in keys
        if heads.count(key) > 1
    ]
    free = [key for key in keys if key not in heads]
    meant = {
        head: next(iter(difflib.get_close_matches(head, free, n=1)), None)
        for head in unknown
    }
    return [meant.get(head, head) for head in heads]


def _cell(table: CsvText, head: str, cell: str, unit: str) -> str | float:
    """A number where it is one, with the unit of its head; names stay text."""
    if head in ("name", "from", "to", "link") or not table.is_number(cell):
        return cell
    if unit:
        return f"{table.number(cell)!r} {unit}"
    return int(cell) if cell.isdecimal() else table.number(cell)
