"""Upper bounds of the responses of all trains within tolerances, where the equations
are linear.

With all teeth in contact a train is linear, ``Z(n) x = T(n)`` at every harmonic.
Numbers of links and disks change it by ``A D A^T``, A the deflections of the links, and
the motions of the disks, whose numbers vary, D diagonal: ``dk (1 + i eta) + i n Omega
dr``, ``-(n Omega)^2 dJ + i n Omega dd``. With ``G = A^T Z^-1 A`` at the centre of a
box, its deflections and any observed force or motion follow from small matrices alone
(Woodbury's identity),

    y = y0 - G D y,      q = q0 - g D y.

Over the box ``D = sum_j delta_j w_j``, ``|delta_j| <= 1``, and ``|D| <= d = sum_j
|w_j|``; y0 and q0 may depend on delta as well (torques). Then ``y = y0 + sum_j delta_j
y_j + e`` with ``y_j = y0_j - G w_j y0``, and

    q = q0 + sum_j delta_j (q0_j - g w_j y0) - sum_jk delta_j delta_k g w_j y_k + r,
    |r| <= |g| d |G| d v,    |e| <= |G| d v,    v = (1 - |G| d)^-1 sum_j |y_j|,

elementwise, where ``1 - |G| d`` is a nonsingular M-matrix, which is so if it maps some
positive vector to a positive one: then the train is regular all over the box.

Theorem. The largest value over the box of a linear function of q, as a signal at an
instant, is at most that of the quadratic polynomial and ``sum |r|``. A polynomial in
delta is at most its value at the corner to which its slopes point, for all delta_j
whose slope has one sign over the box, and the sum of the sizes of its terms in the
others. Between M instants a signal is larger by at most ``sum_n n^2 |s_n| (pi / M)^2``,
half of its largest second derivative times the square of the way to the nearest. The
bound over the tolerances is the largest over boxes that cover them, each halved until
its bound is hardly above a response found.

It is proved up to rounding, for the motion whose teeth stay in contact, which the same
bounds of the deflections at the teeth show to exist in every train within the
tolerances; another motion, in which teeth part, may coexist with it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from jaxhb._jax import Array
from jaxhb._program import Program
from jaxhb.balance.problem import Problem, problem_at
from jaxhb.design.quantities import Objective
from jaxhb.design.tolerances import Box
from jaxhb.equations import backlash, dynamic_stiffness, fourier
from jaxhb.linear import strength
from jaxhb.train.changes import locate
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.varying import at_speed

CLOSE = 1.02  # bound over the largest response found at which a box is halved no more
BOXES = 1000  # for a quantity at a speed, at most
# Share of its tolerance below which a number is halved no more: no damping bounds a
# resonance there
FINEST = 1e-6
TOGETHER = 16  # boxes that are halved at a time
# Share of its root mean square by which a signal may be larger between the instants
# looked at
BETWEEN = 2e-3
INSTANTS = 100  # highest and lowest instants whose polynomials are looked at
COMBINED = 1000  # pairs of instants whose polynomials are looked at
READ_AS = {
    "tooth force peak": "peak",
    "damper power": "power",
    "power over limit": "power",
}
READ_AS |= dict.fromkeys(
    ("tooth force", "shaft torque", "gear torque", "angle", "tooth torque over limit"),
    "swing",
)
READ_AS |= dict.fromkeys(
    ("stress", "stress over continuous limit", "stress over transient limit"), "swing"
)
READ_AS |= dict.fromkeys(
    ("tooth force order", "shaft torque order", "angle order"), "order"
)
"""The size of a signal, or the power, that a quantity is."""

OF_LINKS = {"stiffness": "stiffness", "loss_factor": "loss", "damping": "viscous"}
OF_DISKS = {"inertia": "mass", "damping": "damping", "ground": "ground"}
"""Numbers of links and disks, and their fields of a System, in the order of the
arguments of a dynamic stiffness.
"""
OF_LOADS = {
    "torque": ("mean",),
    "cylinder": ("gas_factor", "injection", "gas_torque_mean", "reciprocating_mass"),
}
OF_LOADS["mesh"] = ("backlash",)
"""Numbers on which torques, or the places of the flanks, depend linearly."""

# A link or disk of the equations: ("link", i) or ("disk", i)
Element: TypeAlias = tuple[str, int]


def bounds_over_box(
    train: DriveTrain,
    rpm: np.ndarray,
    box: Box,
    largest: np.ndarray,
    harmonics: int | None = None,
) -> tuple[np.ndarray, np.ndarray, list[tuple[int, np.ndarray]]]:
    """Bound the responses of all trains in a :class:`~jaxhb.design.tolerances.Box`.

    Upper bounds ``(n, Q)``, nan where none is guaranteed, ``(n, Q)`` sentences why, ""
    where one is, and the index of a speed and the shares of each train on the way whose
    response is above ``largest`` ``(n, Q)``, the largest known.
    """
    places: list[tuple[int, np.ndarray]] = []
    bound = np.full(largest.shape, np.nan)
    why = np.full(largest.shape, "", dtype=object)
    numbers, fault = _numbers(train, box)
    for i, speed in enumerate(rpm):
        if fault or not np.isfinite(largest[i]).all():
            why[i] = fault or "the nominal scene was not solved"
            continue
        of_speed = _Speed(train, float(speed), box, numbers, harmonics)
        parting = of_speed.parting()
        for j, objective in enumerate(box.objectives):
            if parting or objective.quantity not in READ_AS:
                why[i, j] = parting or f"no bound of {objective.quantity} is known"
                continue
            value, place = of_speed.bound(objective, largest[i, j])
            if np.isfinite(value):
                bound[i, j] = value
            else:
                why[i, j] = "no bound was found, as at a resonance without damping"
            if place is not None:
                places.append((i, place))
    return bound, why.astype(str), places


@dataclass(frozen=True)
class _Number:
    """A number within its tolerance, ``middle + u[share] slope``, and the ``element``
    of the equations that it changes, None of loads.
    """

    name: str
    share: int
    middle: float
    slope: float
    element: Element | None
    field: str


def _numbers(train: DriveTrain, box: Box) -> tuple[tuple[_Number, ...], str]:
    """List the numbers of a box as :class:`_Number`, and why there is no bound over it,
    "" where there may be one.
    """
    topology = train.topology
    numbers = []
    loaded = []
    tuned = {topology.link_names[link] for link in topology.order_links}
    if not topology.linear_in_contact:
        with_springs = [topology.link_names[link] for link, *_ in topology.springs]
        meshes = zip(topology.mesh_names, topology.mesh_varies, strict=True)
        varying = [name for name, varies in meshes if varies]
        return (), f"the stiffness of {(with_springs + varying)[0]} is not constant"
    for j, (tolerance, nominal) in enumerate(
        zip(box.parameters, box.nominal, strict=True)
    ):
        for name, value in nominal:
            table, field, index = locate(topology, name)
            element: Element | None = None
            if table in ("shaft", "damper", "mesh") and field in OF_LINKS:
                element = "link", topology.link_names.index(name[: -len(field) - 1])
            elif field in OF_DISKS and name[: -len(field) - 1] in tuned:
                return (), f"{name} is in the stiffness of its link, too"
            elif table in ("disk", "damper") and field in OF_DISKS:
                rings_from = topology.n_scene_disks if table == "damper" else 0
                element = ("disk", index + rings_from)
            elif (table, field) == ("ground", "stiffness"):
                element = ("disk", topology.ground_disk[index])
                field = "ground"
            elif field not in OF_LOADS.get(table, ()):
                return (), f"the response is no simple function of {name}"
            else:
                loaded.append((table, index))
            if element and element[0] == "link" and field == "stiffness" and value == 0:
                return (), f"{name} is 0 in the scene"
            # With one number of 0 none is together, and the ratio is of no use.
            _, first_value = nominal[0]
            ratio = value / first_value if first_value else 1.0
            half = (tolerance.high - tolerance.low) / 2
            middle = ratio * (tolerance.low + half)
            numbers.append(_Number(name, j, middle, ratio * half, element, field))
    if len(set(loaded)) < len(loaded):
        return (), "two numbers of one excitation multiply each other"
    return tuple(numbers), ""


_motions = Program(dynamic_stiffness.solve_linear)


class _Speed:
    """The train at one speed. Arrays have harmonics first: ``y`` (H, K, R) and ``G``
    (H, K, K) of the K elements whose numbers vary, their deflections and motions under
    R loads, the load of the train and its changes with the P shares, and under forces
    at each other; ``forces``, ``deflections``, ``motions`` (H, L or S, R + K) of all
    links and disks.
    """

    def __init__(
        self,
        train: DriveTrain,
        rpm: float,
        box: Box,
        numbers: tuple[_Number, ...],
        harmonics: int | None,
    ):
        train = at_speed(train, rpm)
        self.train = train
        self.rpm = rpm
        self.box = box
        self.numbers = numbers
        listed = listed_harmonic(train.topology)
        self.harmonics = min(harmonics or listed, listed)
        self.elements = list(
            dict.fromkeys(number.element for number in numbers if number.element)
        )
        pairs = itertools.product(numbers, repeat=2)
        coupled = [
            (a, b)
            for a, b in pairs
            if a.element == b.element
            and (a.field, b.field) == ("stiffness", "loss_factor")
        ]
        self.products = sorted({(a.share, b.share) for a, b in coupled})
        self.nominal_shares = box.unbounded(train)
        self.flank = np.zeros(len(train.topology.mesh_names))
        self._solve()
        if any(train.topology.mesh_backlash):
            # Which flanks are pressed, linear springs tell: on a wrong one no teeth are
            # found in contact.
            self.flank = np.sign(
                self.forces[0, len(self.forces[0]) - len(self.flank) :, 0].real
            )
            self._solve()

    def _loads(
        self, share: int | None = None, end: float = 0.0
    ) -> tuple[Problem, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """The problem, and its loads: on the disks ``(S, H)`` N, how far teeth are from
        l = 0 without a force ``(M, H)`` m, and how much they deflect from there at
        least in contact ``(M,)`` m; of the train, or with one share of its loads at an
        end.
        """
        train = self.train
        moved = {
            number.name: number.middle + end * number.slope
            for number in self.numbers
            if number.share == share and not number.element
        }
        if moved:
            train = train.replace(moved)
        problem = problem_at(train, self.rpm, self.harmonics)
        meshes = problem.meshes
        has_gap = np.array(train.topology.mesh_backlash, dtype=bool)
        load = backlash.error_load(
            problem.system, meshes, problem.frequency, problem.load
        )
        error = (
            np.zeros((len(has_gap), 1), complex)
            if meshes.error is None
            else meshes.error
        )
        load = np.array(fourier.resize(load, self.harmonics))
        error = np.array(fourier.resize(error, self.harmonics))
        # Beyond the knee f = c (l - e): e is where the flank would be without a
        # transition.
        place = np.where(
            has_gap, backlash.offset(meshes.law) / meshes.law.stiffness, 0.0
        )
        load[:, 0] += problem.system.spread(
            meshes.law.stiffness * self.flank * place, meshes.link
        )
        error[:, 0] += self.flank * place
        return problem, (load, error, np.where(has_gap, meshes.law.knee - place, 0.0))

    def _solve(self) -> None:
        """Solve for the responses to the loads, and to unit forces at the elements
        whose numbers vary.
        """
        problem, base = self._loads()
        system = problem.system
        meshes = problem.meshes.link
        loads = [base]
        loaded = {number.share for number in self.numbers if not number.element}
        for share in range(len(self.nominal_shares)):
            low_loads = high_loads = base
            if share in loaded:
                _, low_loads = self._loads(share, -1.0)
                _, high_loads = self._loads(share, 1.0)
            ends = zip(low_loads, high_loads, strict=True)
            loads.append(tuple((high - low) / 2 for low, high in ends))
        load = np.stack([load for load, _, _ in loads], axis=1)
        error = np.stack([error for _, error, _ in loads], axis=1)
        self.knee = np.stack([knee for _, _, knee in loads], axis=1)
        incidence = np.asarray(system.incidence())
        disks = np.eye(len(system.mass))
        columns = [
            incidence[:, i] if kind == "link" else disks[i] for kind, i in self.elements
        ]
        units = dynamic_stiffness.unit_forces(
            np.reshape(columns, (-1, len(disks))).T, self.harmonics + 1
        )
        omega = float(problem.frequency) * np.arange(self.harmonics + 1)
        moved, force = map(
            np.array, _motions(system, omega, np.concatenate([load, units], axis=1))
        )
        stiffness = np.asarray(dynamic_stiffness.link_stiffness(system, omega))[:, None]
        count = load.shape[1]
        force[meshes, :count] -= stiffness[meshes] * error
        # From the forces: differences of displacements lose the digits of stiff links.
        bent = np.where(
            stiffness == 0,
            system.deflections(moved),
            force / np.where(stiffness == 0, 1.0, stiffness),
        )
        of_elements = [
            (bent if kind == "link" else moved)[i] for kind, i in self.elements
        ]
        seen = (
            np.array(of_elements, complex)
            .reshape(len(columns), count + len(columns), len(omega))
            .transpose(2, 0, 1)
        )
        self.y = seen[..., :count]
        self.G = seen[..., count:]
        self.omega = omega
        self.system = system
        self.stiffness = stiffness[:, 0].T
        self.forces = force.transpose(2, 0, 1).copy()
        self.deflections = bent.transpose(2, 0, 1).copy()
        self.motions = moved.transpose(2, 0, 1).copy()
        for k, (kind, i) in enumerate(self.elements):
            # The force of a link is (C + D) y, and D y the force of the unit load.
            if kind == "link":
                self.forces[:, i, count + k] -= 1.0

    def _stiffness_at(self, u: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """Dynamic stiffness ``(B, H, K)`` N/m of the elements that vary, at shares u
        ``(B, P)``.
        """
        system = self.system
        stiffness = []
        shafts = len(self.system.loss) - len(self.flank)
        for kind, i in self.elements:
            square = (
                float(system.radius[system.tree.end_a[i] if kind == "link" else i]) ** 2
            )
            square = 1.0 if kind == "link" and i >= shafts else square
            dynamic, names = (
                (dynamic_stiffness.complex_stiffness, OF_LINKS)
                if kind == "link"
                else (dynamic_stiffness.disk_stiffness, OF_DISKS)
            )
            fields: dict[str, Array] = {
                name: getattr(system, field)[i] for name, field in names.items()
            }
            for number in self.numbers:
                if number.element == (kind, i):
                    value = number.middle + u[:, [number.share]] * number.slope
                    fields[number.field] = value / (
                        1.0 if number.field == "loss_factor" else square
                    )
            values = dynamic(omega, *fields.values())
            stiffness.append(np.broadcast_to(values, (len(u), len(omega))))
        return (
            np.array(stiffness, complex)
            .reshape(-1, len(u), len(omega))
            .transpose(1, 2, 0)
        )

    def _changes(
        self, u: np.ndarray, half: np.ndarray, omega: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """How far the elements are from their stiffness in the train ``(B, H, K)`` N/m
        at the centres u ``(B, P)`` of boxes, and its changes over half their widths
        ``(B, H, K, P + E)``; behind the shares stand products of two of them.
        """

        def at(move: np.ndarray | float) -> np.ndarray:
            return self._stiffness_at(u + move, omega)

        # Exact, as no number but stiffness times loss factor is a product.
        steps = half * np.eye(u.shape[1])[:, None]
        middle = at(0.0)
        changes = [(at(step) - at(-step)) / 2 for step in steps]
        for a, b in ((steps[j], steps[k]) for j, k in self.products):
            mixed = (at(a + b) - at(a - b) - at(b - a) + at(-a - b)) / 4
            changes.append((at(a) + at(-a)) / 2 - middle if (a == b).all() else mixed)
        nominal = self._stiffness_at(self.nominal_shares[None], omega)
        return middle - nominal, np.stack(changes, axis=-1)

    def _model(
        self,
        row: np.ndarray,
        which: np.ndarray,
        half: np.ndarray,
        u: np.ndarray,
        centre: np.ndarray,
        w: np.ndarray,
    ) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
        """Polynomials of an observed row ``(H, R + K)`` at some harmonics over boxes.

        Their terms ``(B, H)``, ``(B, H, P + E)``, ``(B, H, P + E, P + E)``, and the
        remainder at most, ``(B, H)``, infinite where none is known; and the share of
        every number in that, ``(B, P + E)``. u, half : ``(B, P)``; centre, w : of the
        boxes.
        """
        count = self.y.shape[-1]
        G = self.G[which]
        identity = np.eye(len(self.elements))
        # The observed stands in one array with the deflections, behind them.
        loads = np.concatenate([self.y[which], row[which, None, :count]], axis=1)
        centred = loads[..., 0] + np.einsum(
            "bp,hxp->bhx", u - self.nominal_shares, loads[..., 1:]
        )
        moved = loads[None, ..., 1:] * half[:, None, None]
        moved = np.pad(moved, [(0, 0)] * 3 + [(0, w.shape[-1] - moved.shape[-1])])
        right = np.concatenate(
            [
                np.broadcast_to(G, (len(u), *G.shape)),
                centred[..., :-1, None],
                moved[..., :-1, :],
            ],
            axis=-1,
        )
        right, solved = _solved(identity + G * centre[..., None, :], right)
        G, y, moved_y = np.split(right, [len(identity), len(identity) + 1], axis=-1)
        row_at_centre = row[which, count:] * centre
        g = row[which, None, count:]
        q = centred[..., -1] - (row_at_centre * y[..., 0]).sum(-1)
        row_at_centre = row_at_centre[..., None, :]
        moved_q = (moved[..., -1:, :] - row_at_centre @ moved_y)[..., 0, :]
        g = (g - row_at_centre @ G)[..., 0, :]
        first = moved_y - G @ (w * y)
        gw = g[..., None] * w
        linear = moved_q - (gw * y).sum(-2)
        quadratic = -gw.swapaxes(-1, -2) @ first
        size = np.abs(G)
        parts = np.abs(w)
        g = np.abs(g)[..., None, :]
        change = parts.sum(-1)
        right_of_ends = np.stack(
            [np.ones(change.shape), np.abs(first).sum(-1)], axis=-1
        )
        ends, contracting = _solved(
            identity - size * change[..., None, :], right_of_ends
        )
        positive, v = np.moveaxis(ends, -1, 0)
        regular = (positive > 0).all(-1) & solved & contracting
        beyond = (size @ (change * v)[..., None])[..., 0]
        left = np.where(regular, (g[..., 0, :] * change * beyond).sum(-1), np.inf)
        # A number takes part as the first or the second change of the remainder, or in
        # an irregular train.
        participation = g @ (parts * beyond[..., None]) + (
            g * change[..., None, :]
        ) @ size @ (parts * v[..., None])
        all_regular = regular.all(1)[:, None, None]
        participation = np.where(
            all_regular,
            participation[..., 0, :],
            (size @ parts).sum(2) * ~regular[..., None],
        )
        return (q, linear, quadratic, left), participation.sum(1)

    def parting(self) -> str:
        """Say which teeth are not known to stay in contact all over the tolerances, ""
        if all are.
        """
        for mesh in np.flatnonzero(self.train.topology.mesh_backlash):
            # How far its teeth are from the knee, on the other side: never above 0 in
            # contact.
            link = self.deflections.shape[1] - len(self.flank) + mesh
            row = -self.flank[mesh] * self.deflections[:, link]
            row[0, : self.knee.shape[1]] += self.knee[mesh]
            beyond_knee, _ = self._largest(row, "max", 0, -np.inf, 0.0)
            if beyond_knee > 0:
                return f"teeth of {self.train.topology.mesh_names[mesh]} may separate"
        return ""

    def bound(
        self, objective: Objective, largest: float
    ) -> tuple[float, np.ndarray | None]:
        """The bound of an Objective, infinite where there is none, ``largest`` the
        largest response known; and shares of a train that has a larger one, or None.
        """
        topology = self.train.topology
        train = self.train
        quantity = objective.quantity
        name = objective.of
        kind = READ_AS[quantity]
        index = 0
        factor = 1.0
        if quantity.startswith("angle"):
            i = topology.disk_index(name)
            row = self.motions[:, i] / float(self.system.radius[i])
        elif quantity == "gear torque":
            i = topology.disk_index(name)
            meshes = len(self.flank)
            senses = np.array(
                [(a == i) - (b == i) for a, b in topology.mesh_ends], dtype=float
            )
            row = np.einsum("m,hmk->hk", senses, self.forces[:, -meshes:]) * float(
                train.disks.radius[i]
            )
        else:
            i, _ = topology.link_index(name)
            index = i
            # From N to N m on the pitch circle of the rotor.
            arm = (
                1.0
                if name in topology.mesh_names
                else float(self.system.radius[self.system.tree.end_a[i]])
            )
            row = self.deflections[:, i] if kind == "power" else arm * self.forces[:, i]
        if quantity == "power over limit":
            factor = 1 / float(strength.LIMITS["heat"].of(train, name))
        elif quantity == "tooth torque over limit":
            radius, limit = strength.rated_gear(train, name)
            factor = float(np.divide(radius, limit))
        elif quantity.startswith("stress"):
            factor = float(strength.stress_of(train, name, 1.0))
            if " over " in quantity:
                limits = strength.stress_limits(train, name, self.rpm)
                factor /= float(limits["transient" in quantity])
        if kind == "order":
            assert objective.order is not None  # as its faults tell
            index = round(objective.order * topology.revolutions_per_cycle)
        if factor == 0 or (kind == "order" and index > self.harmonics):
            return 0.0, None
        value, place = self._largest(row, kind, index, largest / factor, CLOSE)
        return factor * value, place

    def _largest(
        self, row: np.ndarray, kind: str, index: int, largest: float, close: float
    ) -> tuple[float, np.ndarray | None]:
        """The bound over all tolerances of a row ``(H, R + K)`` read as ``kind``, of
        harmonic or link ``index``, near ``close`` times the largest value where that
        takes few boxes; and shares with more than ``largest``, or None.
        """
        new_low = -np.ones((1, len(self.nominal_shares)))
        new_high = np.ones((1, len(self.nominal_shares)))
        place = None
        chosen = np.zeros(0, dtype=int)
        limits: np.ndarray | float = np.inf
        low = new_low[:0]
        high = new_high[:0]
        parts = new_low[:0]
        bounds = np.zeros(0)
        while True:
            new_bounds, new_parts, centre_values = self._bounds(
                row, kind, index, new_low, new_high, largest
            )
            if centre_values.max() > largest:
                highest = centre_values.argmax()
                largest = centre_values.max()
                place = new_low[highest] / 2 + new_high[highest] / 2
            # A bound of the whole is one of its halves.
            pairs = (
                (low, new_low),
                (high, new_high),
                (parts, new_parts),
                (bounds, np.minimum(new_bounds, limits)),
            )
            low, high, parts, bounds = (
                np.concatenate([np.delete(old, chosen, 0), more]) for old, more in pairs
            )
            chosen = np.argsort(-bounds, kind="stable")[:TOGETHER]
            chosen = chosen[
                (bounds[chosen] > close * largest) & (parts[chosen] > 0).any(1)
            ]
            if (
                not len(chosen)
                or len(bounds) >= BOXES
                or (kind == "max" and largest > 0)
            ):
                return float(bounds.max()), place
            which = np.repeat(chosen, 2)
            lower = np.arange(0, 2 * len(chosen), 2)
            along = parts[chosen].argmax(1)
            new_low = low[which]
            new_high = high[which]
            limits = bounds[which]
            middle = (low + high)[chosen, along] / 2
            new_high[lower, along] = middle
            new_low[lower + 1, along] = middle

    def _bounds(
        self,
        row: np.ndarray,
        kind: str,
        index: int,
        low: np.ndarray,
        high: np.ndarray,
        largest: float,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bounds ``(B,)`` over boxes, or ``largest`` where that is more, the share of
        each number in them ``(B, P)``, and the values at the centres ``(B,)``.
        """
        constant = kind in ("max", "peak")
        which = (
            np.array([index])
            if kind == "order"
            else np.arange(0 if constant else 1, len(self.omega))
        )
        u = (low + high) / 2
        half = (high - low) / 2
        centre, w = self._changes(u, half, self.omega[which])
        (q, linear, quadratic, left), parts = self._model(
            row, which, half, u, centre, w
        )
        for column, pair in enumerate(self.products):
            parts[:, pair] += parts[:, [low.shape[1] + column]]
        parts = parts[:, : low.shape[1]] * (half > FINEST)
        if kind == "power":
            # Heat of a link over the square of its deflection.
            heat = 2 * self.omega[which]
            is_link = np.array(
                [element == ("link", index) for element in self.elements], dtype=float
            )
            damping = heat * (self.stiffness[which, index] + centre @ is_link).imag
            damping_changes = heat[:, None] * (is_link @ w).imag
            values, slopes, squares, left = _power(
                damping, damping_changes, q, linear, quadratic, left
            )
            bounds = np.maximum(_over_corners(values, slopes, squares) + left, largest)
            return bounds, parts, values
        # The amplitude of an order is the largest value of a cosine, whatever its
        # harmonic.
        weight = np.where(which > 0, 2.0, 1.0)
        waves = np.ones(1) if kind == "order" else which
        bend = weight * (np.pi * waves) ** 2 / 2
        size = np.sqrt(np.abs(q) ** 2 @ weight)
        most_bend = np.max(np.abs(q) @ bend / np.where(size > 0, size, 1.0))
        count = int(np.ceil(np.sqrt(most_bend / BETWEEN))) + 4
        phase = weight[:, None] * np.exp(
            2j * np.pi / count * waves[:, None] * np.arange(count)
        )
        phase = np.concatenate([phase, -phase], axis=1) if kind == "peak" else phase
        values = (q @ phase).real
        slopes = (linear.swapaxes(1, 2) @ phase).real.swapaxes(1, 2)
        centre_values = (
            (values.max(1) - values.min(1)) / 2 if kind == "swing" else values.max(1)
        )
        largest = max(largest, centre_values.max())
        curved = np.abs(quadratic).sum((2, 3))
        # From a largest value to the nearest instant a signal falls by its second
        # derivative at most.
        between = (np.abs(q) + np.abs(linear).sum(2) + curved + left) @ bend / count**2
        curved = curved @ weight
        left = left @ weight
        bounds = np.full(len(low), np.inf)
        for i in np.flatnonzero(np.isfinite(left)):

            def terms_at(
                instants: np.ndarray, terms: np.ndarray = quadratic[i]
            ) -> np.ndarray:
                flat = terms.reshape(len(terms), -1).T @ phase[:, instants]
                return flat.real.T.reshape(-1, *terms.shape[1:])

            bounds[i] = between[i] + _largest_of(
                values[i],
                slopes[i],
                terms_at,
                curved[i],
                left[i],
                largest - between[i],
                kind == "swing",
            )
        return bounds, parts, centre_values


def _solved(matrices: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve linear equations: solutions, 0 where a matrix is singular, and where none
    is.
    """
    try:
        solution = np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        regular = np.linalg.matrix_rank(matrices) == matrices.shape[-1]
        solution = np.linalg.solve(
            np.where(regular[..., None, None], matrices, np.nan), right
        )
    is_solved = np.asarray(np.isfinite(solution).all((-2, -1)))
    return np.where(is_solved[..., None, None], solution, 0.0), is_solved


def _largest_of(
    values: np.ndarray,
    slopes: np.ndarray,
    quadratic: Callable[[np.ndarray], np.ndarray],
    curved: float,
    left: float,
    least: float,
    swing: bool,
) -> float:
    """The bound of polynomials at instants ``(M,)``, ``(M, P)`` and, for some of them,
    ``(T, P, P)``, all of whose quadratic terms are at most ``curved``; with ``swing``
    of half the differences of any two; at least ``least``.
    """
    reach = np.abs(slopes).sum(1)
    beyond = curved + left
    if swing:
        high = values + reach
        low = values - reach
        top, out = _highest((high - low.min()) / 2 + beyond, least, INSTANTS)
        bottom, below = _highest((high.max() - low) / 2 + beyond, least, INSTANTS)
        # All pairs of a highest and a lowest instant.
        i = np.repeat(np.arange(len(top)), len(bottom))
        j = np.tile(np.arange(len(bottom)), len(top))
        values = (values[top][i] - values[bottom][j]) / 2
        slopes = (slopes[top][i] - slopes[bottom][j]) / 2
        selected, lost = _highest(
            values + np.abs(slopes).sum(1) + beyond, least, COMBINED
        )
        squares = (quadratic(top)[i[selected]] - quadratic(bottom)[j[selected]]) / 2
        out = max(out, below, lost)
    else:
        selected, out = _highest(values + reach + beyond, least, COMBINED)
        squares = quadratic(selected)
    bounds = _over_corners(values[selected], slopes[selected], squares) + left
    return max(least, out, bounds.max(initial=-np.inf))


def _highest(values: np.ndarray, least: float, most: int) -> tuple[np.ndarray, float]:
    """Select the places of at most so many values, the largest above ``least``, and the
    largest that is left out.
    """
    order = np.argsort(-values)[: most + 1]
    order = order[values[order] > least]
    return order[:most], values[order[most]] if len(order) > most else -np.inf


def _over_corners(
    values: np.ndarray, slopes: np.ndarray, squares: np.ndarray
) -> np.ndarray:
    """Bound quadratic polynomials ``(T,)`` over -1 to 1 in each of P numbers."""
    squares = (squares + squares.swapaxes(1, 2)) / 2
    steep = np.abs(slopes) >= 2 * np.abs(squares).sum(2)
    corner = np.where(steep, np.sign(slopes), 0.0)
    turned = (squares @ corner[..., None])[..., 0]
    # A square is never negative, its term at most 0 where its factor is less.
    sizes = np.abs(squares)
    diagonal = np.einsum("tjj->tj", squares)
    mixed = (
        (sizes @ ~steep[..., None])[..., 0] - (np.abs(diagonal) - diagonal) / 2
    ) * ~steep
    return values + (
        corner * (slopes + turned) + ~steep * np.abs(slopes + 2 * turned) + mixed
    ).sum(1)


def _power(
    damping: np.ndarray,
    damping1: np.ndarray,
    y: np.ndarray,
    y1: np.ndarray,
    y2: np.ndarray,
    yr: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Polynomials ``(B,)``, ``(B, P)``, ``(B, P, P)`` of ``sum damping |y|^2`` over
    harmonics ``(B, H)``, and their remainder at most ``(B,)``.
    """
    Y = np.abs(y)
    Y1 = np.abs(y1).sum(2)
    Y2 = np.abs(y2).sum((2, 3))
    conjugate = np.conj(y)[..., None]
    squares_of_y1 = (np.conj(y1)[..., None] * y1[..., None, :]).real
    square = Y**2
    square1 = 2 * (conjugate * y1).real
    square2 = squares_of_y1 + 2 * (conjugate[..., None] * y2).real
    c = damping[..., None]
    values = (damping * square).sum(1)
    slopes = (c * square1 + damping1 * square[..., None]).sum(1)
    squares = (
        c[..., None] * square2 + damping1[..., None] * square1[..., None, :]
    ).sum(1)
    grown = np.abs(damping1).sum(2)
    all_of_y = Y + Y1 + Y2
    third = (2 * Y1 + Y2) * Y2
    left = (
        damping * third
        + grown * (Y1**2 + 2 * Y * Y2 + third)
        + (damping + grown) * (2 * all_of_y + yr) * yr
    )
    return values, slopes, squares, left.sum(1)
