"""Chains to anchors: their lengths differ as the anchors do, and one name may be the wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.base.linear import rigid
from pipeline.faults import chain
from pipeline.faults.anchor import wrong_anchors
from pipeline.faults.chain import chain_gross, chain_outlier
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from tests.small_case import asked, small, where

ANCHORS = [[2.5, 1.5, -0.9], [-2.5, 4.5, 0.3], [1.8, 3.9, -0.9]]


def crossing(near: np.ndarray, far: np.ndarray) -> np.ndarray:
    """The point nearest to some lines through two points each, both (n, 3)."""
    u = (far - near) / np.linalg.norm(far - near, axis=1, keepdims=True)
    across = np.eye(3) - u[:, :, None] * u[:, None, :]
    return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, near))


@pytest.fixture(scope="module")
def hall() -> tuple[Case, np.ndarray]:
    """Nine poses pulled towards three anchors in turn, the far end of each chain at its anchor."""
    case = small(5, poses={"count": 9}, pulls={"steps_n": [1500.0, 3000.0], "anchors": ANCHORS})
    rows = case.readings.copy()
    near, far = (rows[(rows["state"] == "loaded") & (rows["target"] == n)] for n in ("Pl1", "Pl2"))
    turn = (far["pose"].to_numpy(int) - 1) % 3
    ends = [one[XYZ].to_numpy(float) for one in (near, far)]
    at = np.array([crossing(*(end[turn == k] for end in ends)) for k in range(3)])
    rows.loc[far.index, XYZ] = at[turn]
    return replace(case, readings=rows), at


def test_how_far_an_anchor_is_accuses_no_pull(hall):
    case, _ = hall
    rows = case.readings[case.readings["state"] == "loaded"]
    ends = [rows.loc[rows["target"] == name, XYZ].to_numpy(float) for name in ("Pl1", "Pl2")]
    length = np.linalg.norm(ends[1] - ends[0], axis=1)
    assert length.max() > 1.5 * length.min()
    assert chain_gross(case) == chain_outlier(case) == wrong_anchors(asked(case)) == []


def test_a_pull_towards_another_anchor_is_named_with_that_anchor(hall):
    case, at = hall
    group = "pose05_rep2_loaded"
    mine = where(case, group, "Pl2")
    rows = case.readings.copy()
    rows.loc[mine, XYZ] = at[2]  # pulled towards the second

    (found,) = wrong_anchors(asked(replace(case, readings=rows)))

    row = case.loads[(case.loads["pose"] == 5) & (case.loads["repeat"] == 2)].iloc[0]
    line = case.readings[mine].iloc[0]
    assert found.where == group
    assert found.at == (f"{row['file']}:{row['line']}", f"{line['file']}:{line['line']}")
    assert "that of pose02_rep1_loaded, pose02_rep2_loaded, pose05_rep1_loaded" in found.evidence
    right = found.correct(replace(case, readings=rows))
    assert right.readings.loc[mine, XYZ].to_numpy(float)[0] == pytest.approx(at[1], abs=1e-3)


def to_anchors(case, at, own, beside_m=9.0):
    """Chains from the load point straight to anchors, all of one length, which the log names.

    Args:
        case: Two pulls in each of nine poses.
        at: Places of the anchors in the frame of the tracker.
        own: Anchor that the row of each pull names.
        beside_m: Height of a fourth one above the second [m].
    """
    placed = asked(case).reduced.placed
    both = case.readings.merge(placed, on=["group", "target"])
    R, origin = rigid(*(both[[f"{c}_{k}" for c in XYZ]].to_numpy(float) for k in ("y", "x")))
    loaded = placed.set_index(["pose", "target", "state"]).sort_index()
    ends = [loaded.loc[(k + 1, "Pl2", "loaded"), XYZ].mean() for k in range(3)]
    stated = {f"H{k + 1}": tuple(end.tolist()) for k, end in enumerate(ends)}
    stated["H4"] = (*stated["H2"][:2], stated["H2"][2] + beside_m)
    at = np.vstack([at, R @ stated["H4"] + origin])

    rows = case.readings.copy()
    near, far = (rows[(rows["state"] == "loaded") & (rows["target"] == n)] for n in ("Pl1", "Pl2"))
    begin = near[XYZ].to_numpy(float)
    u = at[own] - begin
    rows.loc[far.index, XYZ] = begin + 1.5 * u / np.linalg.norm(u, axis=1, keepdims=True)
    settings = case.settings.model_copy(update={"anchors": stated})
    named = {(k, r): f"H{own[2 * k + r - 3] + 1}" for k in range(1, 10) for r in (1, 2)}
    return replace(case, readings=rows, settings=settings, anchors=named)


IN_TURN = np.repeat(np.arange(9) % 3, 2)
"""Anchor of each pull."""


@pytest.mark.parametrize(
    ("beside_m", "probably"), [(9.0, "H2:"), (0.15, "H2:"), (0.03, "H4 or H2:")]
)
def test_a_pull_towards_another_stated_anchor_is_named_with_both(hall, beside_m, probably):
    """A fourth stands above the right one: it fits as well if it is seen within a degree of it."""
    case, at = hall
    own = IN_TURN.copy()
    own[9] = 2  # pulled towards the second
    wrong = to_anchors(case, at, own, beside_m)

    (found,) = wrong_anchors(asked(wrong))

    assert found.where == "pose05_rep2_loaded"
    assert f"another anchor than H3, as its row says, probably {probably}" in found.evidence
    right = found.correct(wrong)
    assert right.readings is wrong.readings  # its end follows, as all of them do
    assert right.anchors == wrong.anchors | {(5, 2): probably[:2]}


def test_a_row_that_names_an_anchor_beside_the_right_one_is_found(hall):
    """A third of a metre from it, by which a displacement is off by five times its noise."""
    case, at = hall
    assert wrong_anchors(asked(to_anchors(case, at, IN_TURN, beside_m=0.3))) == []
    own = IN_TURN.copy()
    own[9] = 3

    (found,) = wrong_anchors(asked(to_anchors(case, at, own, beside_m=0.3)))

    assert found.where == "pose05_rep2_loaded"
    assert "another anchor than H4, as its row says, probably H2:" in found.evidence
    assert 3 < found.before / found.after < 10


@pytest.mark.parametrize(
    "true", [{(1, 1): (5, 2), (5, 2): (1, 1)}, {(2, 1): (3, 2), (3, 2): (7, 1), (7, 1): (2, 1)}]
)
def test_rows_of_the_loads_are_exchanged_with_the_anchors_that_they_name(hall, true):
    """Two, and three in a ring, of other forces and towards other anchors: one finding."""
    case, at = hall
    right = to_anchors(case, at, IN_TURN)
    loads = right.loads.set_index(["pose", "repeat"], drop=False)
    own, anchors = IN_TURN.copy(), dict(right.anchors)
    for here, there in true.items():  # row `here` has what belongs to `there`
        loads.loc[here, "force_n"] = right.loads.set_index(["pose", "repeat"]).loc[there, "force_n"]
        anchors[here], own[2 * here[0] + here[1] - 3] = right.anchors[there], (there[0] - 1) % 3
    loads = loads.reset_index(drop=True)
    wrong = replace(to_anchors(case, at, own), loads=loads)
    assert wrong.anchors == anchors

    (found,) = wrong_anchors(asked(wrong))

    assert found.name == "exchanged"
    assert {f"{r.file}:{r.line}" for r in loads.itertuples() if (r.pose, r.repeat) in true} == {
        *found.at
    }
    assert "the forces and anchors of pose" in found.evidence
    back = found.correct(wrong)
    assert back.anchors == right.anchors
    assert back.loads["force_n"].tolist() == right.loads["force_n"].tolist()


def test_a_force_that_is_wrong_leaves_the_anchor(hall):
    case, _ = hall
    wrong = case.loads["force_n"].where(case.loads["pose"] != 5, case.loads["force_n"] * 0.4)
    assert wrong_anchors(asked(replace(case, loads=case.loads.assign(force_n=wrong)))) == []


def test_where_there_is_one_anchor_no_pull_goes_to_another(hall):
    case, at = hall
    alone = case.settings.model_copy(update={"anchors": {"H1": tuple(at[0].tolist())}})
    named = {(k, r): "H1" for k in range(1, 10) for r in (1, 2)}
    wrong = case.loads["force_n"].where(case.loads["pose"] != 5, case.loads["force_n"] * 0.4)
    loads = case.loads.assign(force_n=wrong)
    assert wrong_anchors(asked(replace(case, loads=loads, settings=alone, anchors=named))) == []


def test_ends_that_were_not_read_are_compared_with_none(hall):
    """Where a row names its anchor, the direction of its chain is stated."""
    case, at = hall
    stated = to_anchors(case, at, IN_TURN)
    some = replace(stated, anchors={(1, 1): "H1", (1, 2): "H1"})

    assert len(chain._read(case).group) == 18
    assert len(chain._read(some).group) == 16
    assert chain_gross(stated) == chain_outlier(stated) == []
    assert not len(chain._read(stated).group)
