"""The next pull: what it promises is what least squares would find with it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline import campaign
from pipeline.cell import paper_cell, predict
from pipeline.diagnosis.nextpose import Candidates, candidates, propose
from pipeline.run import reduce, tool
from pipeline.screening.case import conformed
from pipeline.simulate import simulate
from pipeline.simulate.plan import Plan
from pipeline.stages.diagnose import case_of
from pipeline.stages.estimate import identify

STEP = 1e-3
"""Of a typical size, for differences."""


@pytest.fixture(scope="module")
def asked():
    """A campaign of few poses with a tilting elbow, seen from the joint springs alone."""
    plan = Plan(
        poses={"count": 6}, pulls={"steps_n": [1500, 3000]}, hidden={"effects": ["joint_tilt:3"]}
    )
    raw = campaign.in_memory(simulate(plan, np.random.default_rng(12)).files)
    data = reduce(raw, conformed).data
    cell = paper_cell(raw.robot, tool(raw.settings))
    _, estimate = identify(cell, data, raw.robot.nominal_compliance)
    case, _ = case_of(cell, data, estimate)
    view = case.look(case.sight(case.model((), estimate.value)))
    return case, view, candidates(case, np.random.default_rng(1))


def suspect(view, label):
    """Index of the first form of a cause."""
    return next(i for i, effect in enumerate(view.suspects) if effect.label == label)


def moved(view, pulls, effect, k):
    """What one more typical size of a parameter moves, by differences; rows (pulls, 3 targets)."""
    cell = replace(view.model.cell, equilibrium="undeformed").with_effects(effect)
    here = np.concatenate([view.model.values, np.zeros(len(effect.parameters))])
    at = len(view.model.values) + k
    step = STEP * effect.parameters[k].typical * np.eye(len(here))[at]
    ahead, behind = (predict(cell, pulls, here + d).displacement for d in (step, -step))
    return (ahead - behind) / (2 * STEP)


def apart(view, pair, pulls):
    """Sigmas between two causes once these pulls are measured too, by plain least squares."""
    spread = np.median(view.spread)
    springs = np.zeros((3 * 3 * len(pulls.pose), view.first))
    flat = replace(view.model.cell, equilibrium="undeformed")
    for k in range(view.springs):
        step = STEP * view.typical[k] * np.eye(view.springs)[k]
        ahead, behind = (
            predict(flat, pulls, view.model.values + d).displacement for d in (step, -step)
        )
        springs[:, k] = ((ahead - behind) / (2 * STEP)).ravel() / spread
    two = []
    for i in pair:
        effect = view.suspects[i]
        new = [moved(view, pulls, effect, k).ravel() for k in range(len(effect.parameters))]
        two.append((view.A[:, view.columns([i])], np.stack(new, axis=1) / spread))
    old, c = view.A[:, : view.first], view.A[:, -1]
    found = []
    for (mine, mine_new), (other, other_new) in (two, two[::-1]):
        fitted = np.linalg.lstsq(np.hstack([old, mine]), c, rcond=None)[0][view.first :]
        signal = np.concatenate([mine, mine_new]) @ fitted
        rest = np.vstack([np.hstack([old, other]), np.hstack([springs, other_new])])
        left = signal - rest @ np.linalg.lstsq(rest, signal, rcond=None)[0]
        found.append(np.linalg.norm(left))
    return min(found)


def only(pulls, which):
    """Some of the pulls."""
    return replace(pulls, **{name: getattr(pulls, name)[which] for name in vars(pulls)})


PAIRS = [("joint_tilt:3", "link_bending:upper_arm"), ("joint_tilt:3", "joint_tilt:4")]


@pytest.mark.parametrize("labels", PAIRS)
def test_a_proposal_promises_what_least_squares_would_find(asked, labels):
    """Sigmas now and with the pull, and no other of thirty pulls does better."""
    _, view, among = asked
    pair = tuple(suspect(view, label) for label in labels)
    first = propose(view, pair, [], among, most=1)[0]

    same = np.flatnonzero((among.pulls.q == first.q).all(axis=1))
    force = np.linalg.norm(among.pulls.force[same], axis=1)
    chosen = same[np.argmin(np.abs(force - first.force_n))]
    assert first.separates == labels
    assert first.before == pytest.approx(apart(view, pair, only(among.pulls, slice(0))), rel=1e-4)
    promised = apart(view, pair, only(among.pulls, [chosen]))
    assert first.after == pytest.approx(promised, rel=1e-3)
    assert first.after > first.before
    others = [apart(view, pair, only(among.pulls, [k])) for k in range(0, len(among.anchor), 16)]
    assert max(others) <= first.after * 1.001


def test_further_pulls_are_proposed_until_the_causes_are_apart(asked):
    """Of ten weak pulls several are needed; each promise counts those before it."""
    _, view, among = asked
    pair = tuple(suspect(view, label) for label in PAIRS[0])
    weak = np.flatnonzero(among.pulls.branch < 0)[:10]
    few = Candidates(only(among.pulls, weak), among.anchor[weak])

    series = propose(view, pair, [], few)

    chosen = [int(np.flatnonzero((few.pulls.q == one.q).all(axis=1))[0]) for one in series]
    assert [one.pulls for one in series] == list(range(1, len(series) + 1))
    assert len(series) > 1
    for count, one in enumerate(series, 1):
        promised = apart(view, pair, only(few.pulls, chosen[:count]))
        assert one.after == pytest.approx(promised, rel=1e-3)
    assert series[-1].after >= 4.6 or len(series) == 4


def test_nothing_is_proposed_for_twins(asked):
    """Tilts of joints 5 and 6 share one column: no pull tells them apart."""
    _, view, among = asked

    pair = suspect(view, "joint_tilt:5"), suspect(view, "joint_tilt:6")
    assert propose(view, pair, [], among) == []
