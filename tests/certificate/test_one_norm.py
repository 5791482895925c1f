"""The estimate of a 1-norm against sums of columns."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from jaxhb.certificate.linearization import one_norm


def maps(sizes):
    """Square matrices with columns of different sizes."""
    draw = np.random.default_rng(3)
    for size in sizes:
        yield draw.normal(size=(size, size)) * np.exp(
            draw.uniform(0, 2) * draw.normal(size=size)
        )


def estimated(matrix):
    return one_norm(lambda v: matrix @ v, lambda v: matrix.T @ v, len(matrix), 3)


def test_the_estimate_is_never_above_the_norm_and_seldom_below():
    shares = [
        estimated(m) / np.abs(m).sum(0).max()
        for m in maps([1, 6, 7, 8, 9, 12, *range(20, 120)])
    ]
    assert max(shares) < 1 + 1e-12  # rounding
    assert shares[:2] == [1.0, 1.0]  # of small matrices the sum itself
    assert np.mean(np.array(shares) > 1 - 1e-12) > 0.8
    assert np.mean(shares) > 0.98
    assert estimated(np.diag(np.r_[np.ones(9), np.nan])) == np.inf


def test_the_generator_of_the_process_is_left_alone_and_threads_find_the_same():
    state = np.random.get_state()[1].tolist()
    (matrix,) = maps([200])
    with ThreadPoolExecutor(4) as threads:
        assert len(set(threads.map(estimated, [matrix] * 20))) == 1
    assert np.random.get_state()[1].tolist() == state
