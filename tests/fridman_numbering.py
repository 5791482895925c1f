"""Fridman's numbering of a tree as a chain with fictitious nodes, to the elimination order of the package."""

import numpy as np


def parents_from_fridman(places, image):
    """Place of every physical node ``(S,)`` in order of elimination, and position of its parent, S at the root.

    Places and the image of fictitious ones count from 1, as the sources have them.

    >>> node, parent = parents_from_fridman(7, {3: 6})
    >>> node.tolist(), parent.tolist()
    ([1, 2, 4, 5, 6, 7], [1, 4, 3, 4, 5, 6])
    """
    physical = [place for place in range(1, places + 1) if place not in image]
    position = {place: s for s, place in enumerate([*physical, places + 1])}
    above = [image.get(place + 1, place + 1) for place in physical]
    return np.array(physical), np.array([position[place] for place in above], dtype=np.int32)
