"""Test the cache of recent results."""

from dfd.common.kept import Recent


def test_the_results_used_last_are_kept():
    recent, asked = Recent[int](2), []

    def result(key):
        return recent.get(key, lambda: asked.append(key) or 10 * key)

    assert [result(key) for key in (1, 2, 1, 1, 3, 1, 2)] == [10, 20, 10, 10, 30, 10, 20]
    assert asked == [1, 2, 3, 2]  # 3 replaced 2, which was not used last
