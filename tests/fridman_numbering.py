"""Fridman's numbering of a tree as a chain with fictitious nodes, to and from the elimination order of the package."""

import numpy as np


def fridman_numbering(parent):
    """The node at each place of Fridman's chain, -1 at a fictitious one, and of these the node that each stands for.

    ``parent`` of every node is larger than the node itself, one more than the last (or 0) for the ground. A fictitious
    place is where the chain jumps over a branch: it shares the displacement of its node and hands its force on to it.

    >>> fridman_numbering([1, 4, 3, 4, 5, 6])
    ([0, 1, -1, 2, 3, 4, 5], {2: 4})
    """
    nodes, image = [], {}
    for node, above in enumerate(parent):
        nodes.append(node)
        if node + 1 < len(parent) and above != node + 1:
            image[len(nodes)] = above
            nodes.append(-1)
    return nodes, image


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
