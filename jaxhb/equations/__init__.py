"""The equations of a drive train: law of the teeth, Fourier coefficients, dynamic
stiffness, condensed equation, state space. Arrays go in and arrays come out.
"""
