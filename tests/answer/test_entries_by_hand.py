"""Entries of the answer, each against what it states."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.answer.diagnosis import mistake_entry
from pipeline.answer.inputs import registration_entry
from pipeline.answer.words import worst_known
from pipeline.faults.mistake import as_it_is, outlying
from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import changed, dh_parameters, nominal
from pipeline.positions.answer import _chance
from pipeline.positions.table_entries import table_entries


@pytest.mark.parametrize("name", ["kr500_rail", "ur10", "fanuc_r2000ic"])
def test_values_are_those_of_the_robot_that_was_found(name):
    """Nominal plus what each is off by; known where its variance is half that of the prior."""
    robot = load(name)
    every = dh_parameters(robot)
    k = np.arange(len(every))
    off, prior = 1e-4 * (k + 1) * (-1) ** k, 1e-3 * (1 + k)
    found = np.sqrt(np.where(k % 2, 0.4, 0.6)) * prior

    entries = table_entries(robot, off, found**2, 2 * prior, prior)

    true = nominal(changed(robot, every, off), every)
    assert [one.value for one in entries] == pytest.approx(true, abs=1e-12)
    assert [one.nominal for one in entries] == pytest.approx(nominal(robot, every), abs=1e-12)
    assert [(one.name, one.where) for one in entries] == [(x.name, x.joint) for x in every]
    assert [one.std for one in entries] == pytest.approx(found)
    assert [one.prior_std for one in entries] == pytest.approx(2 * prior)
    assert [one.identifiable for one in entries] == (k % 2 == 1).tolist()
    assert all((one.unit == "rad") == (one.name in TURNING) for one in entries)


TURNING = {"joint_offset", "link_twist", "axis_tilt", "link_turn"}


@pytest.mark.parametrize("others", [(), ("kgf",), ("a:3", "a:4")])
@pytest.mark.parametrize("p", [None, 0.0, 0.04])
def test_places_of_which_one_is_wrong_share_what_is_certain(others, p):
    """All are equally likely; together they leave what chance may have done."""
    plain = outlying("12", "row 4 is off", "left out", before=7.0, correct=as_it_is, at=("t:4",))
    one = mistake_entry(replace(plain, instead=others, p_value=p, at=("t:4", "t:9", "t:4")), None)

    each = [one.probability, *(rival.probability for rival in one.rivals)]
    assert len(each) == 1 + len(others)
    assert len(set(each)) == 1
    assert sum(each) == pytest.approx(1 - (p or 0.0))
    assert [rival.where for rival in one.rivals] == list(others)
    assert (one.where, one.readings) == (12, ("t:4", "t:9"))
    assert (one.evidence.sentence, one.evidence.correction) == ("row 4 is off", "left out")
    assert (one.evidence.before, one.evidence.after) == (7.0, 0.0)


def test_what_was_stated_is_contradicted_as_rarely_as_said():
    """Bodies drawn as stated and estimated from readings: any p-value is as frequent as another.

    One coordinate is read well, one hardly, one not at all; units do not matter.
    """
    rng = np.random.default_rng(3)
    std = np.array([2.0, 1e-3, 5e-2])
    X = np.array([[1.0, 200.0, 0.0], [0.3, -90.0, 0.0]]) / 0.4
    cov = np.linalg.inv(X.T @ X + np.diag(1 / std**2))
    p = []
    for _ in range(800):
        x = std * rng.standard_normal(3)
        off = cov @ X.T @ (X @ x + rng.standard_normal(2))
        p.append(_chance(off, std, cov))
        k = np.array([1e3, 1.0, 10.0])
        assert _chance(k * off, k * std, cov * np.outer(k, k)) == pytest.approx(p[-1], rel=1e-6)

    assert np.histogram(p, 4, (0, 1))[0] == pytest.approx([200] * 4, abs=4 * np.sqrt(150))


@pytest.mark.parametrize(
    ("known", "worst"),
    [
        ((0.02, 0.3, 0.1), 1),
        ((0.02, None, 0.1), 2),  # a value without an uncertainty is not the worst
        ((0.02, "lost", 0.3, "lost"), 1),
    ],
)
def test_the_worst_known_stiffness_is_lost_or_the_least_certain(known, worst):
    """One without a value comes before any that has one."""
    each = [
        SimpleNamespace(
            value=None if std == "lost" else 1e6, relative_std=None if std == "lost" else std
        )
        for std in known
    ]

    assert worst_known(each) is each[worst]
    assert worst_known([]) is None


def test_base_residuals_are_of_the_distances_in_millimetres():
    """3, 4 and 0 mm: rms 5 / sqrt(3), the largest 4; p from chi-squared with its degrees."""
    table = pd.DataFrame(
        {"dx_m": [3e-3, 0.0, 0.0], "dy_m": [0.0, 4e-3, 0.0], "dz_m": [0.0, 0.0, 0.0]}
    )
    registration = SimpleNamespace(
        table=table,
        cov=np.diag([1.0, 4.0, 9.0, 16.0, 25.0, 36.0]),
        chi2=4.0,
        dof=2,
        growth=SimpleNamespace(probability=0.0),
    )

    entry = registration_entry(registration)

    assert (entry.rms_mm, entry.max_mm) == pytest.approx((5 / np.sqrt(3), 4.0))
    assert entry.p_value == pytest.approx(np.exp(-2.0))
    assert entry.rotation_std_rad == pytest.approx((1, 2, 3))
    assert entry.translation_std_m == pytest.approx((4, 5, 6))
    assert registration_entry(SimpleNamespace(table=table[:0])) is None
