"""Test the tables of speed on small shapes, with few repetitions of each call."""

import bench.speed.__main__ as speed
from bench.speed import measure, session
from bench.speed.made_input import mirrored_field


def test_every_line_of_the_table_is_measured(monkeypatch):
    together = measure.together

    def short(calls, **_):
        return together(calls, seconds=0.0, least=1)

    monkeypatch.setattr(speed, "together", short)
    rows = list(speed.lines(1_000, 500))
    assert {"bind 10", "bind 100", "pose 1", "pose 100", "drag frame with 100 handles"} <= {row[0] for row in rows}
    assert "bind 1, D = 384, float32, 500 vertices" in {row[0] for row in rows}  # as many vertices as for torch
    assert "pose and gradients of transforms and weights, 2,000 × 10" in {row[0] for row in rows}
    assert all(len(row) == len(speed.COLUMNS) and float(row[1]) > 0 for row in rows)


def test_every_step_of_a_session_has_its_time():
    row = session.steps(1_000, mirrored_field())
    assert row["vertices"] >= 1_000
    assert all(row[step] > 0 for step in session.STEPS)
