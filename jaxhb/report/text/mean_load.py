"""What the teeth do at the mean load of a speed, as a line of text and as plain numbers."""

from jaxhb.report.text.columns import percent


def mean_load_text(load, rpm):
    """A line that tells the tangent stiffness of every mesh with backlash.

    Parameters
    ----------
    load : MeanLoad
    rpm : float

    Returns
    -------
    str

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.linear.tangent import at_mean_load
    >>> mean_load_text(at_mean_load(jaxhb.load_scene("spur_pair"), rpm=2000.0), 2000.0)
    'Mean load of 2000 rpm: gear a|gear b 1 kN in contact.'
    """
    said = [_mesh(*one) for one in zip(load.names, load.force, load.engagement, load.share, strict=True)]
    return f"Mean load of {rpm:g} rpm: {', '.join(said) or 'no mesh has backlash'}."


def _mesh(name, force, engagement, share):
    if engagement == 1:
        return f"{name} {force / 1e3:.4g} kN in contact"
    where = "in the gap" if engagement == 0 else "in the transition zone"
    return f"{name} {force / 1e3:.4g} kN {where}, {percent(share)} % of its stiffness"


def mean_load_record(load, rpm):
    """What ``modes --at --json`` adds: ``at_rpm`` and ``mean_load``, by mesh with backlash ``force`` (N, elastic),
    ``stiffness`` (N/m, tangent) and ``engagement`` (0 in the gap, 1 in contact)."""
    rows = zip(load.names, load.force.tolist(), load.stiffness.tolist(), load.engagement.tolist(), strict=True)
    return {
        "at_rpm": rpm,
        "mean_load": {name: dict(zip(("force", "stiffness", "engagement"), row, strict=True)) for name, *row in rows},
    }
