"""Test the cache of the results of steps."""

from dfd.common.kept import Kept


def test_the_results_used_last_are_kept():
    kept, asked = Kept(2, other=1), []

    def result(key, step="one"):
        return kept.get(step, key, lambda: asked.append(key) or 10 * key)

    assert [result(key) for key in (1, 2, 1, 1, 3, 1, 2)] == [10, 20, 10, 10, 30, 10, 20]
    assert asked == [1, 2, 3, 2]  # 3 replaced 2, which was not used last
    assert [result(key, "other") for key in (1, 2, 1, 1)] == [10, 20, 10, 10]
    assert asked == [1, 2, 3, 2, 1, 2, 1]
