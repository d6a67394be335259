"""Scatter from day to day, as two campaigns are compared with it."""

from types import SimpleNamespace

import pytest

from pipeline.fleet import compare


def test_a_scatter_of_two_percent_is_a_fiftieth(monkeypatch, tmp_path):
    """The page over all campaigns has percent, the test of a difference fractions."""
    joint = SimpleNamespace(name="k_theta2", scatter=2.0)
    wear = SimpleNamespace(followed=True, joints=(joint,))
    monkeypatch.setattr(compare.fleet, "wear", lambda _: None)
    monkeypatch.setattr(compare, "of", lambda *_: wear)
    monkeypatch.setattr(compare, "of_one_day", lambda *_: False)
    side = SimpleNamespace(answer=SimpleNamespace(machine="kr500 4711"))

    assert compare._from_day_to_day(tmp_path, side, side) == pytest.approx({"k_theta2": 0.02})
