"""Excitation by cylinders: their tangential pressures by order, the vector sums of
their firing, and what each adds to an order of a forced response.
"""
