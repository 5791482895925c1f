"""The drive train: arrays of numbers over a fixed topology. Elements go in, checked
together; a train comes out, which reads and changes its numbers by name and lays its
links out as a tree.
"""
