"""Chains without reflectors: from the load point straight to the anchor that the log names."""

import csv
import io
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.annex.reliability import _names
from pipeline.base.errors import InputError
from pipeline.faults.conventions import anchored as frame
from pipeline.faults.conventions import mapped
from pipeline.faults.exchanged import regrouped
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.faults.placement import _placed as placed_in_base
from pipeline.faults.screen import _corrected_case as corrected
from pipeline.machine.effects import scale, table, tracker_drift
from pipeline.reduction.bring import bring
from pipeline.reduction.expected import expected
from pipeline.reduction.register import XYZ
from pipeline.run import ingested
from pipeline.store.campaign import in_memory

DEMO = Path(__file__).parents[2] / "data/raw/kr500_demo"
FAR_M = 2.5
"""How far behind the second reflector of its chain each anchor is [m]."""


def reduced(files):
    return bring(ingested(in_memory(files), plausible=False))


def in_newton(found):
    """Forces on the robot in F_b, (m, 3)."""
    return found.shown["forces"][["fx_n", "fy_n", "fz_n"]].to_numpy()


@pytest.fixture(scope="module")
def hall():
    """The demo without its chain's reflectors, places of anchors in F_b, and its forces."""
    files = {path.name: path.read_bytes() for path in DEMO.iterdir()}
    whole = reduced(files)
    placed = whole.placed.set_index(["pose", "repeat", "target"])[["x_m", "y_m", "z_m"]]
    anchors = {}
    for pose, pull in {(p, r) for p, r, t in placed.index if t == "Pl2"}:
        near, far = (
            placed.loc[(pose, pull, end)].to_numpy().reshape(-1, 3).mean(axis=0)
            for end in ("Pl1", "Pl2")
        )
        way = (far - near) / np.linalg.norm(far - near)
        anchors[f"K{pose}-{pull}"] = far + (FAR_M + 0.1 * pull) * way
    rows = csv.reader(io.StringIO(files["tracker.csv"].decode()))
    left = [",".join(row) for row in rows if not row[1].startswith("Pl")]
    head, *log = files["loads.csv"].decode().split()
    named = [f"{row},K{row.split(',')[0]}-{row.split(',')[1]}" for row in log]
    toml = files["campaign.toml"].decode()
    files |= {"tracker.csv": "\n".join(left).encode(),
              "loads.csv": "\n".join([f"{head},anchor", *named]).encode()}  # fmt: skip
    return files, toml, anchors, in_newton(whole)


def with_anchors(toml, anchors):
    rows = (f'"{name}" = {[round(float(x), 4) for x in at]}' for name, at in anchors.items())
    return toml.replace("[scale]", "\n".join(["[anchors]", *rows, "", "[scale]"]), 1).encode()


@pytest.fixture(scope="module")
def stated(hall):
    """The campaign, ingested."""
    files, toml, anchors, _ = hall
    made = files | {"campaign.toml": with_anchors(toml, anchors)}
    return ingested(in_memory(made), plausible=False)


def test_the_force_points_to_the_anchor(hall, stated):
    """Within 2 mrad of where reflectors on the chain show it, whatever each chain's length."""
    *_, true = hall
    force = in_newton(bring(stated))

    assert len(force) == len(true)
    off = np.linalg.norm(force - true, axis=1) / np.linalg.norm(true, axis=1)
    assert np.max(off) < 2e-3


def test_exchanged_names_turn_no_chain(hall, stated):
    """Ends from the load point are where they are with the reflectors' own names."""
    files, toml, anchors, true = hall
    first, second = stated.settings.measured[:2]
    other = {first: second, second: first}
    rows = [row.split(",") for row in files["tracker.csv"].decode().splitlines()]
    group = next(row[0] for row in rows if "rep1_loaded" in row[0])
    turned = [[a, other.get(b, b) if a == group else b, *c] for a, b, *c in rows]
    assert turned != rows
    spoilt = files | {"tracker.csv": "\n".join(map(",".join, turned)).encode()}
    force = in_newton(reduced(spoilt | {"campaign.toml": with_anchors(toml, anchors)}))

    off = np.linalg.norm(force - true, axis=1) / np.linalg.norm(true, axis=1)
    assert np.max(off) < 2e-3


def test_without_times_ends_are_read_with_their_pull(hall):
    """From the station where the tracker stood then, not from the last one."""
    files, toml, anchors, true = hall
    head, *rows = (row.split(",")[:5] for row in files["tracker.csv"].decode().splitlines())
    half = next(k for k, row in enumerate(rows) if row[0].startswith("pose09"))
    again = [["base_again", *row[1:]] for row in rows if row[0] == "base_start"]
    there, away = Rotation.from_rotvec([0.0, 0.0, 0.4]), np.array([500.0, -800.0, 100.0])  # mm
    moved = [[*row[:2], *(there.apply(np.array(row[2:], float)) + away).astype(str)]
             for row in [*again, *rows[half:]]]  # fmt: skip
    made = "\n".join(map(",".join, [head, *rows[:half], *moved])).encode()
    force = in_newton(
        reduced(files | {"tracker.csv": made, "campaign.toml": with_anchors(toml, anchors)})
    )

    off = np.linalg.norm(force - true, axis=1) / np.linalg.norm(true, axis=1)
    assert np.max(off) < 2e-3


@pytest.fixture(scope="module")
def read(hall, stated):
    """The campaign with the anchors read in the first round instead, ingested."""
    files, toml, anchors, _ = hall
    head, *rows = files["tracker.csv"].decode().splitlines()
    R, t = frame(stated)
    places = {name: 1e3 * R.T @ (at - t) for name, at in anchors.items()}
    seen = [f"base_start,{name},{','.join(map(str, at))}," for name, at in places.items()]
    made = files | {"tracker.csv": "\n".join([head, *rows[:4], *seen, *rows[4:]]).encode()}
    return ingested(in_memory(made | {"campaign.toml": toml.encode()}), plausible=False)


def test_chains_follow_readings_that_are_put_back(stated):
    """Those of two poses that are exchanged go to the anchors of their new pulls, others stay."""
    groups = [f"pose{k:02d}_rep1_loaded" for k in (2, 5)]
    mine = stated.readings["group"].isin(groups)
    at = lines_of(stated.readings[mine])
    true = dict(zip(groups, reversed(groups), strict=True))
    put_back = partial(regrouped, true=true, out=frozenset(), at=at)

    right = corrected(stated, [Mistake("exchanged", "", "", "", 1.0, put_back)])

    rows = right.readings[right.readings["group"].isin(groups)].set_index(["pose", "target"])
    R, t = frame(stated)
    for pose in (2, 5):
        near, far = (rows.loc[(pose, end), XYZ].to_numpy(float) for end in ("Pl1", "Pl2"))
        due = R.T @ (stated.settings.anchors[stated.anchors[pose, 1]] - t) - near
        assert (far - near) / np.linalg.norm(far - near) == pytest.approx(
            due / np.linalg.norm(due), abs=1e-3
        )
    kept = (one.readings.loc[~mine, XYZ].to_numpy(float) for one in (right, stated))
    assert next(kept) == pytest.approx(next(kept), abs=1e-4)  # of one length


@pytest.mark.parametrize("known", ["stated", "read"])
def test_a_base_frame_put_right_moves_no_chain(known, request):
    """An anchor is where it was read, or where it is stated in the same frame as the base."""
    case = request.getfixturevalue(known)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix()
    put_right = partial(placed_in_base, turn, np.array([2.0, 1.0, 0.5]))

    right = corrected(case, [Mistake("sign_or_convention", "", "", "", 1.0, put_right)])

    assert {*case.readings["target"]} >= {"Pl1", "Pl2"}
    before, after = (one.readings[XYZ].to_numpy(float) for one in (case, right))
    assert after == pytest.approx(before, abs=1e-6)


def test_mirrored_readings_mirror_the_anchors_among_them(read):
    mirror = np.diag([1.0, -1.0, 1.0])

    right = corrected(read, [Mistake("", "", "", "", 1.0, partial(mapped, mirror))])

    rows = right.readings.set_index(["pose", "repeat", "target"]).sort_index()
    for pull in read.anchors_read:
        near, far = (rows.loc[(*pull, end), XYZ].to_numpy(float).ravel() for end in ("Pl1", "Pl2"))
        due = mirror @ read.anchors_read[pull] - near
        assert (far - near) / np.linalg.norm(far - near) == pytest.approx(
            due / np.linalg.norm(due), abs=1e-6
        )


def test_a_reflector_of_the_base_may_be_an_anchor(hall):
    """Its readings still place the tracker."""
    files, toml, *_ = hall
    head, *log = files["loads.csv"].decode().split()
    hooked = [f"{row.rpartition(',')[0]},B1" for row in log]
    made = {"loads.csv": "\n".join([head, *hooked]).encode(), "campaign.toml": toml.encode()}

    case = ingested(in_memory(files | made), plausible=False)

    assert case.readings["target"].eq("B1").sum() == 2
    assert {*case.anchors.values()} == {"B1"}
    assert not case.anchors_read
    R, t = frame(case)
    near, far = (
        case.readings[case.readings["target"] == name][[*XYZ]].to_numpy(float) @ R.T + t
        for name in case.settings.naming.chain
    )
    along, whole = far - near, np.array(case.settings.base_frame["B1"]) - near
    off = np.linalg.norm(np.cross(along, whole), axis=1) / np.linalg.norm(along, axis=1)
    assert off.max() < 1e-3


def test_reflectors_that_no_chain_has_are_neither_suspected_nor_told(stated):
    """Where the log names anchors; advice that the campaign has followed is not given again."""
    with_chain = {path.name: path.read_bytes() for path in DEMO.iterdir()}
    told = {}
    for chain, case in (
        (False, stated),
        (True, ingested(in_memory(with_chain), plausible=False)),
    ):
        found = bring(case)
        names = {name for name, *_ in _names(case, found.placed).values()}
        needs = {one.name: one.needs for one in expected(case, found.data)}
        assert ("chain_offset" in needs) == chain
        assert any("Pl1-Pl2" in name for name in names) == chain
        assert any("direction to its anchor" in name for name in names) != chain
        told[chain] = needs
    assert told[True]["tracker_drift"] == tracker_drift.FURTHER
    assert told[True]["joint_offset"] == table.FURTHER
    assert told[True]["scale_zero"] == scale.FURTHER
    once = replace(case, readings=case.readings[case.readings["group"] != "base_end"])
    assert case.readings["group"].eq("base_end").any()
    pulls = found.data.pulls
    pulls = replace(pulls, pose=np.arange(len(pulls.pose)))
    asked = {one.name: one.needs for one in expected(once, replace(found.data, pulls=pulls))}
    assert asked["scale_zero"] == scale.NEEDS
    assert asked["tracker_drift"] == tracker_drift.NEEDS


def test_a_chain_with_reflectors_is_where_they_were_read(hall):
    """Whatever the log says of its anchor, which then needs no place."""
    files, toml, _, true = hall
    made = files | {"tracker.csv": (DEMO / "tracker.csv").read_bytes()}

    assert in_newton(reduced(made | {"campaign.toml": toml.encode()})) == pytest.approx(true)


def test_an_anchor_without_a_place_is_named(hall):
    files, toml, anchors, _ = hall
    some = {name: at for name, at in anchors.items() if name != "K2-1"}

    with pytest.raises(InputError, match='the anchor "K2-1" has no place') as problem:
        reduced(files | {"campaign.toml": with_anchors(toml, some)})
    assert problem.value.file == "loads.csv"
