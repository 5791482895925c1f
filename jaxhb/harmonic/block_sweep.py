"""Elimination of a tree of links from its leaves to its root, in dynamic-stiffness form, under ``lax.scan``.

Node s hangs on its parent p by one link with deflection ``l = alpha x_s - beta x_p`` and force ``f = C l``. With ``P``
the dynamic stiffness and ``psi`` the load collected at the node, elimination of the node delivers to the parent

    f = pi - Y x_p,    Y = beta C (P + alpha^2 C)^{-1} P,    pi = alpha C (P + alpha^2 C)^{-1} psi.

Unlike the textbook recursion, ``Y`` is exactly zero for a part that nothing holds: a soft ground costs no digits;
link forces come from ``pi - Y x_p``, never from differences of displacements. The scalar sweep treats every harmonic
at once; the block sweep treats dense blocks that couple all harmonics (Newton's matrix along a chain).
Source: Fridman 2009, (10)-(12), in the form of Moliboshko's equivalent transformation; forces of all branches of a node
add in ``P`` and ``psi``, which is what a fictitious node of the seed's numbering does.
"""

import jax
import jax.numpy as jnp
from jax import lax


def _divide(numerator, denominator):
    """Quotient, 0 where the denominator is 0 (a ring behind a purely viscous link at the mean)."""
    singular = denominator == 0
    return jnp.where(singular, 0.0, numerator / jnp.where(singular, 1.0, denominator))


def _regular(pivot, link):
    """A pivot that vanishes exactly (an undamped part at resonance with its upper node held) moved by rounding.

    The whole train need not be singular there; a pivot that vanishes together with its link stays zero.
    """
    return jnp.where(pivot == 0, jnp.finfo(float).eps * jnp.abs(link), pivot)


def scalar_sweep(parent, near, far, link, node, load):
    """Solve a tree of scalar links for all harmonics and several loads.

    Parameters
    ----------
    parent : int array ``(S,)``
        Position of the parent, larger than the own position; S for the root (last).
    near, far : arrays ``(S,)``
        Arms alpha and beta of the link to the parent; of no meaning for the root.
    link : complex array ``(S, H)``
        Dynamic stiffness C of the link to the parent; of no meaning for the root.
    node : complex array ``(S, H)``
        Dynamic stiffness of the node itself, ground included.
    load : complex array ``(S, H, R)``

    Returns
    -------
    displacement, force : complex arrays ``(S, H, R)``
        ``force`` of the link to the parent, positive for ``alpha x_s > beta x_p``; zero at the root.
    """
    size = node.shape[0]

    def eliminate(carry, item):
        stiffness, moment = carry
        position, up, alpha, beta, C = item
        P, psi = stiffness[position], moment[position]
        pivot = _regular(P + alpha**2 * C, alpha**2 * C)
        gain = _divide(alpha * C, pivot)
        transfer = _divide(beta * C * P, pivot)
        pi = gain[:, None] * psi
        stiffness = stiffness.at[up].add(beta * transfer)
        moment = moment.at[up].add(beta * pi)
        return (stiffness, moment), (pivot, psi, transfer, pi)

    positions = jnp.arange(size - 1)
    items = (positions, parent[:-1], near[:-1], far[:-1], link[:-1])
    (stiffness, moment), (pivot, psi, transfer, pi) = lax.scan(eliminate, (node, load), items)
    root = moment[-1] / stiffness[-1][:, None]

    def substitute(displacement, item):
        position, up, alpha, beta, C, pivot, psi, transfer, pi = item
        above = displacement[up]
        follow = jnp.where(pivot == 0, beta / alpha, _divide(alpha * beta * C, pivot))
        below = _divide(psi, pivot[:, None]) + follow[:, None] * above
        return displacement.at[position].set(below), pi - transfer[:, None] * above

    start = jnp.zeros_like(load).at[-1].set(root)
    displacement, force = lax.scan(substitute, start, (*items, pivot, psi, transfer, pi), reverse=True)
    return displacement, jnp.concatenate([force, jnp.zeros_like(root)[None]])


def block_sweep(parent, near, far, link, node, load):
    """Solve a tree of links with dense blocks: the same elimination, C and P matrices.

    Parameters
    ----------
    parent, near, far : as in :func:`scalar_sweep`
    link, node : arrays ``(S, P, P)``
    load : array ``(S, P)``

    Returns
    -------
    displacement : array ``(S, P)``
    pivot_quality : float
        Smallest ratio of the extreme diagonal entries of U over all pivots, a cheap sign of a breakdown: elimination
        without pivoting between blocks fails at a part that is singular with its upper node held.
    """
    width = node.shape[-1]

    def eliminate(carry, item):
        stiffness, moment = carry
        position, up, alpha, beta, C = item
        P, psi = stiffness[position], moment[position]
        factor = jax.scipy.linalg.lu_factor(P + alpha**2 * C)
        diagonal = jnp.abs(jnp.diagonal(factor[0]))
        solved = jax.scipy.linalg.lu_solve(factor, jnp.concatenate([P, psi[:, None], C], axis=1))
        passed = C @ solved[:, : width + 1]
        stiffness = stiffness.at[up].add(beta**2 * passed[:, :width])
        moment = moment.at[up].add(alpha * beta * passed[:, width])
        quality = diagonal.min() / diagonal.max()
        return (stiffness, moment), (solved[:, width], alpha * beta * solved[:, width + 1 :], quality)

    items = (jnp.arange(node.shape[0] - 1), parent[:-1], near[:-1], far[:-1], link[:-1])
    (stiffness, moment), (free, follow, quality) = lax.scan(eliminate, (node, load), items)
    root = jnp.linalg.solve(stiffness[-1], moment[-1])

    def substitute(displacement, item):
        position, up, free, follow = item
        return displacement.at[position].set(free + follow @ displacement[up]), None

    start = jnp.zeros_like(load).at[-1].set(root)
    displacement, _ = lax.scan(substitute, start, (items[0], items[1], free, follow), reverse=True)
    return displacement, quality.min(initial=1.0)
