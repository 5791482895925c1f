"""Excitation of the train: pressure in the cylinders, gas and inertia torques. Tables
of numbers and a speed go in, harmonics of the torque of each come out.
"""
