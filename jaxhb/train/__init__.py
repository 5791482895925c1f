"""The drive train: arrays of numbers over a fixed topology.

:mod:`jaxhb.train.assembly` checks elements together and builds a train, which reads and
changes its numbers by name, lays its links out as a tree and sums the torques on its
disks.
"""
