"""Contact of the teeth of one mesh over a cycle: separation, reverse contact, impacts.
Host arithmetic.
"""

from dataclasses import dataclass

import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array, Number
from jaxhb.equations import backlash, fourier


@by_value
@dataclass(frozen=True)
class Contact:
    """Contact of one mesh over one cycle.

    Parameters
    ----------
    separated_fraction : share of the cycle in which the teeth are apart: ``|l|`` is
    below the gap of the law
    reverse_contact_fraction : share of the cycle in contact on the flank that does not
    drive
    impacts : entries into contact, dicts of ``cycle`` (share of the cycle), ``speed``
    in m/s, ``side`` +1 or -1
    drive_side : sign of the mesh's mean force
    gap_spring_force, knee_force : N, the largest force in the gap; the force above
    which the tooth is stiff
    pulling_force : N, largest damping force that holds parting teeth back in the gap:
    law "always"
    """

    separated_fraction: float
    reverse_contact_fraction: float
    impacts: list[dict[str, float]]
    drive_side: int
    gap_spring_force: float
    knee_force: float
    pulling_force: float

    @property
    def impacts_per_cycle(self) -> int:
        """Number of impacts over the cycle of the response."""
        return len(self.impacts)

    @property
    def hardest_impact(self) -> float:
        """Largest approach speed of an impact, m/s; 0 without one."""
        return max((impact["speed"] for impact in self.impacts), default=0.0)


def contact_of(
    law: backlash.Law | None,
    deflection: np.ndarray,
    force: np.ndarray,
    elastic: np.ndarray,
    frequency: float,
    resolution: int,
) -> Contact:
    """:class:`Contact` from the coefficients ``(n+1,)`` of a mesh's deflection in m and
    of its force, whole and elastic, in N; ``law`` of floats, None for a linear mesh.
    """
    if deflection.ndim > 1:
        raise ValueError(
            "contact is read speed by speed: take one response of the sweep,"
            " sweep[i].mesh(...)"
        )
    # A motion that was not found has nan forces.
    drive = int(np.nan_to_num(np.sign(force[0].real)))
    if law is None:
        return Contact(0.0, 0.0, [], drive, 0.0, 0.0, 0.0)
    samples = max(resolution, 4096)
    # No comparison below sees nan.
    unknown = 0.0 if np.isfinite(deflection).all() else np.nan
    l = fourier.synthesize(deflection, samples)
    speed = fourier.synthesize(fourier.derivative(deflection, frequency), samples)
    gap = law.gap
    damping = fourier.synthesize(force - elastic, samples)
    pull = np.where(backlash.separated(law, l), -np.sign(l) * damping, 0.0)
    # Without a mean force neither flank drives: the first is taken.
    side = drive if drive else 1
    return Contact(
        # By two levels of l: between two samples it may pass the whole gap, which |l|
        # would not show.
        separated_fraction=_fraction_below(l, gap) - _fraction_below(l, -gap) + unknown,
        reverse_contact_fraction=_fraction_below(side * l, -gap) + unknown,
        impacts=_impacts(l, speed, gap),
        drive_side=drive,
        gap_spring_force=float(law.gap_spring_force),
        knee_force=float(law.knee_force),
        pulling_force=float(pull.max(initial=0.0)) + unknown,
    )


def _fraction_below(values: Array, level: Number) -> float:
    """Share of the cycle with values < level, the crossings interpolated linearly."""
    here = values - level
    ahead = np.roll(values, -1) - level
    both = (here < 0) & (ahead < 0)
    crossing = (here < 0) != (ahead < 0)
    # Divisions by zero lie where nothing crosses.
    with np.errstate(divide="ignore", invalid="ignore"):
        below = np.where(here < 0, here / (here - ahead), ahead / (ahead - here))
    return float((both + np.where(crossing, below, 0.0)).mean())


def _impacts(l: Array, speed: Array, gap: Number) -> list[dict[str, float]]:
    """Entries into contact: |l| rises through ``gap``."""
    distance = np.abs(l)
    ahead = np.abs(np.roll(l, -1))
    entries = np.flatnonzero((distance < gap) & (ahead >= gap))
    after = (entries + 1) % len(l)
    share = (gap - distance[entries]) / (ahead - distance)[entries]
    approach = np.abs((1 - share) * speed[entries] + share * speed[after])
    columns = (entries + share) / len(l), approach, np.sign(l[after])
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [
        {"cycle": instant, "speed": approach_speed, "side": int(side)}
        for instant, approach_speed, side in rows
    ]
