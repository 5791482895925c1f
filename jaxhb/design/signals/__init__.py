"""Orders from measured signals: pulses of a wheel, angles or speeds over time go in,
and amplitudes and phases by order over the speed come out.
"""
