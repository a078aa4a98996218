"""Test how places are divided into patches."""

import numpy as np
from scipy.sparse import csr_array

from dfd.segmentation.patches import _nearest_seed


def test_a_place_belongs_to_the_seed_that_is_nearest_along_the_surface():
    """The places 0 to 5 form a U, whose ends are near each other. There is no path to place 6."""
    center = np.array([(0, 3, 0), (0, 1, 0), (0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 3, 0), (0, 5, 0)], float)
    one = np.arange(5)
    lengths = np.linalg.norm(center[one] - center[one + 1], axis=1)
    graph = csr_array((lengths, (one, one + 1)), shape=(7, 7))
    np.testing.assert_array_equal(_nearest_seed(graph + graph.T, np.array([2, 0]), center), [1, 0, 0, 0, 0, 0, 1])
