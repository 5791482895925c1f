"""Characteristic polynomial of a uniform chain of 100 links over the frequency: how many digits each way keeps.

    python benchmarks/polynomial_digits.py                     a table, seconds
    python benchmarks/polynomial_digits.py --plot digits.png

Three ways beside a recursion in 50 digits at the same frequencies: coefficients in double precision (docs/theory C5),
the continuant recursion in double precision, and ``jaxhb.characteristic``. Free chain of equal disks and shafts,
natural frequencies up to 2 rad/s; 2000 frequencies, and frequencies 1e-4, 1e-8 and 1e-12 (relative) beside each root.
"""

import argparse
from decimal import Decimal, localcontext

import numpy as np

import jaxhb

LINKS, DIGITS = 100, 50
HIGHEST, POINTS = 2.2, 2000
BESIDE = 1e-4, 1e-8, 1e-12
WAYS = {"coefficients": ":", "recursion in double precision": "--", "jaxhb.characteristic": "-"}


def roots(links=LINKS):
    """Natural frequencies ``(links,)`` in rad/s but the zero, closed form."""
    return 2 * np.sin(np.arange(1, links + 1) * np.pi / (2 * links + 2))


def continuant(x, one, links=LINKS):
    """det(p^2 + K) of the free chain at ``x = p^2``, in the numbers of ``one``."""
    value, last = x + one, one
    for s in range(1, links + 1):
        value, last = (x + one * (1 if s == links else 2)) * value - last, value
    return value


def exact(omega, links=LINKS):
    """Values ``(n,)`` in 50 digits at the rounded frequencies."""
    with localcontext() as context:
        context.prec = DIGITS
        return [continuant(-(Decimal(w) ** 2), Decimal(1), links) for w in omega.tolist()]


def by_coefficients(omega, links=LINKS):
    """Values ``(n,)`` by Horner's rule from coefficients in double precision."""
    end, inner = np.array([1.0, 1.0]), np.array([1.0, 2.0])
    value, last = end, np.array([1.0])
    for s in range(1, links + 1):
        value, last = np.polysub(np.convolve(end if s == links else inner, value), last), value
    return np.polyval(value, -(omega**2))


def by_characteristic(omega, links=LINKS):
    """Values ``(n,)`` of jaxhb."""
    names = [str(i) for i in range(links + 1)]
    parts = [jaxhb.Disk(name=name, inertia=1.0) for name in names]
    parts += [jaxhb.Shaft(between=pair, stiffness=1.0) for pair in zip(names, names[1:], strict=False)]
    return np.asarray(jaxhb.characteristic(jaxhb.build(parts), 1j * omega).value().real)


def errors(omega, links=LINKS):
    """Relative errors ``(n,)`` of each way, by its name."""
    true = exact(omega, links)
    values = by_coefficients(omega, links), continuant(-(omega**2), 1.0, links), by_characteristic(omega, links)
    with localcontext() as context:
        context.prec = DIGITS
        return {
            name: np.array([float(abs(Decimal(v) / t - 1)) for v, t in zip(value.tolist(), true, strict=True)])
            for name, value in zip(WAYS, values, strict=True)
        }


def plot_digits(omega, found, axes):
    """Draw the relative errors over the frequency."""
    shown = sorted(WAYS, key=lambda name: -np.median(found[name]))
    for name, grey in zip(shown, ("0.6", "0.35", "0.0"), strict=True):
        label = f"{name}, largest {found[name].max():.0e}"
        axes.semilogy(omega, np.maximum(found[name], 1e-17), WAYS[name], color=grey, linewidth=1.0, label=label)
    axes.axhline(1e-12, color="black", linewidth=0.6)
    axes.set(xlabel="frequency, rad/s (uniform chain of 100 links, natural frequencies up to 2)", xlim=(0, HIGHEST))
    axes.set(ylabel="relative error of the polynomial", ylim=(1e-18, 1e4))
    axes.legend(fontsize="small", loc="center right", bbox_to_anchor=(1.0, 0.62))


def main():
    """Print the largest errors, draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plot", help="file of the figure")
    options = parser.parse_args()
    omega = HIGHEST * np.arange(1, POINTS + 1) / POINTS
    over = errors(omega)
    sets = {"over the frequency": over} | {f"{d:g} beside roots": errors(roots() * (1 + d)) for d in BESIDE}
    print(f"{'':18s}" + "".join(f"{name:>32s}" for name in WAYS))
    for where, found in sets.items():
        print(f"{where:18s}" + "".join(f"{found[name].max():32.1e}" for name in WAYS))
    share = 100 * np.mean(over["recursion in double precision"] <= 1e-12)
    print(f"recursion in double precision: {share:.1f} % of the values over the frequency to 1e-12")
    if options.plot:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.0, 4.0), layout="constrained")
        plot_digits(omega, over, figure.subplots())
        figure.savefig(options.plot, dpi=110)


if __name__ == "__main__":
    main()
