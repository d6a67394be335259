"""Entries of a robot's table that are off by far more than the rest, in a campaign of positions."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.verdict import verdict
from pipeline.machine.robot import load
from pipeline.positions.estimate import Posterior, Prior
from pipeline.positions.facts import facts_of
from pipeline.positions.mechanism import ArmWeights, Payloads
from pipeline.positions.outstanding import confirmed, outstanding, same_robot
from pipeline.positions.study import study
from tests.positions.test_clean_positions import DOWN, TOOL, campaign

LENGTHS, ANGLES = 11, 9
STD = 2e-5

NO_KNOTS = np.zeros((0, 0))


def table(off, stated=(np.nan, np.nan), alike=()):
    """Entries with errors `off` (20,) that readings determine to `STD`, and the roughness as prior.

    Of two that are `alike` only the sum is read.
    """
    turns = np.arange(LENGTHS + ANGLES) >= LENGTHS
    rough = [np.sqrt(np.mean(off[turns == one] ** 2)) for one in (False, True)]
    std = np.where(turns, rough[1], rough[0])
    D = np.eye(len(off)) / STD
    if alike:
        D[alike[0], alike[1]] = 1 / STD
        D[alike[1]] = 0
    cov = np.linalg.inv(D.T @ D + np.diag(std**-2))
    known = Prior(0 * std, std, turns, np.zeros(len(off), dtype=bool), std, (), stated)
    return known, Posterior(cov @ D.T @ D @ off, np.linalg.cholesky(cov), NO_KNOTS, 0.0)


def delivered(rng, size=3e-4):
    """Errors of a table as delivered."""
    return rng.normal(0, size, LENGTHS + ANGLES)


@pytest.mark.parametrize("wrong", [{2: 4e-3}, {2: -4e-3, 7: 6e-3}, {14: 0.01}, {1: 0.05, 15: 5e-3}])
def test_a_wrong_entry_does_not_hide_itself_in_the_roughness_of_the_table(wrong):
    """It is far beyond the others, though the rms of all is as large as a third of it."""
    off = delivered(np.random.default_rng(0))
    for at, error in wrong.items():
        off[at] = error

    assert np.flatnonzero(outstanding(*table(off))).tolist() == sorted(wrong)


@pytest.mark.parametrize("size", [1e-6, 3e-4, 1e-3, 3e-3])
def test_no_entry_of_a_table_that_is_rough_everywhere_is_outstanding(size):
    """However rough: its entries are compared with each other."""
    rng = np.random.default_rng(1)

    assert not any(outstanding(*table(delivered(rng, size))).any() for _ in range(8))


def test_a_table_is_compared_with_the_roughness_that_its_file_states():
    """Four millimetres are usual where the file states two."""
    off = delivered(np.random.default_rng(0))
    off[2] = 4e-3

    assert outstanding(*table(off)).any()
    assert not outstanding(*table(off, (2e-3, 2e-3))).any()


def test_the_place_of_an_error_that_two_entries_share_stays_open():
    """Offsets along parallel axes: one is named, the other gives the same robot."""
    off = delivered(np.random.default_rng(0))
    off[4] = 4e-3
    known, found = table(off, alike=(4, 5))
    (one,) = np.flatnonzero(outstanding(known, found))

    assert {int(one), *same_robot(known, found, int(one))} == {4, 5}
    assert same_robot(known, found, 2) == ()


@pytest.mark.parametrize("error", [4e-3, 1.6e-4])
def test_an_entry_that_was_freed_is_named_only_if_the_end_confirms_it(error):
    """A link was freed, and a wave of the joint beside it took the error afterwards."""
    off = delivered(np.random.default_rng(0))
    off[2] = error
    known, found = table(off)
    free = np.arange(len(off)) == 2
    known = replace(known, free=free, std=np.where(free, 1e-2, known.std))

    assert np.flatnonzero(confirmed(known, found)).tolist() == ([2] if error > 1e-3 else [])


def test_an_entry_that_the_readings_hardly_see_is_not_named():
    """The last offset beside a free tool: seen to 5 mm, and its prior keeps it at 0.2 +- 0.4."""
    off = delivered(np.random.default_rng(0))
    off[2] = 0.03
    free = np.arange(len(off)) == 2
    known, _ = table(delivered(np.random.default_rng(0)))
    known = replace(known, free=free, std=np.where(free, 4e-4, known.std))
    seen = np.diag(np.where(free, 5e-3, STD) ** -2.0)
    cov = np.linalg.inv(seen + np.diag(known.std**-2))
    found = Posterior(cov @ seen @ off, np.linalg.cholesky(cov), NO_KNOTS, 0.0)

    assert outstanding(known, found)[2]  # beside such a wide prior as suspects have
    assert not confirmed(known, found).any()


@pytest.mark.whole
def test_a_length_of_the_table_that_is_4_mm_wrong_is_named(tmp_path):
    """With the value that fits; the rest of the table keeps its own roughness."""
    robot, readings = campaign(0, "khalil", True, "even", tmp_path)
    path = tmp_path / "own.toml"
    said = tomllib.loads(path.read_text("utf-8"))["joint"][2]["d_m"]
    path.write_text(path.read_text("utf-8").replace(f"d_m = {said}", f"d_m = {said + 4e-3}"))
    none = Payloads((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)))
    weights = ArmWeights(DOWN, none, np.zeros(len(readings), dtype=np.int64))
    tool = {f"P{k}": point for k, point in enumerate(TOOL, 1)}
    rough = (np.nan, np.nan)

    found = study(load(str(path)), readings, weights, tool, 2e-5, rough, np.random.default_rng(0))
    facts = facts_of(found, robot)
    (cause,) = facts.moved
    (size,) = cause.amplitudes

    assert (cause.effect.name, cause.effect.where) == ("link_length", 3)
    assert size.value == pytest.approx(-4e-3, abs=1e-3)  # the arm's own length is off, too
    assert found.final.known.roughness(turns=False) < 6e-4
    assert verdict(facts) is Verdict.EXPLAINED
