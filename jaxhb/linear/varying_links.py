"""Links that vary in the linear forced response: their stiffness at every speed and harmonic, and their own amplitude.

The amplitude A of a link that depends on it is that of the sine with the mean square of its vibratory twist,
``A^2 = sum_k A_k^2`` over the orders. At each speed the amplitudes are a fixed point, ``A = g(A)`` with g a whole
linear response. It is where ``dA/dt = g(A) - A`` comes to rest from A = 0, by implicit steps that grow into those of
Newton's method (pseudo-transient continuation: C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35 (1998) 508). With one
such link that is the smallest fixed point, which always exists; with several the path need not come to rest. The
derivative is that of the implicit function, ``(1 - dg/dA) dA = dg``; second ones forwards over backwards, not twice
backwards.
"""

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..harmonic import linear_train
from ..model.ratios import speed_ratios
from ..model.varying import factors, order_stiffness, scaled


@dataclass(frozen=True)
class AmplitudeOptions:
    """How the amplitudes A = g(A) of links with ``over_amplitude`` are found, along a path from A = 0.

    Parameters
    ----------
    steps : of the path at most
    settled : g(A) - A at which the path ends, over g(0)
    accepted : the same over A, up to which an amplitude is found
    curved : share of g(A) - A by which a step may miss what its linearisation says
    """

    steps: int = 100
    settled: float = 1e-11
    accepted: float = 1e-8
    curved: float = 0.5


AMPLITUDE = AmplitudeOptions()


def varied(train, system, rpm, omega, amplitude):
    """The system of ``train`` without its tables, with the stiffness of every link at every frequency.

    Parameters
    ----------
    train : DriveTrain with tables; system : System of it without
    rpm : ``(m,)``; omega : ``(H,)`` rad/s, all harmonics of one speed after the other
    amplitude : ``(m, A)`` rad, of the links that depend on it

    Returns
    -------
    System
    """
    width, shafts = len(omega) // len(rpm), len(train.topology.shaft_names)

    def of_lanes(values):
        return jnp.repeat(values.T, width, axis=-1)

    links, stiffer, damped = factors(train, omega / (2 * np.pi), list(of_lanes(amplitude)))
    at = system.radius[np.array(train.topology.damper_disk, dtype=int)]
    stiffness, viscous, loss = (
        jnp.broadcast_to(a[:, None], (len(a), len(omega))) for a in (system.stiffness, system.viscous, system.loss)
    )
    # From N m/rad to N/m on the pitch circle of the rotor.
    tuned = of_lanes(order_stiffness(train, speed_ratios(train), rpm) / at**2)
    stiffness = stiffness.at[shafts : shafts + len(at)].add(tuned)
    return dataclasses.replace(
        system,
        stiffness=scaled(stiffness, links, stiffer),
        viscous=scaled(viscous, links, damped),
        loss=scaled(loss, links, damped),
    )


def twist_amplitude(train, system, deflection, speeds):
    """Amplitudes ``(m, A)`` in rad of the links that depend on them, from deflections ``(L, H)`` in m."""
    links = np.array(train.topology.amplitude_links, dtype=int)
    twist = deflection[links] / system.radius[system.tree.end_a[links]][:, None]
    # One-sided amplitudes are twice the coefficients; the mean is no vibration.
    orders = (4 * (twist.real**2 + twist.imag**2)).reshape(len(links), speeds, -1)[..., 1:]
    square = orders.sum(-1).T
    # The root has no derivative at 0, where nothing twists the link.
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def is_settled(amplitude, found):
    """Whether every amplitude of a speed ``(m,)`` is the one that it leads to."""
    return jnp.all(jnp.abs(found - amplitude) <= AMPLITUDE.accepted * found, axis=-1)


def _next(equations, amplitude):
    """g: the amplitudes of the response with links at ``amplitude`` ``(m, A)``."""
    train, system, rpm, omega, load = equations
    system = varied(train, system, rpm, omega, amplitude)
    _, force = linear_train.solve_linear(system, omega, load[:, None])
    C = linear_train.link_stiffness(system, omega)
    return twist_amplitude(train, system, force[:, 0] / jnp.where(C == 0, 1.0, C), len(rpm))


def _linearised(equations, amplitude):
    """g - A ``(m, A)``, and 1 - dg/dA ``(m, A, A)``."""
    found, push = jax.linearize(lambda a: _next(equations, a), amplitude)
    basis = jnp.eye(amplitude.shape[1])
    columns = jax.vmap(push)(jnp.broadcast_to(basis[:, None], (len(basis), *amplitude.shape)))
    return found - amplitude, basis - columns.transpose(1, 2, 0)


@jax.custom_jvp
def settled_amplitudes(equations):
    """Amplitudes ``(m, A)`` in rad that lead to themselves; see :func:`is_settled`.

    equations : (train, system, rpm ``(m,)``, omega ``(H,)``, load ``(S, H)``)
    """
    train, _, rpm, *_ = equations
    start = jnp.zeros((len(rpm), len(train.topology.amplitude_links)))
    change, matrix = _linearised(equations, start)
    scale = jnp.where(change > 0, change, 1.0)

    def size(change):
        return jnp.max(jnp.abs(change) / scale, axis=-1, initial=0.0)

    def going_on(state):
        _, change, _, _, steps = state
        return (steps < AMPLITUDE.steps) & jnp.any(size(change) > AMPLITUDE.settled)

    def step(state):
        amplitude, change, matrix, time, steps = state
        implicit = matrix + jnp.eye(matrix.shape[-1]) / time[:, None, None]
        move = jnp.linalg.solve(implicit, change[..., None])[..., 0]
        trial = jnp.maximum(amplitude + move, 0.0)
        now, tangent = _linearised(equations, trial)
        predicted = change - jnp.einsum("mij,mj->mi", matrix, trial - amplitude)
        # Where 1 - dg/dA is negative a long step goes against g - A, to an amplitude that repels: it is refused.
        forward = jnp.sum(move * change / scale**2, axis=-1) > 0
        good = forward & (size(now - predicted) <= AMPLITUDE.curved * size(change))
        # A speed that has settled stays as it is while others go on.
        taken = good & (size(change) > AMPLITUDE.settled)
        gain = size(change) / jnp.maximum(size(now), 1e-3 * size(change))
        # Steps in time grow as g - A falls (switched evolution relaxation), which makes the last ones Newton's.
        time = jnp.where(good, time * jnp.clip(gain, 2.0, 1000.0), time / 4)
        amplitude, change = (jnp.where(taken[:, None], new, old) for new, old in ((trial, amplitude), (now, change)))
        return amplitude, change, jnp.where(taken[:, None, None], tangent, matrix), time, steps + 1

    state = start, change, matrix, jnp.ones(len(rpm)), 0
    return lax.while_loop(going_on, step, state)[0]


@settled_amplitudes.defjvp
def _settled_jvp(primals, tangents):
    (equations,), (equations_dot,) = primals, tangents
    amplitude = settled_amplitudes(equations)
    _, pushed = jax.jvp(lambda e: _next(e, amplitude), (equations,), (equations_dot,))
    _, matrix = _linearised(equations, amplitude)
    return amplitude, jnp.linalg.solve(matrix, pushed[..., None])[..., 0]
