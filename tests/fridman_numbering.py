"""Fridman's numbering of a tree as a chain with fictitious nodes, to the elimination order of the package."""

import numpy as np


def parents_from_fridman(places, image):
    """Parents of the physical nodes of a chain in Fridman's numbering.

    Parameters
    ----------
    places : int
        Number of places 1 .. ``places`` of the chain, fictitious ones included; the last is grounded.
    image : dict
        Fictitious place -> the place that it stands for (1-based, as the sources write it).

    Returns
    -------
    node : int array ``(S,)``
        Place (1-based) of every physical node, in order of elimination.
    parent : int array ``(S,)``
        Position of the parent; S at the root.

    Examples
    --------
    >>> node, parent = parents_from_fridman(7, {3: 6})
    >>> node.tolist(), parent.tolist()
    ([1, 2, 4, 5, 6, 7], [1, 4, 3, 4, 5, 6])
    """
    physical = [place for place in range(1, places + 1) if place not in image]
    position = {place: s for s, place in enumerate(physical)}
    position[places + 1] = len(physical)
    above = [image.get(place + 1, place + 1) for place in physical]
    return np.array(physical), np.array([position[place] for place in above], dtype=np.int32)
