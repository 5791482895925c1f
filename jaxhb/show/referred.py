"""Numbers of a train as they are and referred to the reference rotor, as text."""

from ..model.ratios import referred
from .columns import aligned


def referred_text(train):
    """Inertias, stiffnesses and dampings, actual and referred, with the factor between them.

    Parameters
    ----------
    train : DriveTrain

    Returns
    -------
    str

    Examples
    --------
    >>> from jaxhb.model.scene import load_scene
    >>> print(referred_text(load_scene("spur_pair")).splitlines()[2].split())
    ['gear', 'a', '1', '0.00281448', '0.00281448']
    """
    found = referred(train)
    disks = [found.disks, *map(_numbers, (found.factor, found.inertia, found.inertia_referred))]
    kinds = ["shaft"] * len(train.topology.shaft_names) + ["damper"] * len(train.topology.damper_names)
    kinds += ["mesh"] * len(train.topology.mesh_names)
    names = "link_factor", "stiffness", "stiffness_referred", "damping", "damping_referred"
    links = [found.links, kinds, *(_numbers(getattr(found, name)) for name in names)]
    name = train.topology.name or "scene"
    parts = [
        f"{name}: inertias, actual and referred to the reference rotor\n"
        + aligned(["disk", "speed ratio i", "J kg m2", "J i^2"], disks)
    ]
    if found.links:
        title = "Stiffness k and damping r of links; of meshes in N/m and N s/m, their factor is i x radius in m"
        heads = ["link", "", "factor i", "k N m/rad", "k i^2", "r N m s/rad", "r i^2"]
        parts.append(f"{title}\n" + aligned(heads, links, left=(1,)))
    return "\n\n".join(parts)


def _numbers(values):
    return [f"{value:.6g}" for value in values]
