"""Compiled time integrators of a drive train, as a user would write them: O(S) per step
through the links.

The train is a :class:`tasks.Task`; its excitation comes as a table over one cycle that
is made beforehand, and only the steps are timed. Mesh law and damping are those of
:mod:`jaxhb.equations.backlash`.

- :func:`runge_kutta`: the classical explicit method of fourth order; stable below ``dt
  omega_max = 2.7``.
- :func:`implicit_tree`: generalized-alpha (Chung and Hulbert 1993; ``rho = 1`` is the
  trapezoidal rule in its midpoint form), second order. The linear train with all teeth
  in contact is factorised once along the tree; a step is one solve with the factor,
  then Newton's method for the deflections of the meshes alone.
- :func:`runge_kutta_links`: the classical method once more, for trains of any form.
"""

import numpy as np
from numba import njit
from tasks import links

RELAXED = {"contract"}
"""Fused multiply-add; overflow stays visible as inf and nan."""

RHO = 1.0
"""Spectral radius of generalized-alpha at infinite frequency."""


@njit(fastmath=RELAXED, error_model="numpy", inline="always")
def _mesh(m, g, l, rate):
    """Force N of mesh g and its slopes with respect to l and l'."""
    distance = abs(l)
    width = m.width[g]
    u = min(max(distance - m.low[g], 0.0), width)
    beyond = max(distance - m.low[g] - width, 0.0)
    drop = m.mesh_k[g] - m.soft[g]
    contact = drop * (u * u / (2 * width) + beyond)
    share = u / width if m.gated[g] else 1.0
    force = (
        m.soft[g] * l + (contact if l > 0 else -contact) + m.mesh_r[g] * rate * share
    )
    slope = m.soft[g] + drop * u / width
    if m.gated[g] and 0.0 < u < width:
        slope += (1.0 if l > 0 else -1.0) * m.mesh_r[g] * rate / width
    return force, slope, m.mesh_r[g] * share


@njit(fastmath=RELAXED, error_model="numpy", inline="always")
def _linear(m, x, v, link, out):
    """Forces N of shafts, damping and ground; ``link`` is work space."""
    size = x.size
    for s in range(size - 1):
        link[s] = m.chain_k[s] * (x[s] - x[s + 1]) + m.chain_r[s] * (v[s] - v[s + 1])
    out[0] = -m.damping[0] * v[0] - m.ground[0] * x[0] - link[0]
    for s in range(size - 2):
        out[s + 1] = (
            link[s]
            - link[s + 1]
            - m.damping[s + 1] * v[s + 1]
            - m.ground[s + 1] * x[s + 1]
        )
    out[size - 1] = (
        link[size - 2]
        - m.damping[size - 1] * v[size - 1]
        - m.ground[size - 1] * x[size - 1]
    )
    for k in range(m.shaft_k.size):
        a = m.shaft_a[k]
        b = m.shaft_b[k]
        force = m.shaft_k[k] * (x[a] - x[b]) + m.shaft_r[k] * (v[a] - v[b])
        out[a] -= force
        out[b] += force


@njit(fastmath=RELAXED, error_model="numpy", inline="always")
def _acceleration(m, inverse, x, v, table, row, link, out):
    """M^-1 (q - B x' - K x - mesh forces), m/s2, with the excitation in a row of the
    table.
    """
    _linear(m, x, v, link, out)
    for e in range(m.pushed.size):
        out[m.pushed[e]] += table[row, e]
    for g in range(m.mesh_k.size):
        a = m.mesh_a[g]
        b = m.mesh_b[g]
        arm_a = m.arm_a[g]
        arm_b = m.arm_b[g]
        force, _, _ = _mesh(
            m, g, arm_a * x[a] - arm_b * x[b], arm_a * v[a] - arm_b * v[b]
        )
        out[a] -= arm_a * force
        out[b] += arm_b * force
    for s in range(x.size):
        out[s] *= inverse[s]


@njit
def accelerate(m, x, v, table, out):
    """Accelerations ``out`` ``(S,)`` m/s2 with the excitation in the first row of
    ``table``.
    """
    _acceleration(m, 1 / m.mass, x, v, table, 0, np.empty_like(x), out)


@njit(fastmath=RELAXED, error_model="numpy", inline="always")
def _observe(m, x, v, deflection, rate, j):
    for g in range(m.mesh_k.size):
        a = m.mesh_a[g]
        b = m.mesh_b[g]
        deflection[g, j] = m.arm_a[g] * x[a] - m.arm_b[g] * x[b]
        rate[g, j] = m.arm_a[g] * v[a] - m.arm_b[g] * v[b]


@njit(fastmath=RELAXED, error_model="numpy")
def runge_kutta(m, x, v, table, dt, deflection, rate):
    """Advance ``x``, ``v`` in place; deflections and rates ``(M, steps)`` at the
    beginning of each step.

    ``table`` ``(2 steps_per_cycle, E)`` N holds the excitation at half steps;
    ``deflection.shape[1]`` steps are taken.
    """
    size = x.size
    rows = table.shape[0]
    inverse = 1 / m.mass
    a1 = np.empty(size)
    a2 = np.empty(size)
    a3 = np.empty(size)
    a4 = np.empty(size)
    y = np.empty(size)
    w = np.empty(size)
    link = np.empty(size)
    half = dt / 2
    for j in range(deflection.shape[1]):
        _observe(m, x, v, deflection, rate, j)
        first = 2 * j % rows
        last = first + 2 if first + 2 < rows else 0
        _acceleration(m, inverse, x, v, table, first, link, a1)
        for s in range(size):
            y[s] = x[s] + half * v[s]
            w[s] = v[s] + half * a1[s]
        _acceleration(m, inverse, y, w, table, first + 1, link, a2)
        for s in range(size):
            y[s] = x[s] + half * w[s]
            w[s] = v[s] + half * a2[s]
        _acceleration(m, inverse, y, w, table, first + 1, link, a3)
        for s in range(size):
            y[s] = x[s] + dt * w[s]
            w[s] = v[s] + dt * a3[s]
        _acceleration(m, inverse, y, w, table, last, link, a4)
        for s in range(size):
            x[s] += dt * v[s] + dt * dt / 6 * (a1[s] + a2[s] + a3[s])
            v[s] += dt / 6 * (a1[s] + 2 * (a2[s] + a3[s]) + a4[s])


@njit(fastmath=RELAXED, error_model="numpy")
def _factorise(parent, coupling, diagonal):
    """Factor of a symmetric tree matrix, leaves first: multipliers ``(S,)`` and inverse
    pivots ``(S,)``.
    """
    weight = np.zeros(parent.size)
    inverse = np.empty(parent.size)
    for s in range(parent.size):
        inverse[s] = 1 / diagonal[s]
        if parent[s] < parent.size:
            weight[s] = coupling[s] * inverse[s]
            diagonal[parent[s]] -= coupling[s] * weight[s]
    return weight, inverse


@njit(fastmath=RELAXED, error_model="numpy")
def _solve(parent, weight, inverse, right):
    """Solve with the factor of a tree, in place; runs of the tree are carried in a
    register.
    """
    last = parent.size - 1
    carried = 0.0
    for s in range(last):
        value = right[s] - carried
        right[s] = value
        carried = weight[s] * value
        if parent[s] != s + 1:
            right[parent[s]] -= carried
            carried = 0.0
    value = (right[last] - carried) * inverse[last]
    right[last] = value
    for k in range(last):
        s = last - 1 - k
        if parent[s] != s + 1:
            value = right[parent[s]]
        value = right[s] * inverse[s] - weight[s] * value
        right[s] = value


@njit(fastmath=RELAXED, error_model="numpy")
def _gauss(matrix, right):
    """Solve a small dense system in place, with pivoting."""
    n = right.size
    for i in range(n):
        p = i + np.argmax(np.abs(matrix[i:, i]))
        if p != i:
            for j in range(n):
                matrix[i, j], matrix[p, j] = matrix[p, j], matrix[i, j]
            right[i], right[p] = right[p], right[i]
        for k in range(i + 1, n):
            ratio = matrix[k, i] / matrix[i, i]
            for j in range(i, n):
                matrix[k, j] -= ratio * matrix[i, j]
            right[k] -= ratio * right[i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]


@njit(fastmath=RELAXED, error_model="numpy")
def _excess(m, compliance, cx, cv, free_l, free_v, l, phi, matrix, change):
    """Excess forces phi of the meshes: ``l = l_free - cx H phi(l, l')`` by Newton's
    method; steps taken.
    """
    count = l.size
    for step in range(25):
        for g in range(count):
            rate = free_v[g] + cv / cx * (l[g] - free_l[g])
            force, slope, rate_slope = _mesh(m, g, l[g], rate)
            phi[g] = force - m.mesh_k[g] * l[g] - m.mesh_r[g] * rate
            tangent = slope - m.mesh_k[g] + (rate_slope - m.mesh_r[g]) * cv / cx
            for i in range(count):
                matrix[i, g] = cx * compliance[i, g] * tangent
        worst = 0.0
        for i in range(count):
            change[i] = free_l[i] - l[i]
            matrix[i, i] += 1.0
            for g in range(count):
                change[i] -= cx * compliance[i, g] * phi[g]
            worst = max(worst, abs(change[i]) / m.width[i])
        if worst < 1e-9:
            return step
        _gauss(matrix, change)
        for i in range(count):
            l[i] += change[i]
    return 25


@njit(fastmath=RELAXED, error_model="numpy")
def implicit_tree(m, scheme, factor, x, v, a, table, dt, deflection, rate):
    """Advance ``x``, ``v``, ``a`` in place by generalized-alpha; deflections and rates
    as in :func:`runge_kutta`.

    ``scheme`` (alpha_m, alpha_f, beta, gamma); ``factor`` from :func:`tree_factor`;
    ``table`` ``(steps_per_cycle, E)`` N holds the excitation at ``t_j + (1 - alpha_f)
    dt``.
    """
    alpha_m, alpha_f, beta, gamma = scheme
    parent, weight, inverse, columns, compliance = factor
    count = m.mesh_k.size
    size = x.size
    rows = table.shape[0]
    cx = (1 - alpha_f) * beta * dt * dt
    cv = (1 - alpha_f) * gamma * dt
    y = np.empty(size)
    w = np.empty(size)
    r = np.empty(size)
    link = np.empty(size)
    free_l = np.zeros(count)
    free_v = np.zeros(count)
    l = np.zeros(count)
    phi = np.zeros(count)
    matrix = np.empty((count, count))
    change = np.empty(count)
    for j in range(deflection.shape[1]):
        _observe(m, x, v, deflection, rate, j)
        row = j % rows
        for s in range(size):
            y[s] = x[s] + (1 - alpha_f) * (dt * v[s] + dt * dt * (0.5 - beta) * a[s])
            w[s] = v[s] + (1 - alpha_f) * dt * (1 - gamma) * a[s]
        _linear(m, y, w, link, r)
        for s in range(size):
            r[s] -= alpha_m * m.mass[s] * a[s]
        for e in range(m.pushed.size):
            r[m.pushed[e]] += table[row, e]
        for g in range(count):
            p = m.mesh_a[g]
            q = m.mesh_b[g]
            arm_p = m.arm_a[g]
            arm_q = m.arm_b[g]
            force = m.mesh_k[g] * (arm_p * y[p] - arm_q * y[q]) + m.mesh_r[g] * (
                arm_p * w[p] - arm_q * w[q]
            )
            r[p] -= arm_p * force
            r[q] += arm_q * force
        _solve(parent, weight, inverse, r)
        for g in range(count):
            p = m.mesh_a[g]
            q = m.mesh_b[g]
            arm_p = m.arm_a[g]
            arm_q = m.arm_b[g]
            free_l[g] = arm_p * (y[p] + cx * r[p]) - arm_q * (y[q] + cx * r[q])
            free_v[g] = arm_p * (w[p] + cv * r[p]) - arm_q * (w[q] + cv * r[q])
        for g in range(count):
            l[g] = free_l[g]
            for i in range(count):
                l[g] -= cx * compliance[g, i] * phi[i]
        _excess(m, compliance, cx, cv, free_l, free_v, l, phi, matrix, change)
        for g in range(count):
            for s in range(size):
                r[s] -= columns[g, s] * phi[g]
        for s in range(size):
            x[s] += dt * v[s] + dt * dt * ((0.5 - beta) * a[s] + beta * r[s])
            v[s] += dt * ((1 - gamma) * a[s] + gamma * r[s])
            a[s] = r[s]


def scheme_of(rho):
    """Generalized-alpha (alpha_m, alpha_f, beta, gamma) with spectral radius ``rho`` at
    infinite frequency.
    """
    alpha_m = (2 * rho - 1) / (rho + 1)
    alpha_f = rho / (rho + 1)
    return alpha_m, alpha_f, (1 - alpha_m + alpha_f) ** 2 / 4, 0.5 - alpha_m + alpha_f


def tree_factor(task, dt, scheme):
    """Factor of ``(1 - alpha_m) M + (1 - alpha_f)(gamma dt B + beta dt^2 K)`` and its
    answers to the mesh forces.
    """
    m = task.model
    (alpha_m, alpha_f, beta, gamma) = scheme
    cx = (1 - alpha_f) * beta * dt**2
    cv = (1 - alpha_f) * gamma * dt
    a, b, arm_a, arm_b, stiffness, damping = links(m)
    stiff = cx * stiffness + cv * damping
    diagonal = (1 - alpha_m) * m.mass + cv * m.damping + cx * m.ground
    np.add.at(diagonal, a, stiff * arm_a**2)
    np.add.at(diagonal, b, stiff * arm_b**2)
    coupling = np.zeros(m.mass.size)
    np.subtract.at(coupling, np.minimum(a, b), stiff * arm_a * arm_b)
    weight, inverse = _factorise(task.parent, coupling, diagonal)
    columns = np.zeros((m.mesh_k.size, m.mass.size))
    for g in range(m.mesh_k.size):
        columns[g, m.mesh_a[g]] += m.arm_a[g]
        columns[g, m.mesh_b[g]] -= m.arm_b[g]
        _solve(task.parent, weight, inverse, columns[g])
    compliance = (
        m.arm_a[:, None] * columns[:, m.mesh_a].T
        - m.arm_b[:, None] * columns[:, m.mesh_b].T
    )
    return task.parent, weight, inverse, columns, np.ascontiguousarray(compliance)


def stepping(task, method, steps, rho=RHO):
    """A function that advances one cycle (deflection and rate arrays in), and the state
    (x, v) that it moves.
    """
    x, v = task.displacement.copy(), task.velocity.copy()
    dt, m = task.period / steps, task.model
    if method == "rk4":
        table = task.table(2 * steps)
        return lambda deflection, rate: runge_kutta(
            m, x, v, table, dt, deflection, rate
        ), (x, v)
    scheme = scheme_of(rho)
    factor, table = tree_factor(task, dt, scheme), task.table(steps, 1 - scheme[1])
    a = np.empty_like(x)
    accelerate(m, x, v, task.table(2), a)
    return lambda deflection, rate: implicit_tree(
        m, scheme, factor, x, v, a, table, dt, deflection, rate
    ), (x, v)


@njit(error_model="numpy")
def _accelerate_links(x, v, load, out, disk, link, mesh):
    """Accelerations of the disks; ``disk``: damping, ground, inverse mass; ``link``:
    ends, arms, stiffness, damping; ``mesh``: of each link, its law, or a backlash of -1
    where it is linear.
    """
    damping, ground, inverse = disk
    for s in range(x.size):
        out[s] = load[s] - damping[s] * v[s] - ground[s] * x[s]
    for k in range(link.shape[1]):
        a = int(link[0, k])
        b = int(link[1, k])
        l = link[2, k] * x[a] - link[3, k] * x[b]
        rate = link[2, k] * v[a] - link[3, k] * v[b]
        force = _link_force(
            l,
            rate,
            link[4, k],
            link[5, k],
            mesh[0, k],
            mesh[1, k],
            mesh[2, k],
            mesh[3, k],
        )
        out[a] -= link[2, k] * force
        out[b] += link[3, k] * force
    for s in range(x.size):
        out[s] *= inverse[s]


@njit(error_model="numpy")
def _link_force(l, rate, stiffness, damping, backlash, epsilon, transition, gated):
    """Law (18) and damping of a mesh, or a linear link where ``backlash`` is negative;
    N.
    """
    if backlash < 0:
        return stiffness * l + damping * rate
    width = transition * backlash
    beyond = abs(l) - (1 - transition) * backlash / 2
    u = min(max(beyond, 0.0), width)
    w = max(beyond - width, 0.0)
    contact = (1 - epsilon) * stiffness * (u * u / (2 * width) + w)
    share = u / width if gated else 1.0
    return (
        epsilon * stiffness * l
        + (contact if l > 0 else -contact)
        + damping * rate * share
    )


@njit(error_model="numpy")
def runge_kutta_links(x, v, loads, dt, cycles, disk, link, mesh, kept):
    """Classical Runge-Kutta through the links of any train, ``cycles`` on, in place.

    Returns deflections at ``kept`` instants ``(cycles, kept, L)`` and the largest and
    smallest force of each link ``(cycles, 2, L)``; ``loads`` ``(2 steps, S)`` at half
    steps, the others as in :func:`_accelerate_links`.
    """
    steps = loads.shape[0] // 2
    links = link.shape[1]
    seen = np.zeros((cycles, kept, links))
    extremes = np.zeros((cycles, 2, links))
    a1 = np.empty_like(x)
    a2 = np.empty_like(x)
    a3 = np.empty_like(x)
    a4 = np.empty_like(x)
    extremes[:, 0], extremes[:, 1] = -np.inf, np.inf
    for c in range(cycles):
        for j in range(steps):
            for k in range(links):
                a = int(link[0, k])
                b = int(link[1, k])
                l = link[2, k] * x[a] - link[3, k] * x[b]
                rate = link[2, k] * v[a] - link[3, k] * v[b]
                f = _link_force(
                    l,
                    rate,
                    link[4, k],
                    link[5, k],
                    mesh[0, k],
                    mesh[1, k],
                    mesh[2, k],
                    mesh[3, k],
                )
                extremes[c, 0, k] = max(extremes[c, 0, k], f)
                extremes[c, 1, k] = min(extremes[c, 1, k], f)
                if (j * kept) % steps < kept:
                    seen[c, j * kept // steps, k] = l
            last = loads[2 * j + 2] if j + 1 < steps else loads[0]
            _accelerate_links(x, v, loads[2 * j], a1, disk, link, mesh)
            _accelerate_links(
                x + dt / 2 * v, v + dt / 2 * a1, loads[2 * j + 1], a2, disk, link, mesh
            )
            _accelerate_links(
                x + dt / 2 * v + dt * dt / 4 * a1,
                v + dt / 2 * a2,
                loads[2 * j + 1],
                a3,
                disk,
                link,
                mesh,
            )
            _accelerate_links(
                x + dt * v + dt * dt / 2 * a2, v + dt * a3, last, a4, disk, link, mesh
            )
            x += dt * v + dt * dt / 6 * (a1 + a2 + a3)
            v += dt / 6 * (a1 + 2 * (a2 + a3) + a4)
    return seen, extremes
