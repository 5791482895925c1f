"""Moliboshko's splitting of characteristic polynomials, a second way to their coefficients.

A polynomial is a tuple of coefficients, highest power first, in whatever numbers the links carry: with fractions all is
exact. ``k_i = c_i + r_i p``; the polynomial R of a piece is monic, of a free tree without the factor p^2, of a piece
that is held or has a loop the whole determinant over the inertias. Chapter 3 of the source, Table 1, as it must read
(docs/theory C2, checked with random rationals), gamma_ij = k_i k_j / I_m^2 at the mass m shared by the links i and j:

====  ================  ===========================================================================================
row   system            equivalent
====  ================  ===========================================================================================
1     chain 1-4         R_1 R_24 - gamma_12 R_34 = R_12 R_34 - gamma_23 R_1 R_4
2     branch 5-6 at 3   R_12 R_36 - gamma_23 R_1 R_4 R_56(3) - gamma_25 R_1 R_6 R_34(3); printed: gamma_35, wrong
3     ring 1-4          R_14 opened at mass 2 - gamma_12 R_34 - 2 prod k_i/I_i; printed: prod c_i/I_i, if undamped
4     ring 3-6, tail    R_1 R0_26 - gamma_12 R0_36, or opened at mass 4:
                        R_16 - gamma_34 R_1256 - 2 R_12(3) prod k_i/I_i;
                        printed: R_1 R_26 - gamma_12 R0_36 - 2 prod c_i/I_i, whose last term has a wrong dimension
====  ================  ===========================================================================================

The two misprints are those of rows 2 and 4; c for k in rows 3 and 4 leaves damping out. :func:`split_at_mass` is the
rule of rows 1 and 2 for any tree, :func:`open_ring` that of rows 3 and 4 for any system with one loop.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Links:
    """A small system of masses and links, numbers of any exact or inexact kind.

    inertia, damping, ground : dict mass -> I, b, stiffness to ground
    ends : dict link -> (mass, mass); arms : dict link -> (arm, arm); stiffness : dict link -> (c, r)
    """

    inertia: dict
    damping: dict
    ground: dict
    ends: dict
    arms: dict
    stiffness: dict

    def over(self, mass, link):
        """``k a^2 / I_m`` of a link at one of its masses, as a polynomial."""
        arm = self.arms[link][self.ends[link].index(mass)]
        return times(self.spring(link), (arm**2 / self.inertia[mass],))

    def spring(self, link):
        """``r p + c``."""
        c, r = self.stiffness[link]
        return (r, c) if r else (c,)

    def at(self, mass, links):
        """Those of ``links`` that end at a mass."""
        return [link for link in links if mass in self.ends[link]]


def times(a, b):
    """Product of two polynomials, coefficients of the highest power first."""
    product = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            product[i + j] += x * y
    return tuple(product)


def less(a, b):
    """Their difference."""
    return plus(a, tuple(-value for value in b))


def plus(a, b):
    """Their sum."""
    size = max(len(a), len(b))
    a, b = (0,) * (size - len(a)) + tuple(a), (0,) * (size - len(b)) + tuple(b)
    return tuple(x + y for x, y in zip(a, b, strict=True))


def determinant(links, chosen, masses, held=()):
    """``det / prod I``, of twice the degree of the free masses, of chosen links; those ``held`` grounded and left out.

    The graph may have one loop.
    """
    free = [mass for mass in masses if mass not in held]
    diagonal = {}
    for mass in free:
        value = (links.inertia[mass], links.damping[mass], links.ground[mass])
        value = tuple(number / links.inertia[mass] for number in value)
        for link in links.at(mass, chosen):
            value = plus(value, links.over(mass, link))
        diagonal[mass] = value
    between = [link for link in chosen if all(mass in diagonal for mass in links.ends[link])]
    return _expand(links, diagonal, between, tuple(free), {(): (1,)})


def _expand(links, diagonal, between, masses, known):
    """Determinant of some masses, by the one with fewest links, a leaf if there is one; ``known`` by masses."""
    if masses in known:
        return known[masses]
    between = [link for link in between if all(mass in masses for mass in links.ends[link])]
    mass = min(masses, key=lambda mass: len(links.at(mass, between)))
    others = links.at(mass, between)
    without = [link for link in between if link not in others]

    def rest(*passed):
        return _expand(links, diagonal, without, tuple(m for m in masses if m != mass and m not in passed), known)

    total = times(diagonal[mass], rest())
    for link in others:  # over a link and back, and the two ways round the ring
        for other in others:
            a, b = _far(links, link, mass), _far(links, other, mass)
            for way, passed in [((), (a,))] if a == b else _ways(links, without, a, b):
                steps = _over_all(links, (link, *way, other), (mass, *passed))
                total = less(total, times(steps, rest(*passed)))
    known[masses] = total
    return total


def _over_all(links, chosen, masses):
    """Product of ``k a b`` over links, each as often as it is named, and of 1/I over masses."""
    product = (1,)
    for link in chosen:
        product = times(times(links.spring(link), (links.arms[link][0] * links.arms[link][1],)), product)
    for mass in masses:
        product = times(product, (1 / links.inertia[mass],))
    return product


def _ways(links, chosen, a, b, passed=()):
    """Paths over chosen links from mass a to b as (links, masses passed)."""
    if a == b:
        return [((), (*passed, a))]
    found = []
    for link in links.at(a, chosen):
        far = _far(links, link, a)
        if far not in passed:
            found += [((link, *way), masses) for way, masses in _ways(links, chosen, far, b, (*passed, a))]
    return found


def piece(links, chosen, held=()):
    """R of the piece of some links, monic, 1 of none: of a free tree without p^2, else the whole determinant.

    Masses ``held`` do not move.
    """
    masses = list(dict.fromkeys(mass for link in chosen for mass in links.ends[link]))
    found = determinant(links, chosen, masses, held)
    loose = not any(links.ground[mass] or links.damping[mass] or mass in held for mass in masses)
    # Of a free tree the last two coefficients are 0: rigid rotation makes p^2 a factor.
    return found[:-2] if chosen and loose and len(masses) == len(chosen) + 1 else found


def split_at_mass(links, mass, part):
    """R of a free tree split at a mass: ``R_A R_B - sum gamma_ij x (what is behind i, j) x (the rest, held)``.

    ``part`` are the links of one side A. The same as :func:`piece` of all links.
    """
    other = [link for link in links.ends if link not in part]
    branches = {link: _behind(links, mass, link) for link in links.at(mass, links.ends)}
    total = times(piece(links, part), piece(links, other))
    for i in links.at(mass, part):
        for j in links.at(mass, other):
            term = times(links.over(mass, i), links.over(mass, j))
            for branch in (i, j):
                term = times(term, piece(links, [link for link in branches[branch] if link != branch]))
            for branch in branches.keys() - {i, j}:
                term = times(term, piece(links, branches[branch], held=[mass]))
            total = less(total, term)
    return total


def open_ring(links, mass, link):
    """R^0 of a free system with one loop, opened at a mass of the ring that carries nothing else.

    ``R^0 = R_open - gamma_ij R_rest - 2 R_outside prod k/I``: ``link`` (j), one of the two of that mass, is moved to a
    second mass as heavy as the first; rest is without both links of the mass; outside is all but the ring with its
    masses held. The same as :func:`piece` of all links.
    """
    kept, copy = next(l for l in links.at(mass, links.ends) if l != link), (mass, "again")
    ends = {**links.ends, link: tuple(copy if m == mass else m for m in links.ends[link])}
    more = {
        name: {**getattr(links, name), copy: getattr(links, name)[mass]} for name in ("inertia", "damping", "ground")
    }
    opened = Links(**more, ends=ends, arms=links.arms, stiffness=links.stiffness)
    rest = [l for l in links.ends if l not in (link, kept)]
    around, passed = _ways(links, rest, _far(links, kept, mass), _far(links, link, mass))[0]
    ring = (kept, *around, link)
    outside = piece(links, [l for l in links.ends if l not in ring], held=[mass, *passed])
    pair = times(times(links.over(mass, kept), links.over(mass, link)), piece(links, rest))
    twice = times((2,), times(_over_all(links, ring, (mass, *passed)), outside))
    return less(less(piece(opened, list(ends)), pair), twice)


def _behind(links, mass, link):
    """Links of the branch that begins with ``link`` at a mass."""
    found, masses = [link], [_far(links, link, mass)]
    for here in masses:
        for onward in links.at(here, links.ends):
            if onward not in found:
                found.append(onward)
                masses.append(_far(links, onward, here))
    return found


def _far(links, link, mass):
    a, b = links.ends[link]
    return b if a == mass else a
