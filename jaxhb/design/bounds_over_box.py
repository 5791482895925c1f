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

import itertools
from dataclasses import dataclass

import numpy as np

from jaxhb._program import Program
from jaxhb.balance.problem import problem_at
from jaxhb.equations import backlash, dynamic_stiffness, fourier
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.linear import strength
from jaxhb.train.changes import locate

CLOSE = 1.02  # bound over the largest response found at which a box is halved no more
BOXES = 1000  # for a quantity at a speed, at most
# Share of its tolerance below which a number is halved no more: no damping bounds a
# resonance there
FINEST = 1e-6
TOGETHER = 16  # boxes that are halved at a time
# Share of its root mean square by which a signal may be larger between the instants
# looked at
BETWEEN = 2e-3
INSTANTS, COMBINED = (
    100,
    1000,
)  # highest and lowest instants, and pairs of them, whose polynomials are looked at
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
"""What of a signal, or a power, a quantity is."""
OF_LINKS = ("stiffness", "loss_factor", "damping")
OF_DISKS = ("inertia", "damping")
OF_LOADS = {
    "torque": ("mean",),
    "cylinder": ("gas_factor", "injection", "gas_torque_mean", "reciprocating_mass"),
}
OF_LOADS["mesh"] = ("backlash",)
"""Numbers on which torques, or the places of the flanks, depend linearly."""


def bounds_over_box(train, rpm, box, found, harmonics=None):
    """Upper bounds ``(n, Q)`` of the responses of all trains in a
    :class:`~jaxhb.design.tolerances.Box`, nan where none is guaranteed, ``(n, Q)``
    sentences why, "" where one is, and the index of a speed and the shares of each
    train on the way whose response is above ``found`` ``(n, Q)``, the largest known.
    """
    places: list = []
    bound = np.full(found.shape, np.nan)
    why = np.full(found.shape, "", dtype=object)
    numbers, fault = _numbers(train, box)
    for i, speed in enumerate(rpm):
        if fault or not np.isfinite(found[i]).all():
            why[i] = fault or "the scene as it is was not solved"
            continue
        lanes = _Speed(train, float(speed), box, numbers, harmonics)
        parting = lanes.parting()
        for j, one in enumerate(box.objectives):
            if parting or one.quantity not in READ_AS:
                why[i, j] = parting or f"no bound of {one.quantity} is known"
                continue
            value, place = lanes.bound(one, found[i, j])
            if np.isfinite(value):
                bound[i, j] = value
            else:
                why[i, j] = "no bound was found, as at a resonance without damping"
            places += [] if place is None else [(i, place)]
    return bound, why.astype(str), places


@dataclass(frozen=True)
class _Number:
    """A number within its tolerance, ``middle + u[share] slope``, and the ``element``
    of the equations that it changes, ("link", i) or ("disk", i), None of loads.
    """

    name: str
    share: int
    middle: float
    slope: float
    element: tuple | None
    field: str


def _numbers(train, box):
    """The numbers of a box as :class:`_Number`, and why there is no bound over it, ""
    where there may be one.
    """
    topology = train.topology
    found = []
    loaded = []
    if not topology.linear_in_contact:
        beside = [topology.link_names[link] for link, *_ in topology.springs]
        varying = [
            name
            for name, own in zip(topology.mesh_names, topology.mesh_varies, strict=True)
            if own
        ]
        return (), f"the stiffness of {(beside + varying)[0]} is not constant"
    for j, (one, own) in enumerate(zip(box.parameters, box.nominal, strict=True)):
        for name, value in own:
            table, field, index = locate(topology, name)
            element = None
            if table in ("shaft", "damper", "mesh") and field in OF_LINKS:
                element = "link", topology.link_names.index(name[: -len(field) - 1])
            elif table in ("disk", "damper") and field in OF_DISKS:
                element = (
                    "disk",
                    index + (topology.n_scene_disks if table == "damper" else 0),
                )
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
            ratio = value / own[0][1] if own[0][1] else 1.0
            half = (one.high - one.low) / 2
            found.append(
                _Number(name, j, ratio * (one.low + half), ratio * half, element, field)
            )
    if len(set(loaded)) < len(loaded):
        return (), "two numbers of one excitation multiply each other"
    return tuple(found), ""


_motions = Program(dynamic_stiffness.solve_linear)


class _Speed:
    """The train at one speed. Arrays have harmonics first: ``y`` (H, K, R) and ``G``
    (H, K, K) of the K elements whose numbers vary, their deflections and motions under
    R loads, the own one and its changes with the P shares, and under forces at each
    other; ``forces``, ``deflections``, ``motions`` (H, L or S, R + K) of all links and
    disks.
    """

    def __init__(self, train, rpm, box, numbers, harmonics):
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
        both = [
            (a, b)
            for a, b in pairs
            if a.element == b.element and (a.field, b.field) == OF_LINKS[:2]
        ]
        self.products = sorted({(a.share, b.share) for a, b in both})
        self.own, self.flank = (
            box.unbounded(train),
            np.zeros(len(train.topology.mesh_names)),
        )
        self._solve()
        if any(train.topology.mesh_backlash):
            # Which flanks are pressed, linear springs tell: on a wrong one no teeth are
            # found in contact.
            self.flank = np.sign(
                self.forces[0, len(self.forces[0]) - len(self.flank) :, 0].real
            )
            self._solve()

    def _loads(self, share=None, end=0.0):
        """Load on the disks ``(S, H)`` N, how far teeth are from l = 0 without a force
        ``(M, H)`` m, and how much they deflect from there at least in contact ``(M,)``
        m; of the train, or with one share of its loads at an end.
        """
        own = [one for one in self.numbers if one.share == share and not one.element]
        train = (
            self.train.replace({one.name: one.middle + end * one.slope for one in own})
            if own
            else self.train
        )
        problem = problem_at(train, self.rpm, self.harmonics)
        meshes = problem.meshes
        gap = np.array(train.topology.mesh_backlash, dtype=bool)
        load = backlash.error_load(
            problem.system, meshes, problem.frequency, problem.load
        )
        error = (
            np.zeros((len(gap), 1), complex) if meshes.error is None else meshes.error
        )
        load, error = (
            np.array(fourier.resize(a, self.harmonics)) for a in (load, error)
        )
        # Beyond the knee f = c (l - e): e is where the flank would be without a
        # transition.
        place = np.where(gap, backlash.offset(meshes.law) / meshes.law.stiffness, 0.0)
        load[:, 0] += problem.system.spread(
            meshes.law.stiffness * self.flank * place, meshes.link
        )
        error[:, 0] += self.flank * place
        return problem, (load, error, np.where(gap, meshes.law.knee - place, 0.0))

    def _solve(self):
        problem, base = self._loads()
        system = problem.system
        meshes = problem.meshes.link
        loads = [base]
        loaded = {number.share for number in self.numbers if not number.element}
        for share in range(len(self.own)):
            ends = [
                self._loads(share, end)[1] if share in loaded else base
                for end in (-1.0, 1.0)
            ]
            loads.append(
                tuple((high - low) / 2 for low, high in zip(*ends, strict=True))
            )
        load, error, self.knee = (
            np.stack(parts, axis=1) for parts in zip(*loads, strict=True)
        )
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
        self.forces, self.deflections, self.motions = (
            a.transpose(2, 0, 1).copy() for a in (force, bent, moved)
        )
        for k, (kind, i) in enumerate(self.elements):
            if (
                kind == "link"
            ):  # its force is (C + D) y, and D y the force of the unit load
                self.forces[:, i, count + k] -= 1.0

    def _stiffness_at(self, u, omega):
        """Dynamic stiffness ``(B, H, K)`` N/m of the elements that vary, at shares u
        ``(B, P)``.
        """
        system = self.system
        found = []
        shafts = len(self.system.loss) - len(self.flank)
        for kind, i in self.elements:
            square = (
                float(system.radius[system.tree.end_a[i] if kind == "link" else i]) ** 2
            )
            square = 1.0 if kind == "link" and i >= shafts else square
            if kind == "link":
                law = dynamic_stiffness.complex_stiffness
                own = {
                    "stiffness": system.stiffness[i],
                    "loss_factor": system.loss[i],
                    "damping": system.viscous[i],
                }
            else:
                law = dynamic_stiffness.disk_stiffness
                own = {
                    "inertia": system.mass[i],
                    "damping": system.damping[i],
                    "ground": system.ground[i],
                }
            for number in self.numbers:
                if number.element == (kind, i):
                    value = number.middle + u[:, [number.share]] * number.slope
                    own[number.field] = value / (
                        1.0 if number.field == "loss_factor" else square
                    )
            found.append(
                np.broadcast_to(law(omega, *own.values()), (len(u), len(omega)))
            )
        return (
            np.array(found, complex).reshape(-1, len(u), len(omega)).transpose(1, 2, 0)
        )

    def _changes(self, u, half, omega):
        """How far the elements are from their own stiffness ``(B, H, K)`` at the
        centres u ``(B, P)`` of boxes, and its changes over half their widths ``(B, H,
        K, P + E)``; behind the shares stand products of two of them.
        """

        def at(move):
            return self._stiffness_at(u + move, omega)

        # Exact, as no number but stiffness times loss factor is a product.
        steps = half * np.eye(u.shape[1])[:, None]
        middle = at(0.0)
        changes = [(at(step) - at(-step)) / 2 for step in steps]
        for a, b in ((steps[j], steps[k]) for j, k in self.products):
            mixed = (at(a + b) - at(a - b) - at(b - a) + at(-a - b)) / 4
            changes.append((at(a) + at(-a)) / 2 - middle if (a == b).all() else mixed)
        return middle - self._stiffness_at(self.own[None], omega), np.stack(
            changes, axis=-1
        )

    def _model(self, row, which, half, u, centre, w):
        """Of an observed row ``(H, R + K)`` at some harmonics over boxes the terms of
        the polynomials, ``(B, H)``, ``(B, H, P + E)``, ``(B, H, P + E, P + E)``, and
        what is left at most, ``(B, H)``, infinite where none is known; and what every
        number has to do with that, ``(B, P + E)``. u, half : ``(B, P)``; centre, w : of
        the boxes.
        """
        count = self.y.shape[-1]
        G = self.G[which]
        every = np.eye(len(self.elements))
        # The observed stands in one array with the deflections, behind them.
        loads = np.concatenate([self.y[which], row[which, None, :count]], axis=1)
        own = loads[..., 0] + np.einsum("bp,hxp->bhx", u - self.own, loads[..., 1:])
        moved = loads[None, ..., 1:] * half[:, None, None]
        moved = np.pad(moved, [(0, 0)] * 3 + [(0, w.shape[-1] - moved.shape[-1])])
        given = np.concatenate(
            [
                np.broadcast_to(G, (len(u), *G.shape)),
                own[..., :-1, None],
                moved[..., :-1, :],
            ],
            axis=-1,
        )
        given, solved = _solved(every + G * centre[..., None, :], given)
        G, y, moved_y = np.split(given, [len(every), len(every) + 1], axis=-1)
        held = row[which, count:] * centre
        g = row[which, None, count:]
        q = own[..., -1] - (held * y[..., 0]).sum(-1)
        moved_q, g = (
            (b - held[..., None, :] @ a)[..., 0, :]
            for a, b in ((moved_y, moved[..., -1:, :]), (G, g))
        )
        first = moved_y - G @ (w * y)
        gw = g[..., None] * w
        linear = moved_q - (gw * y).sum(-2)
        quadratic = -gw.swapaxes(-1, -2) @ first
        size = np.abs(G)
        parts = np.abs(w)
        g = np.abs(g)[..., None, :]
        change = parts.sum(-1)
        both = np.stack([np.ones(change.shape), np.abs(first).sum(-1)], axis=-1)
        ends, contracting = _solved(every - size * change[..., None, :], both)
        one, v = np.moveaxis(ends, -1, 0)
        regular = (one > 0).all(-1) & solved & contracting
        beyond = (size @ (change * v)[..., None])[..., 0]
        left = np.where(regular, (g[..., 0, :] * change * beyond).sum(-1), np.inf)
        # A number takes part as the first or the second change of what is left, or in
        # what keeps the train irregular.
        part = g @ (parts * beyond[..., None]) + (g * change[..., None, :]) @ size @ (
            parts * v[..., None]
        )
        all_regular = regular.all(1)[:, None, None]
        part = np.where(
            all_regular, part[..., 0, :], (size @ parts).sum(2) * ~regular[..., None]
        )
        return (q, linear, quadratic, left), part.sum(1)

    def parting(self):
        """Which teeth are not known to stay in contact all over the tolerances, "" if
        all are.
        """
        for mesh in np.flatnonzero(self.train.topology.mesh_backlash):
            # How far its teeth are from the knee, on the other side: never above 0 in
            # contact.
            row = (
                -self.flank[mesh]
                * self.deflections[
                    :, self.deflections.shape[1] - len(self.flank) + mesh
                ]
            )
            row[0, : self.knee.shape[1]] += self.knee[mesh]
            if self._largest(row, "max", 0, -np.inf, 0.0)[0] > 0:
                return f"teeth of {self.train.topology.mesh_names[mesh]} may separate"
        return ""

    def bound(self, one, found):
        """The bound of an Objective, infinite where there is none, ``found`` the
        largest response known; and shares of a train that has a larger one, or None.
        """
        topology = self.train.topology
        train = self.train
        quantity = one.quantity
        name = one.of
        kind = READ_AS[quantity]
        at = 0
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
            i = at = topology.link_index(name)[0]
            # From N to N m on the pitch circle of the rotor.
            arm = (
                1.0
                if name in topology.mesh_names
                else float(self.system.radius[self.system.tree.end_a[i]])
            )
            row = self.deflections[:, i] if kind == "power" else arm * self.forces[:, i]
        if quantity == "power over limit":
            factor = 1 / float(strength.power_limit(train, name))
        elif quantity == "tooth torque over limit":
            factor = float(np.divide(*strength.rated_gear(train, name)))
        elif quantity.startswith("stress"):
            factor = float(strength.stress_of(train, name, 1.0))
            if " over " in quantity:
                factor /= float(
                    strength.stress_limits(train, name, self.rpm)[
                        "transient" in quantity
                    ]
                )
        if kind == "order":
            at = round(one.order * topology.revolutions_per_cycle)
        if factor == 0 or (kind == "order" and at > self.harmonics):
            return 0.0, None
        value, place = self._largest(row, kind, at, found / factor, CLOSE)
        return factor * value, place

    def _largest(self, row, kind, at, found, close):
        """The bound over all tolerances of a row ``(H, R + K)`` read as ``kind``, of
        harmonic or link ``at``, near ``close`` times the largest value where that takes
        few boxes; and shares with more than ``found``, or None.
        """
        low = -np.ones((1, len(self.own)))
        high = np.ones((1, len(self.own)))
        place = None
        bounds = parts = np.zeros(0)
        new = (low, high)
        chosen = np.zeros(0, dtype=int)
        limits = np.inf
        low, high, parts = low[:0], high[:0], low[:0]
        while True:
            new_bounds, new_parts, own = self._bounds(row, kind, at, *new, found)
            if own.max() > found:
                found = own.max()
                place = new[0][own.argmax()] / 2 + new[1][own.argmax()] / 2
            # What holds of the whole holds of its halves.
            pairs = (
                (low, new[0]),
                (high, new[1]),
                (parts, new_parts),
                (bounds, np.minimum(new_bounds, limits)),
            )
            low, high, parts, bounds = (
                np.concatenate([np.delete(old, chosen, 0), more]) for old, more in pairs
            )
            chosen = np.argsort(-bounds, kind="stable")[:TOGETHER]
            chosen = chosen[
                (bounds[chosen] > close * found) & (parts[chosen] > 0).any(1)
            ]
            if not len(chosen) or len(bounds) >= BOXES or (kind == "max" and found > 0):
                return float(bounds.max()), place
            which = np.repeat(chosen, 2)
            lower = np.arange(0, 2 * len(chosen), 2)
            along = parts[chosen].argmax(1)
            new = (low[which], high[which])
            limits = bounds[which]
            middle = (low + high)[chosen, along] / 2
            new[1][lower, along] = new[0][lower + 1, along] = middle

    def _bounds(self, row, kind, at, low, high, found):
        """Bounds ``(B,)`` over boxes, or what is found where that is more, what each
        number has to do with them ``(B, P)``, and the values at the centres ``(B,)``.
        """
        constant = kind in ("max", "peak")
        which = (
            np.array([at])
            if kind == "order"
            else np.arange(0 if constant else 1, len(self.omega))
        )
        u = (low + high) / 2
        half = (high - low) / 2
        centre, w = self._changes(u, half, self.omega[which])
        (q, linear, quadratic, left), parts = self._model(
            row, which, half, u, centre, w
        )
        for e, pair in enumerate(self.products):
            parts[:, pair] += parts[:, [low.shape[1] + e]]
        parts = parts[:, : low.shape[1]] * (half > FINEST)
        if kind == "power":
            # What of the square of its deflection a link turns into heat.
            heat = 2 * self.omega[which]
            own = np.array([one == ("link", at) for one in self.elements], dtype=float)
            damping = (
                heat * (self.stiffness[which, at] + centre @ own).imag,
                heat[:, None] * (own @ w).imag,
            )
            values, slopes, squares, left = _power(*damping, q, linear, quadratic, left)
            return (
                np.maximum(_over_corners(values, slopes, squares) + left, found),
                parts,
                values,
            )
        # The amplitude of an order is the largest value of a cosine, whatever its
        # harmonic.
        weight = np.where(which > 0, 2.0, 1.0)
        waves = np.ones(1) if kind == "order" else which
        bend = weight * (np.pi * waves) ** 2 / 2
        size = np.sqrt(np.abs(q) ** 2 @ weight)
        count = (
            int(
                np.ceil(
                    np.sqrt(
                        np.max(np.abs(q) @ bend / np.where(size > 0, size, 1.0))
                        / BETWEEN
                    )
                )
            )
            + 4
        )
        phase = weight[:, None] * np.exp(
            2j * np.pi / count * waves[:, None] * np.arange(count)
        )
        phase = np.concatenate([phase, -phase], axis=1) if kind == "peak" else phase
        values = (q @ phase).real
        slopes = (linear.swapaxes(1, 2) @ phase).real.swapaxes(1, 2)
        own = (values.max(1) - values.min(1)) / 2 if kind == "swing" else values.max(1)
        found = max(found, own.max())
        curved = np.abs(quadratic).sum((2, 3))
        # From a largest value to the nearest instant a signal falls by its second
        # derivative at most.
        between = (np.abs(q) + np.abs(linear).sum(2) + curved + left) @ bend / count**2
        curved = curved @ weight
        left = left @ weight
        bounds = np.full(len(low), np.inf)
        for i in np.flatnonzero(np.isfinite(left)):

            def squares(at, own=quadratic[i]):
                return (own.reshape(len(own), -1).T @ phase[:, at]).real.T.reshape(
                    -1, *own.shape[1:]
                )

            polynomials = values[i], slopes[i], squares, curved[i], left[i]
            bounds[i] = between[i] + _largest_of(
                *polynomials, found - between[i], kind == "swing"
            )
        return bounds, parts, own


def _solved(matrices, right):
    """Solutions of linear equations, 0 where a matrix is singular, and where none
    is.
    """
    try:
        found = np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        regular = np.linalg.matrix_rank(matrices) == matrices.shape[-1]
        found = np.linalg.solve(
            np.where(regular[..., None, None], matrices, np.nan), right
        )
    good = np.isfinite(found).all((-2, -1))
    return np.where(good[..., None, None], found, 0.0), good


def _largest_of(values, slopes, quadratic, curved, left, least, swing):
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
        i, j = (
            index.ravel()
            for index in np.meshgrid(
                np.arange(len(top)), np.arange(len(bottom)), indexing="ij"
            )
        )
        values = (values[top][i] - values[bottom][j]) / 2
        slopes = (slopes[top][i] - slopes[bottom][j]) / 2
        kept, lost = _highest(values + np.abs(slopes).sum(1) + beyond, least, COMBINED)
        squares = (quadratic(top)[i[kept]] - quadratic(bottom)[j[kept]]) / 2
        out = max(out, below, lost)
    else:
        kept, out = _highest(values + reach + beyond, least, COMBINED)
        squares = quadratic(kept)
    return max(
        least,
        out,
        (_over_corners(values[kept], slopes[kept], squares) + left).max(
            initial=-np.inf
        ),
    )


def _highest(values, least, most):
    """The places of at most so many values, the largest above ``least``, and the
    largest that is left out.
    """
    order = np.argsort(-values)[: most + 1]
    order = order[values[order] > least]
    return order[:most], values[order[most]] if len(order) > most else -np.inf


def _over_corners(values, slopes, squares):
    """The bound ``(T,)`` of quadratic polynomials over -1 to 1 in each of P numbers."""
    squares = (squares + squares.swapaxes(1, 2)) / 2
    steep = np.abs(slopes) >= 2 * np.abs(squares).sum(2)
    corner = np.where(steep, np.sign(slopes), 0.0)
    turned = (squares @ corner[..., None])[..., 0]
    # A square is never negative, its term at most 0 where its factor is less.
    sizes = np.abs(squares)
    own = np.einsum("tjj->tj", squares)
    mixed = ((sizes @ ~steep[..., None])[..., 0] - (np.abs(own) - own) / 2) * ~steep
    return values + (
        corner * (slopes + turned) + ~steep * np.abs(slopes + 2 * turned) + mixed
    ).sum(1)


def _power(damping, damping1, y, y1, y2, yr):
    """Of ``sum damping |y|^2`` over harmonics ``(B, H)`` the polynomials ``(B,)``,
    ``(B, P)``, ``(B, P, P)`` and what is left at most ``(B,)``.
    """
    sizes = np.abs(y), np.abs(y1).sum(2), np.abs(y2).sum((2, 3))
    own = np.conj(y)[..., None]
    both = (np.conj(y1)[..., None] * y1[..., None, :]).real
    square = sizes[0] ** 2
    square1 = 2 * (own * y1).real
    square2 = both + 2 * (own[..., None] * y2).real
    c = damping[..., None]
    values = (damping * square).sum(1)
    slopes = (c * square1 + damping1 * square[..., None]).sum(1)
    squares = (
        c[..., None] * square2 + damping1[..., None] * square1[..., None, :]
    ).sum(1)
    Y, Y1, Y2 = sizes
    grown = np.abs(damping1).sum(2)
    all_of_y = Y + Y1 + Y2
    third = (2 * Y1 + Y2) * Y2
    left = (
        damping * third
        + grown * (Y1**2 + 2 * Y * Y2 + third)
        + (damping + grown) * (2 * all_of_y + yr) * yr
    )
    return values, slopes, squares, left.sum(1)
