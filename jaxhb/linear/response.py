"""The periodic response of a drive train: disks, shafts, gears and meshes, read by name."""

import dataclasses
from dataclasses import dataclass, field

import jax
import numpy as np

from .._arrays import namespace
from ..harmonic import backlash
from ..model.drivetrain import DriveTrain
from .contact import contact_of
from .signal import Signal


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Response:
    """Steady periodic motion at one speed, or at several (every array then has a leading axis).

    Made by :func:`jaxhb.solve`, :func:`jaxhb.solve_speeds` and :func:`jaxhb.linear_response`; read with :meth:`force`,
    :meth:`torque`, :meth:`twist`, :meth:`gear_torque`, :meth:`disk` and :meth:`mesh`.

    Parameters
    ----------
    train : DriveTrain
    rpm : array, of the reference rotor
    angles : complex ``(..., S, N+1)`` rad, coefficients of the vibratory angle of every disk
    torques, elastic_torques : complex ``(..., K, N+1)`` N m, of the shafts and then the dampers
    deflections : complex ``(..., G, N+1)`` m, of the meshes
    forces, elastic_forces : complex ``(..., G, K+1)`` N, of the meshes; more harmonics than the motion has
    load_torque : ``(..., n)`` N m of every load, negative where it takes power; load_power : ``(...)`` W taken
    status, residual, truncation_error, steps : of the solve
    path : how the solve went, for people; resolution : instants per cycle at which extremes are looked for
    """

    train: DriveTrain
    rpm: jax.Array
    angles: jax.Array
    torques: jax.Array
    elastic_torques: jax.Array
    deflections: jax.Array
    forces: jax.Array
    elastic_forces: jax.Array
    load_torque: jax.Array
    load_power: jax.Array
    status: jax.Array
    residual: jax.Array
    truncation_error: jax.Array
    steps: jax.Array
    path: tuple = field(metadata={"static": True})
    resolution: int = field(metadata={"static": True})

    @property
    def topology(self):
        """Names and connections of the train."""
        return self.train.topology

    @property
    def harmonics(self):
        """Number of harmonics of the motion."""
        return self.angles.shape[-1] - 1

    @property
    def highest_harmonic(self):
        """Highest harmonic that moves a disk, per speed: of a sweep :attr:`harmonics` is the largest among them."""
        moves = np.any(np.asarray(self.angles) != 0, axis=-2)
        return np.max(np.where(moves, np.arange(moves.shape[-1]), 0), axis=-1)

    @property
    def converged(self):
        """True where residual and truncation error are within their limits."""
        return self.status == 0

    @property
    def load_kW(self):
        """Power taken by the loads in kW."""
        return self.load_power / 1e3

    def __len__(self):
        return len(self.rpm)

    def __getitem__(self, index):
        """Response number ``index`` (or a slice) of a batch."""
        if not namespace(self.rpm).ndim(self.rpm):
            raise TypeError("this is the response at one speed, not a sweep: it cannot be indexed")
        arrays = {
            f.name: getattr(self, f.name)[index]
            for f in dataclasses.fields(self)
            if f.name not in ("train", "path", "resolution")
        }
        if np.ndim(self.train.disks.inertia) > 1:
            arrays["train"] = jax.tree.map(lambda leaf: leaf[index], self.train)
        path = self.path[index] if len(self.path) == len(self.rpm) else self.path
        return dataclasses.replace(self, **arrays, path=(path,) if isinstance(path, str) else path)

    @property
    def ground_reaction(self):
        """Mean torque that each ground takes, N m ``(..., n)``: stiffness x mean angle of its disk.

        Mean angles are those that the soft grounds set; without a ground their inertia-weighted mean is zero.
        """
        disks = np.array(self.topology.ground_disk, dtype=int)
        return self.train.grounds.stiffness * self.angles[..., disks, 0].real

    def _signal(self, coefficients, elastic=None):
        return Signal(coefficients, elastic, self.topology.revolutions_per_cycle, self.resolution)

    def disk(self, name):
        """Vibratory angle of a disk or damper ring, rad; its own sense of rotation positive."""
        return self._signal(self.angles[..., self.topology.disk_index(name), :])

    def twist(self, a, b):
        """Angle of disk a less angle of disk b, rad."""
        first, second = self.topology.disk_index(a), self.topology.disk_index(b)
        return self._signal(self.angles[..., first, :] - self.angles[..., second, :])

    def torque(self, a, b=None):
        """Torque transmitted by a shaft or damper in N m, positive when a is ahead of b.

        Parameters
        ----------
        a, b : str
            The two disks (a damper's ring goes by the damper's name); or the link's name alone.

        Returns
        -------
        Signal
            Elastic, viscous and loss-factor part together; ``.elastic`` for the stiffness alone.
        """
        index, sense = self.topology.link_index(a, b)
        if index >= self.torques.shape[-2]:
            name = self.topology.link_names[index]
            raise ValueError(f"{name!r} is a mesh, not a shaft: use force(...) for its tooth force in N")
        return self._signal(sense * self.torques[..., index, :], sense * self.elastic_torques[..., index, :])

    def force(self, a, b=None):
        """Tooth force transmitted by the mesh between gears a and b in N, positive when a drives b.

        Elastic and damping part together; ``.elastic`` for f(l) alone. ``force(b, a)`` is the negative.
        """
        index, sense = self._mesh_index(a, b)
        return self._signal(sense * self.forces[..., index, :], sense * self.elastic_forces[..., index, :])

    def deflection(self, a, b=None):
        """Deflection l = r_a phi_a - r_b phi_b of a mesh, m."""
        index, sense = self._mesh_index(a, b)
        return self._signal(sense * self.deflections[..., index, :])

    def deflection_samples(self, count):
        """Deflections of all meshes at ``count`` instants of the cycle, ``(..., G, count)`` m."""
        return self._signal(self.deflections).samples(count)

    def _mesh_index(self, a, b):
        index, sense = self.topology.link_index(a, b)
        if index < self.torques.shape[-2]:
            name = self.topology.link_names[index]
            raise ValueError(f"{name!r} is a shaft or damper, not a mesh: use torque(...) for its torque in N m")
        return index - self.torques.shape[-2], sense

    def gear_torque(self, name):
        """Torque that a gear passes to its mates, the sum of its mesh forces x radius, N m."""
        disk = self.topology.disk_index(name)
        xp = namespace(self.forces)
        sense = np.array([(a == disk) - (b == disk) for a, b in self.topology.mesh_ends], dtype=float)
        if not sense.any():
            raise ValueError(f"{name!r} carries no mesh: gear_torque needs a gear")
        radius = xp.asarray(self.train.disks.radius)[..., disk, None]
        total = radius * xp.einsum("g,...gk->...k", sense, self.forces)
        return self._signal(total, radius * xp.einsum("g,...gk->...k", sense, self.elastic_forces))

    def mesh(self, a, b=None):
        """Contact of a mesh over the cycle (:class:`Contact`); its drive side is that of the scene's order of gears."""
        index, _ = self._mesh_index(a, b)
        meshes = self.train.meshes
        if not self.topology.mesh_backlash[index]:
            law = None
        else:
            law = backlash.Law(
                meshes.stiffness[index], meshes.epsilon[index], meshes.transition[index], meshes.backlash[index]
            )
        rate = self.topology.cycle_frequency(np.asarray(self.rpm))
        return contact_of(
            law,
            np.asarray(self.deflections[..., index, :]),
            np.asarray(self.forces[..., index, :]),
            np.asarray(self.elastic_forces[..., index, :]),
            rate,
            self.resolution,
        )

    def contacts(self):
        """:class:`Contact` of every mesh by name."""
        return {name: self.mesh(name) for name in self.topology.mesh_names}


def stack(rows):
    """Responses of one train at several speeds as one with a leading axis; all get the most harmonics among them.

    rows : per speed a Response, or a batch of them and the number of the one that is meant
    """
    rows = [row if isinstance(row, tuple) else (row, None) for row in rows]
    places = {}
    for place, (response, row) in enumerate(rows):
        places.setdefault(id(response), (response, [], []))[1].append(place)
        places[id(response)][2].append(row)
    parts = [(r, at, slice(None) if taken == [None] else taken) for r, at, taken in places.values()]
    wanted = dict.fromkeys(("angles", "torques", "elastic_torques", "deflections"), max(r.harmonics for r, *_ in parts))
    wanted |= dict.fromkeys(("forces", "elastic_forces"), max(r.forces.shape[-1] for r, *_ in parts) - 1)

    def joined(name):
        arrays = [np.asarray(getattr(r, name)) for r, *_ in parts]
        arrays = [array if np.ndim(r.rpm) else array[None] for array, (r, *_) in zip(arrays, parts, strict=True)]
        shape = (*arrays[0].shape[1:-1], wanted[name] + 1) if name in wanted else arrays[0].shape[1:]
        joint = np.zeros((len(rows), *shape), dtype=arrays[0].dtype)
        for (_, at, taken), array in zip(parts, arrays, strict=True):
            joint[(at, ..., slice(array.shape[-1])) if name in wanted else at] = array[taken]
        return joint

    single = ("train", "path", "resolution")
    names = [f.name for f in dataclasses.fields(Response) if f.name not in single]
    return Response(
        train=rows[0][0].train,
        path=tuple("; ".join(r.path) if row is None else r.path[row] for r, row in rows),
        resolution=max(r.resolution for r, *_ in parts),
        **{name: joined(name) for name in names},
    )
