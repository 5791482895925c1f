"""Tolerances of numbers: one table for all tests.

Every entry is relative to the size of what is compared unless it says otherwise.
"""

ALGEBRAIC = 1e-12
"""Two ways to write the same algebra in float64: some thousand roundings of 1e-16,
moderate condition numbers.
"""

RESIDUAL = 1e-10
"""The residual at which Newton's method stops (``Plan.residual_tolerance``)."""

PATHS = 1e-9
"""Two linear-algebra paths to one solution: the stopping residual times the condition
of the equations.
"""

GRADIENT = 1e-6
"""A derivative against central differences: cube root of the rounding unit, squared,
with a margin.
"""

TANGENT = 1e-11
"""jvp against vjp, or a derivative by autodiff against one written out by hand through
a solve.
"""


def half_unit(printed):
    """Half a unit of the last digit of a number as it was printed, ``"3247.2"`` ->
    0.05: absolute.
    """
    decimals = len(str(printed).partition(".")[2])
    return 0.5 * 10.0**-decimals
