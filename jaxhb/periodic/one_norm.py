"""The 1-norm of a map that is known by its products alone; of its transpose, the largest absolute row sum."""

import numpy as np


def one_norm(product, transposed, size, columns, steps=5):
    """Lower bound of the largest absolute column sum of a square map, seldom far below it; inf where it is not finite.

    Algorithm 2.4 of Higham & Tisseur, SIAM J. Matrix Anal. Appl. 21 (2000) 1185, with random signs of its own: that of
    scipy draws from the generator of the whole process.

    Parameters
    ----------
    product, transposed : functions of a vector ``(size,)``, with the map and its transpose
    columns : int, vectors at a time
    steps : int, at most
    """

    def each(function, vectors):
        return np.stack([function(vector) for vector in vectors])

    if size <= 2 * columns:
        return float(np.abs(each(product, np.eye(size))).sum(1).max())
    draw = np.random.default_rng(0)
    vectors = np.concatenate([np.ones((1, size)), draw.choice([-1.0, 1.0], (columns - 1, size))]) / size
    largest, signs, visited = 0.0, np.empty((0, size)), np.empty(0, int)
    for _ in range(steps):
        images = each(product, vectors)
        found = np.abs(images).sum(1).max()
        if not np.isfinite(found):
            return np.inf
        if found <= largest:
            break
        largest, before, signs = found, signs, np.where(images >= 0, 1.0, -1.0)
        if len(before) and (np.abs(signs @ before.T) == size).any(1).all():
            break  # all the same as in the last step
        for i in range(len(signs)):
            while (np.abs(np.concatenate([signs[:i], before]) @ signs[i]) == size).any():
                signs[i] = draw.choice([-1.0, 1.0], size)
        promising = np.argsort(-np.abs(each(transposed, signs)).max(0))
        if np.isin(promising[:columns], visited).all():
            break
        chosen = promising[~np.isin(promising, visited)][:columns]
        visited = np.concatenate([visited, chosen])
        vectors = np.zeros((len(chosen), size))
        vectors[np.arange(len(chosen)), chosen] = 1.0
    return float(largest)
