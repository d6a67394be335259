"""What is said of each mistake: every field of its record, from numbers put in by hand."""

from dataclasses import MISSING, fields
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest

from pipeline.faults import (
    base_names,
    base_reflector,
    base_rounds,
    chain,
    conventions,
    dead_sensor,
    exchanged,
    exchanged_pulls,
    labels,
    loose_target,
    named_twice,
    pose_moved,
    reading,
    scale_reading,
    scale_rows,
    stale_reading,
    tool_point,
    unit_since,
)
from pipeline.faults.assignment import Ring
from pipeline.faults.entries import DoubtfulEntry
from pipeline.machine.effect import HUNG, MOUNTED, PULLED

NAN = float("nan")


def says(**known):
    """What a finding says, by field."""
    return known


LOG = says(gain=1.0, zero_n=0.0)


def record(found):
    """Every field of a mistake that is not as usual, without the function that corrects it."""
    pairs = ((f, getattr(found, f.name)) for f in fields(found) if f.name != "correct")
    return {f.name: value for f, value in pairs if f.default is MISSING or value != f.default}


def readings(*rows, first=2):
    """Table of readings (pose, repeat, state, group, target) in successive lines of t.csv."""
    table = pd.DataFrame(rows, columns=["pose", "repeat", "state", "group", "target"])
    at = np.arange(len(rows) * 3.0).reshape(-1, 3)
    table[["x_m", "y_m", "z_m"]] = at
    return table.assign(file="t.csv", line=np.arange(first, first + len(rows)), time=pd.NaT)


ROWS = readings(
    (NAN, 0, "unloaded", "base_a", "B1"),
    (NAN, 0, "unloaded", "base_a", "B2"),
    (NAN, 0, "unloaded", "base_b", "B1"),
    (3, 0, "unloaded", "p3_zero", "P1"),
    (3, 0, "unloaded", "p3_zero", "P2"),
    (3, 1, "loaded", "p3_pull1", "P1"),
    (3, 1, "loaded", "p3_pull1", "P2"),
    (3, 1, "loaded", "p3_pull1", "Pl1"),
    (3, 1, "loaded", "p3_pull1", "Pl2"),
    (3, 2, "loaded", "p3_pull2", "P1"),
    (3, 2, "loaded", "p3_pull2", "Pl2"),
)
LOADS = pd.DataFrame(
    {"pose": [3, 3, 4, 5], "repeat": [1, 2, 1, 1], "file": "f.csv", "line": [7, 8, 9, 10],
     "force_n": [100.0, 250.0, 900.0, 40.0], "mass_kg": NAN, "payload": ["", "", "spindle", ""],
     "unit_n": [1.0, 1000.0, 1.0, 1.0]}
)  # fmt: skip
JOINTS = pd.DataFrame(
    {"pose": [3, 4, 5], "file": "j.csv", "line": [2, 3, 4],
     "theta1_deg": [1.0, 2.0, 1.0], "theta2_deg": [5.0, 6.0, 5.0]}
)  # fmt: skip
CASE = Some(
    readings=ROWS,
    loads=LOADS,
    joints=JOINTS,
    joint_columns=["theta1_deg", "theta2_deg"],
    displacements=None,
    stale=(),
    settings=Some(
        naming=Some(chain=["Pl1", "Pl2"]),
        measured=["P1", "P2"],
        displacements=None,
        anchors={"H1": (1.0, 0, 0), "H2": (0.0, 1, 0)},
        base_frame={"B1": (0.0, 0, 0), "B2": (1.0, 0, 0)},
        gravity=Some(m_s2=10.0),
        loads_log=Some(**LOG),
    ),
)
PULLS = Some(
    pose=np.array([3, 3, 4, 5]),
    repeat=np.array([1, 2, 1, 1]),
    force=np.array([[100.0, 0, 0], [0, 250.0, 0], [0, 0, 900.0], [24.0, 32.0, 0]]),
    by=np.array([PULLED, PULLED, MOUNTED, HUNG]),
)
DATA = Some(pulls=PULLS)
ASKED = Some(case=CASE, reduced=Some(data=DATA))
CHAIN = Some(group=np.array(["p3_pull1", "p3_pull2"], object))
OFF = chain._Off(0, 7.25, 1, 0.0042, 1e-6)
SWAP = Ring((0, 1))
PLACE = {"B1": "B2", "B2": "B1"}
APART_M2 = np.array([[0.09, 4e-6], [1e-6, 0.25]])


def said_of_the_chain(end):
    return chain._finding(CASE, CHAIN, OFF, "the chain is odd", end)


def of_loads(members, ended=False, case=CASE):
    """Forces of 100, 250, 900 N in each other's rows, due to be 240, 110, 905 N."""
    moved = Some(
        pull=np.arange(3),
        force=np.array([100.0, 250.0, 900.0]),
        due=lambda x: (np.array([240.0, 110.0, 905.0]), None),
    )
    cost = np.array([[400.0, 4.0, 1.0], [9.0, 900.0, 2.0], [16.0, 25.0, 100.0]])
    asked, ring = Some(case=case, reduced=ASKED.reduced), Ring(members, ended)
    return exchanged_pulls.of_loads(asked, moved, Some(x=0, cost=cost), ring)


def of_scale(pull, force, fits, std, p=1e-7, log=LOG):
    """A reading of the scale that all other pulls contradict."""
    forces = PULLS.force.copy()
    forces[pull] *= force / np.linalg.norm(forces[pull])
    data = Some(pulls=Some(**{**vars(PULLS), "force": forces}))
    best = np.linalg.norm(forces, axis=1)
    best[pull] = fits
    held = Some(single=np.array([True]))
    righted = Some(fits=best, pulls=np.array([pull]), held=held)
    case = Some(
        **{**vars(CASE), "settings": Some(**{**vars(CASE.settings), "loads_log": Some(**log)})}
    )
    return scale_reading._finding(case, data, righted, pull, std, p)


def of_zero(pulls, off):
    """Another zero of the scale in some pulls, by 40 N too much or too little."""
    of = np.zeros((4, 2))
    of[3, 0], of[pulls, 1] = 1.0, 1.0
    among = scale_reading._Errors(of, np.array([0, len({int(PULLS.pose[k]) for k in pulls})]))
    righted = Some(among=among, size=np.array([5.0, off]), which=np.array([0, 1]))
    return scale_reading._named(CASE, DATA, righted, 1, 2.0, 1e-5)


def of_unit(unit, sign, wrong):
    change = scale_rows._Change(np.array(wrong), unit, sign)
    return scale_rows._of_unit(LOADS[change.wrong], change)


def of_the_pose(first, zeroed=False):
    """A motion between states of pose 3, whose zero was read before its pulls."""
    size = np.array([3e-3, 0, 4e-3, 1.0])
    asked = Some(case=CASE, reduced=Some(data=DATA))
    states = [(-1, 0), (0, 0), (1, 0)]
    return pose_moved._finding(asked, 3, states, first, size, 144.0, 1e-4, zeroed)


def one_row(group, target, line):
    return pd.Series({"group": group, "target": target, "file": "t.csv", "line": line})


def station(first):
    away = pd.DataFrame(
        {"given": [0.001, 1.2, 1.4], "later": [1.3, 0.002, 0.004]}, index=[3, 4, 5]
    ).iloc[1 - min(first, 1) :]
    case = Some(readings=ROWS, stations=(Some(group="base_a", moved_m=0.4),))
    return base_rounds._of_station(case, 0, away, first, 5.0)


SAID = {
    "base names": (
        lambda: base_names._finding(CASE, PLACE, (0.52, 0.0004), None),
        says(
            name="label_swap", where="B1-B2", before=520.0, after=0.4,
            at=("t.csv:2", "t.csv:3", "t.csv:4"),
            evidence="the base reflectors have each other's names or places in [base_frame]: B1 "
            "stands at the place of B2, B2 stands at the place of B1 (t.csv:2–4); as stated they "
            "are 520.00 mm from their places, and 0.40 mm with the names exchanged",
            correction="recomputed with the places of B1, B2 exchanged",
        ),
    ),
    "base names of a round": (
        lambda: base_names._finding(CASE, PLACE, (1.5, 0.0004), "base_a"),
        says(
            name="label_swap", where="base_a B1-B2", before=1500.0, after=0.4,
            at=("t.csv:2", "t.csv:3"),
            evidence="the base reflectors have each other's names in base_a: B1 stands at the "
            "place of B2, B2 stands at the place of B1 (t.csv:2–3); as stated they are 1.50 m "
            "from their places, and 0.40 mm with the names exchanged",
            correction="recomputed with the places of B1, B2 exchanged",
        ),
    ),
    "base reflector": (
        lambda: base_reflector._finding("B2", 0.0012, 25.0, 3.5, 2e-9),
        says(
            entry=("base_frame", "B2"),
            name="outlier", where="B2", before=25.0, after=3.5, unit="sigma", size=0.0012,
            size_unit="m", p_value=2e-9,
            evidence="the base reflector B2 is 1.20 mm from its place in [base_frame] in every "
            "round, 25.0 standard deviations, and the others agree without it: its nominal "
            "coordinates are wrong, or it was moved before the first round",
            correction="recomputed without B2",
        ),
    ),
    "rounds": (
        lambda: base_rounds._finding(CASE, ("base_b", "base_a"), 0.25, 0.002),
        says(
            name="exchanged", where="base_b/base_a", before=250.0, after=2.0,
            at=("t.csv:2", "t.csv:3", "t.csv:4"),
            evidence="the rounds base_b and base_a of the base reflectors have each other's "
            "readings (t.csv:2–4): as they stand the effector is 250.00 mm from where the robot's "
            "table has it, and 2.00 mm with the two exchanged",
            correction="recomputed with the readings of base_b and base_a exchanged",
        ),
    ),
    "station": (
        lambda: station(1),
        says(
            name="tracker_moved", where="after pose 3", before=1300.0, after=3.0, size=0.4,
            size_unit="m", at=("t.csv:2", "t.csv:3"),
            evidence="the tracker was carried 400.00 mm after pose 3, and its base was read from "
            "there only in base_a (t.csv:2–3): as from the station before, the effector is 1.30 m "
            "from where the robot's table has it since pose 4, and 3.00 mm as from the one of "
            "base_a",
            correction="recomputed with the readings since pose 4 as from the later station",
        ),
    ),
    "station of the first pose": (
        lambda: station(0),
        says(
            name="tracker_moved", where="before pose 4", before=1300.0, after=3.0, size=0.4,
            size_unit="m", at=("t.csv:2", "t.csv:3"),
            evidence="the tracker was carried 400.00 mm before pose 4, and its base was read from "
            "there only in base_a (t.csv:2–3): as from the station before, the effector is 1.30 m "
            "from where the robot's table has it since pose 4, and 3.00 mm as from the one of "
            "base_a",
            correction="recomputed with the readings since pose 4 as from the later station",
        ),
    ),
    "chain": (
        lambda: said_of_the_chain(None),
        says(
            name="outlier", where="p3_pull1/Pl1-Pl2", before=7.25, unit="sigma",
            size=0.0042, size_unit="m", p_value=1e-6, at=("t.csv:9", "t.csv:10"), axes=1,
            evidence="in p3_pull1 (t.csv:9, t.csv:10) the chain is odd",
            correction="recomputed without the pull of p3_pull1",
        ),
    ),
    "end of a chain": (
        lambda: said_of_the_chain((1, 0.0123)),
        says(
            name="outlier", where="p3_pull1/Pl2", before=7.25, unit="sigma",
            size=0.0123, size_unit="m", p_value=1e-6, at=("t.csv:10",), axes=1,
            evidence="in p3_pull1 (t.csv:10) the chain is odd: Pl2 is 12.3 mm off",
            correction="recomputed without the pull of p3_pull1",
        ),
    ),
    "convention": (
        lambda: conventions._finding(
            CASE, Some(name="unit_mixup", where="mm", says="it is in mm", write="; write x",
                       correct=None), 1.234, 0.00056,
        ),
        says(
            name="unit_mixup", where="mm", before=1234.0, after=0.56,
            evidence="it is in mm: as given the unloaded reflectors are 1234 mm from where the "
            "robot file places them, and 0.6 mm with that corrected; write x",
            correction="recomputed as if it is in mm",
        ),
    ),
    "columns exchanged": (
        lambda: conventions._finding(
            CASE, Some(name="exchanged", where="a/b", says="a is b", write="", correct=None), 1, 0
        ),
        says(
            name="exchanged", where="a/b", before=1000.0, at=("j.csv:2", "j.csv:3", "j.csv:4"),
            evidence="a is b: as given the unloaded reflectors are 1000 mm from where the robot "
            "file places them, and 0.0 mm with that corrected",
            correction="recomputed as if a is b",
        ),
    ),
    "copied force": (
        lambda: dead_sensor._of_copy(CASE, DATA, np.array([1, 0]), 250.0, False),
        says(
            name="copied_column", where="f.csv force", before=dead_sensor._UNLIKE, after=1.0,
            unit="1", at=("f.csv:7", "f.csv:8"),
            evidence="2 pulls have the same force of 250.000 N (f.csv:7–8), and within a pose they "
            f"moved the robot by amounts that differ by more than {dead_sensor._UNLIKE} times: one "
            "number was copied down the column, or the scale hung",
            correction="recomputed without these pulls",
        ),
    ),
    "one force for all": (
        lambda: dead_sensor._of_copy(CASE, DATA, np.arange(4), 250.0, True),
        says(
            name="copied_column", where="f.csv force", before=dead_sensor._UNLIKE, after=1.0,
            unit="1", at=("f.csv:7", "f.csv:8", "f.csv:9", "f.csv:10"), hopeless=True,
            evidence="4 pulls have the same force of 250.000 N (f.csv:7–10), and within a pose "
            f"they moved the robot by amounts that differ by more than {dead_sensor._UNLIKE} "
            "times: one number was copied down the column, or the scale hung",
            correction="nothing can be corrected, no force was logged; each was taken to be known "
            "to 100 % only",
        ),
    ),
    "rows of the log": (
        lambda: exchanged._of_rows(CASE, np.array([5, 3]), SWAP, APART_M2),
        says(
            name="exchanged", where="j.csv pose03/pose05", before=500.0, after=2.0,
            at=("j.csv:2", "j.csv:4"),
            evidence="j.csv: the rows of pose05 and pose03, or their groups in the tracker export, "
            "stand in each other's place (j.csv:2, j.csv:4): as recorded, the reflectors of these "
            "poses are up to 500.00 mm from where the robot file places them, and 2.00 mm with the "
            "places exchanged",
            correction="recomputed with j.csv pose03/pose05 exchanged",
        ),
    ),
    "a row that belongs nowhere": (
        lambda: exchanged.exchange_mistake(
            Ring((0, 1), ended=True), where="w", what="x", stand="so", of="they are",
            cost=APART_M2, at=("f:1",), correct=None,
        ),
        says(
            name="exchanged", where="w", before=300.0, after=2.0, at=("f:1",),
            evidence="x stand so (f:1): as recorded, they are up to 300.00 mm from where the robot "
            "file places them, and 2.00 mm with the places exchanged",
            correction="recomputed with w exchanged; what belongs to none is left out",
        ),
    ),
    "forces of a pose": (
        lambda: of_loads((0, 1)),
        says(
            name="exchanged", where="p3_pull1/p3_pull2", before=30.0, after=3.0, unit="sigma",
            at=("f.csv:7", "f.csv:8", *(f"t.csv:{k}" for k in range(7, 13))), places=3,
            evidence="f.csv: the forces of pose03 rep1 and pose03 rep2 stand in each other's "
            "place, or the readings of these groups (f.csv:7–8, t.csv:7–12): pose03 rep2 was "
            "logged with 250.00 N, and moved as by 110.0 N, which 100.00 N of another row matches",
            correction="recomputed with p3_pull1/p3_pull2 exchanged",
        ),
    ),
    "forces of two poses": (
        lambda: of_loads((2, 0)),
        says(
            name="exchanged", where="f.csv pose03 rep1/pose04 rep1", before=20.0, after=4.0,
            unit="sigma", at=("f.csv:9", "f.csv:7"), places=3,
            evidence="f.csv: the forces of pose03 rep1 and pose04 rep1 stand in each other's place "
            "(f.csv:9, f.csv:7): pose03 rep1 was logged with 100.00 N, and moved as by 240.0 N, "
            "which 900.00 N of another row matches",
            correction="recomputed with f.csv pose03 rep1/pose04 rep1 exchanged",
        ),
    ),
    "states of a pose": (
        lambda: exchanged_pulls._of_states(
            CASE, 3, SWAP, [("p3_zero", 0), ("p3_pull1", 1)], 61.0, 1.25
        ),
        says(
            name="exchanged", where="p3_pull1/p3_zero", before=61.0, after=1.25, unit="sigma",
            at=("t.csv:5", "t.csv:6", "t.csv:7", "t.csv:8"),
            evidence="the readings of p3_zero and p3_pull1 in pose 3 stand in each other's place "
            "(t.csv:5–8): as recorded, the effector is up to 61 times as far as usual from where "
            "the pulls put it, and 1.2 times with them exchanged",
            correction="recomputed with p3_pull1/p3_zero exchanged",
        ),
    ),
    "names of targets": (
        lambda: labels._finding(
            CASE, "p3_pull1", {"P1": "P2", "P2": "P1"},
            np.where(ROWS["group"] == "p3_pull1", 0.31, 0.002) * np.linspace(1, 0.9, 11), ROWS,
        ),
        says(
            name="label_swap", where="p3_pull1", before=pytest.approx(310 * 0.95),
            after=pytest.approx(2 * 0.99), at=("t.csv:7", "t.csv:8"), alike="P1 and P2",
            evidence="in p3_pull1 the names P1 and P2 (t.csv:7, t.csv:8) are exchanged: as "
            "recorded, a reflector is 294 mm from its expected position, at that of the other one",
            correction="recomputed with P1 and P2 of p3_pull1 exchanged",
        ),
    ),
    "loose target": (
        lambda: loose_target._finding(ASKED, 1, 0.00052, 9.5, 2.5),
        says(
            name="loose_target", where="P2", before=9.5, unit="sigma", size=0.00052, size_unit="m",
            p_value=1.0,
            evidence="the target P2 gives way with the pull: it moves on the effector by up to "
            "0.52 mm in proportion to the force, 9.5 standard deviations, and the others do not: "
            "its nest rocks, or what holds it bends",
            correction="recomputed without P2",
        ),
    ),
    "names of groups": (
        lambda: named_twice._of_names(Some(groups=("a", "b"), pose=3, at=("t:1", "t:2", "t:4"))),
        says(
            name="exchanged", where="a/b", before=1.0, unit="1", at=("t:1", "t:2", "t:4"),
            evidence="the groups a and b of pose 3 have each other's names (t:1–2, t:4): the ends "
            "of the chain were read in the unloaded one, and not in the loaded one",
            correction="computed with their names exchanged",
        ),
    ),
    "one name twice": (
        lambda: named_twice._of_pose(
            3, [Some(group="a", target="P1", apart_m=0.2, at=("t:1", "t:5"), pose=3)], False
        ),
        says(
            name="exchanged", where="a", before=200.0, at=("t:1", "t:5"),
            evidence="t:1 and t:5 both have the name a/P1 and are 200.00 mm apart: which of them "
            "has its name by mistake nothing in the files says (t:1, t:5)",
            correction="computed without these readings",
        ),
    ),
    "names of a pose twice": (
        lambda: named_twice._of_pose(
            3,
            [Some(group=g, target="P1", apart_m=far, at=(f"t:{k}", f"t:{k + 5}"), pose=3)
             for k, (g, far) in enumerate((("a", 0.2), ("b", 1.25), ("c", 0.1)), 1)],
            True,
        ),
        says(
            name="exchanged", where="a/c", before=1250.0,
            at=("t:1", "t:6", "t:2", "t:7", "t:3", "t:8"),
            evidence="t:2 and t:7 both have the name b/P1 and are 1.25 m apart (so do others in 3 "
            "groups of pose 3): which of them has its name by mistake nothing in the files says "
            "(t:1, t:6, t:2, t:7, t:3, t:8)",
            correction="computed without pose 3",
        ),
    ),
    "pose moved behind its zero": (
        lambda: of_the_pose(1),
        says(
            name="outlier", where="p3_zero", before=12.0, unit="sigma", size=0.005,
            size_unit="m", p_value=1e-4, at=("t.csv:5", "t.csv:6"), together=True,
            evidence="in pose 3 the effector moved by 5.00 mm between its unloaded state and pull "
            "1, alike in all pulls that follow and whatever their force, 12.0 standard "
            "deviations: the tracker was knocked there, or the robot moved"
            + pose_moved._READ_UNDER_LOAD,
            correction="recomputed without pose 3",
        ),
    ),
    "pose moved between pulls": (
        lambda: of_the_pose(2, zeroed=True),
        says(
            name="outlier", where="p3_pull2", before=12.0, unit="sigma", size=0.005,
            size_unit="m", p_value=1e-4, at=("t.csv:11", "t.csv:12"), together=True,
            evidence="in pose 3 the effector moved by 5.00 mm between pull 1 and pull 2, alike in "
            "all pulls that follow and whatever their force, 12.0 standard deviations: the tracker "
            "was knocked there, or the robot moved",
            correction="recomputed without those that follow",
        ),
    ),
    "reading": (
        lambda: reading.bad_reading(one_row("g", "P1", 4), "others", 0.0125, 31.0, 1.7),
        says(
            name="outlier", where="g/P1", before=31.0, unit="sigma", size=0.0125,
            size_unit="m", p_value=1.0, at=("t.csv:4",),
            evidence="the reading g/P1 (t.csv:4) is 12.50 mm off from where others put it, 31.0 "
            "standard deviations",
            correction="recomputed without g/P1",
        ),
    ),
    "one of two readings": (
        lambda: reading.bad_reading(
            one_row("g", "P1", 4), "others", 2.0, 3.25, None, [one_row("h", "P2", 9)]
        ),
        says(
            name="outlier", where="g/P1", before=3.25, unit="sigma", size=2.0,
            size_unit="m", at=("t.csv:4", "t.csv:9"), instead=("h/P2",),
            evidence="one of g/P1 (t.csv:4), h/P2 (t.csv:9) is 2.00 m off from where others put "
            "it, 3.2 standard deviations, and nothing tells which of them it is",
            correction="recomputed without g/P1 and h/P2",
        ),
    ),
    "force": (
        lambda: of_scale(0, 130.0, 100.0, 1.0),
        says(
            name="outlier", where="f.csv pose03 rep1", before=30.0, unit="sigma",
            size=pytest.approx(30.0), size_unit="N", p_value=1e-7, at=("f.csv:7",), axes=1,
            evidence="the reading f.csv pose03 rep1 (line 7) says 130 N, and all other pulls agree "
            "with 100.0 ± 1.0 N, 30 standard deviations away; two digits exchanged, 103 N may have "
            "been meant",
            correction="recomputed without this pull",
        ),
    ),
    "force in kN, on a scale with a zero and a gain": (
        lambda: of_scale(1, 100.0, 500.0, 20.0, log=says(gain=2.0, zero_n=10.0)),
        says(
            name="outlier", where="f.csv pose03 rep2", before=20.0, unit="sigma",
            size=pytest.approx(400.0), size_unit="N", p_value=1e-7, at=("f.csv:8",), axes=1,
            evidence="the reading f.csv pose03 rep2 (line 8) says 0.21 kN, and all other pulls "
            "agree with 1.010 ± 0.040 kN, 20 standard deviations away; one digit wrong, 0.91 kN "
            "may have been meant, but 1.050 kN times 0.2 agrees as well",
            correction="recomputed without this pull",
        ),
    ),
    "mounted mass": (
        lambda: of_scale(2, 900.0, 300.0, 6.0),
        says(
            name="outlier", where="f.csv pose04 rep1", before=100.0, unit="sigma",
            size=pytest.approx(600.0), size_unit="N", p_value=1e-7, at=("f.csv:9",), axes=1,
            evidence="the reading f.csv pose04 rep1 (line 9) says spindle, 900 N, and all other "
            "pulls agree with 300.0 ± 6.0 N, 100 standard deviations away; one digit wrong, 300 N "
            "may have been meant",
            correction="recomputed without this pull",
        ),
    ),
    "hung mass": (
        lambda: of_scale(3, 40.0, 70.0, 5.0),
        says(
            name="outlier", where="f.csv pose05 rep1", before=6.0, unit="sigma",
            size=pytest.approx(3.0), size_unit="kg", p_value=1e-7, at=("f.csv:10",), axes=1,
            evidence="the reading f.csv pose05 rep1 (line 10) says 4 kg, and all other pulls agree "
            "with 7.00 ± 0.50 kg, 6 standard deviations away; one digit wrong, 7 kg may have been "
            "meant, but 6.667 kg times 0.6 agrees as well",
            correction="recomputed without this pull",
        ),
    ),
    "zero of the scale in a pose": (
        lambda: of_zero([1, 0], 40.0),
        says(
            name="outlier", where="f.csv pose03", before=20.0, unit="sigma", size=40.0,
            size_unit="N", p_value=1e-5, at=("f.csv:7", "f.csv:8"), axes=1,
            evidence="the 2 forces of pose 3 (f.csv:7–8) are 40.0 N ± 2.0 N too large, all alike, "
            "20.0 standard deviations: the scale was not zeroed there",
            correction="recomputed without these pulls",
        ),
    ),
    "zero of the scale in two poses": (
        lambda: of_zero([0, 1, 2], -40.0),
        says(
            name="outlier", where="f.csv pose03-pose04", before=20.0, unit="sigma",
            size=40.0, size_unit="N", p_value=1e-5, at=("f.csv:7", "f.csv:8", "f.csv:9"), axes=1,
            evidence="the 3 forces of poses 3 to 4 (f.csv:7–9) are 40.0 N ± 2.0 N too small, all "
            "alike, 20.0 standard deviations: the scale was not zeroed there",
            correction="recomputed without these pulls",
        ),
    ),
    "rows in kN": (
        lambda: of_unit("kn", 1, [False, False, True, True]),
        says(
            name="unit_mixup", where="kn", before=1000.0, after=1.0, unit="1",
            at=("f.csv:9", "f.csv:10"), since="f.csv:9",
            evidence="from f.csv:9 on the numbers of the scale are kN and were read as N "
            "(f.csv:9–10): these pulls moved the robot 1000 times as far per newton as the others",
            correction="recomputed with these rows times 1000",
        ),
    ),
    "rows in N": (
        lambda: of_unit("kn", -1, [True, True, False, False]),
        says(
            name="unit_mixup", where="n", before=1000.0, after=1.0, unit="1",
            at=("f.csv:7", "f.csv:8"),
            evidence="up to f.csv:8 the numbers of the scale are N and were read as kN "
            "(f.csv:7–8): these pulls moved the robot 0.001 times as far per newton as the others",
            correction="recomputed with these rows times 0.001",
        ),
    ),
    "rows in kgf or daN": (
        lambda: of_unit("kgf", 1, [True, False, True, False]),
        says(
            name="unit_mixup", where="kgf", before=9.80665, after=1.0, unit="1",
            at=("f.csv:7", "f.csv:9"), instead=("dan",),
            evidence="in 2 rows the numbers of the scale are kgf or daN and were read as N "
            "(f.csv:7, f.csv:9): these pulls moved the robot 9.807 times as far per newton as the "
            "others",
            correction="recomputed without these pulls",
        ),
    ),
    "copied rows": (
        lambda: scale_rows._of_copies(LOADS.iloc[1:3]),
        says(
            name="copied_column", where="f.csv force", before=2.0, unit="1",
            at=("f.csv:8", "f.csv:9"),
            evidence="2 pulls have the force of the row before (f.csv:8–9), which they contradict "
            "and the pull before does not: the number was copied",
            correction="recomputed without these pulls",
        ),
    ),
    "stale end": (
        lambda: stale_reading.stale(
            Some(readings=ROWS, stale=[
                Some(group="g", target="Pl2", file="t.csv", line=99, of="Pl1"),
                Some(group="g", target="Pl2", file="t.csv", line=5, of="Pl1"),
            ])
        )[0],
        says(
            name="outlier", where="g/Pl2", before=0.0, size_unit="m", at=("t.csv:99",),
            evidence="the reading g/Pl2 (t.csv:99) repeats that of Pl1 to the last "
            "digit: it was not measured again",
            correction="computed without this pull, whose direction is unknown",
        ),
    ),
    "repeated reading": (
        lambda: stale_reading._repeats("h/P1", "t.csv:6", "g", p_value=1e-8),
        says(
            name="outlier", where="h/P1", before=0.0, size_unit="m", at=("t.csv:6",), p_value=1e-8,
            evidence="the reading h/P1 (t.csv:6) repeats that of g to the last digit: it was not "
            "measured again",
            correction="recomputed without h/P1",
        ),
    ),
    "point of the tool": (
        lambda: tool_point._finding(
            DoubtfulEntry(
                "tool", ("P1",), None, np.array([0.1, -0.2, 0.04686]),
                np.array([0.1, -0.2, 0.03456]), np.array([1e-5, 3e-5, 0]), 0.9,
            )
        ),
        says(
            name="tool_point", where="P1", before=12.3, size=0.0123, size_unit="m",
            entry=("tool", "P1"),
            evidence="the target P1 is 12.3 mm from its place in [tool]: the readings place it at "
            "[0.1000, -0.2000, 0.0346] m in the flange frame, ± 0.0300 mm per axis",
            correction="recomputed with P1 at [0.1000, -0.2000, 0.0346] m",
        ),
    ),
    "unit of rows": (
        lambda: unit_since.of_unit(
            where="mm", says="so", why="why", at=("f:3", "f:4"), factor=0.001, correct=None
        ),
        says(
            name="unit_mixup", where="mm", before=1000.0, after=1.0, unit="1", at=("f:3", "f:4"),
            since="f:3", evidence="so (f:3–4): why",
            correction="recomputed with these rows times 0.001",
        ),
    ),
}  # fmt: skip


def still(run, seen, read=True, poses=False):
    """Displacements of P1 and P2 under four pulls that are `seen`, due to be 2 and 4 mm."""
    moved = np.array([[2e-3, 0, 0]] * 4 + [[0, 4e-3, 0]] * 4)
    pull = np.array([0, 1, 2, 3, 0, 1, 2, 3])
    name = np.array(["P1"] * 4 + ["P2"] * 4, object)
    data = Some(pulls=PULLS, pull=pull, name=name, delta=seen * np.ones((8, 3)), poses=poses)
    given = None if read else Some(select=lambda names: Some(to_pandas=lambda: ROWS[names]))
    settings = Some(
        **{**vars(CASE.settings), "displacements": None if read else Some(file="d.csv")}
    )
    case = Some(**{**vars(CASE), "displacements": given, "settings": settings})
    return dead_sensor._of_still(case, data, moved, np.array(run))


STILL = "The sensor was dead, or what was exported are not the loaded states"
SAID |= {
    "no displacements": (
        lambda: still(range(8), 0.0),
        says(
            name="dead_sensor", where="tracker", before=0.0, after=1.0, unit="1", hopeless=True,
            at=("t.csv:7", "t.csv:8", "t.csv:11"),
            evidence="the displacements are all exactly zero and follow the loads in no way: with "
            "its typical stiffnesses this robot would move by 1.8 mm, and none is 30 times as "
            f"stiff. {STILL}",
            correction="nothing can be corrected, no deflection was measured",
        ),
    ),
    "displacements of one target that are still": (
        lambda: still([0, 1], 3e-5),
        says(
            name="dead_sensor", where="tracker/P1", before=pytest.approx(0.015 * 3**0.5), after=1.0,
            unit="1", at=("t.csv:7", "t.csv:11"),
            evidence="2 of 8 displacements, all of P1 (t.csv:7, t.csv:11) are 0.030 mm (rms) and "
            "follow the loads in no way: with its typical stiffnesses this robot would move by "
            f"1.2 mm, and none is 30 times as stiff. {STILL}",
            correction="recomputed without these readings",
        ),
    ),
    "displacements that are given and still": (
        lambda: still([1, 5], 0.0, read=False),
        says(
            name="dead_sensor", where="d.csv", before=0.0, after=1.0, unit="1",
            evidence="2 of 8 displacements (d.csv) are all exactly zero and follow the loads in no "
            "way: with its typical stiffnesses this robot would move by 1.8 mm, and none is 30 "
            f"times as stiff. {STILL}",
            correction="recomputed without these readings",
        ),
    ),
    "poses that are still": (
        lambda: still([1], 0.0, poses=True),
        says(
            name="dead_sensor", where="tracker", before=0.0, after=1.0, unit="1",
            at=("t.csv:11", "t.csv:12"),
            evidence="1 of 8 displacements (t.csv:11–12) are all exactly zero and follow the loads "
            "in no way: with its typical stiffnesses this robot would move by 1.2 mm, and none is "
            f"30 times as stiff. {STILL}",
            correction="recomputed without these readings",
        ),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", list(SAID))
def test_a_finding_says_what_was_found(name):
    """Sentences, lines, misfits, sizes, units and probabilities, each as put in."""
    make, expected = SAID[name]
    found = record(make())

    for key in ("before", "after", "size"):
        if key in found and isinstance(expected.get(key), float):
            found[key] = round(found[key], 9)
    assert found == expected


CORRECTED = {
    "base names": ("_renamed", {"place": PLACE}),
    "base names of a round": ("renamed", {"true": PLACE, "groups": ("base_a",)}),
    "base reflector": ("_without_target", {"name": "B2"}),
    "rounds": ("_exchanged", {"pair": ("base_b", "base_a")}),
    "station": ("_with_begin", {"k": 0, "start": 5.0}),
    "chain": ("_without_group", {"group": "p3_pull1"}),
    "copied force": ("without_pulls", {"pulls": {(3, 1), (3, 2)}}),
    "one force for all": ("_unlogged", None),
    "rows of the log": ("_renumbered", {"true": {3: 5, 5: 3}, "lost": None}),
    "forces of a pose": (
        "_reloaded",
        {"true": {(3, 1): (3, 2), (3, 2): (3, 1)}, "lost": [], "anchors": False},
    ),
    "states of a pose": (
        "regrouped",
        {
            "true": {"p3_zero": "p3_pull1", "p3_pull1": "p3_zero"},
            "out": frozenset(),
            "at": tuple(f"t.csv:{k}" for k in range(5, 9)),
        },
    ),
    "loose target": ("left_out", {"at": ("t.csv:6", "t.csv:8")}),
    "names of groups": ("as_it_is", None),
    "one name twice": ("as_it_is", None),
    "names of a pose twice": ("without_poses", {"poses": [3]}),
    "pose moved behind its zero": ("left_out", {"at": ("t.csv:5", "t.csv:6")}),
    "pose moved between pulls": ("left_out", {"at": ("t.csv:11", "t.csv:12")}),
    "one of two readings": ("left_out", {"at": ("t.csv:4", "t.csv:9")}),
    "force": ("without_pulls", {"pulls": {(3, 1)}}),
    "zero of the scale in two poses": ("without_pulls", {"pulls": {(3, 1), (3, 2), (4, 1)}}),
    "rows in kN": ("_times", {"keys": {(4, 1), (5, 1)}, "factor": 1000.0}),
    "rows in N": ("_times", {"keys": {(3, 1), (3, 2)}, "factor": 0.001}),
    "rows in kgf or daN": ("without_pulls", {"pulls": {(3, 1), (4, 1)}}),
    "copied rows": ("without_pulls", {"pulls": {(3, 2), (4, 1)}}),
    "stale end": ("as_it_is", None),
    "repeated reading": ("left_out", {"at": ("t.csv:6",)}),
    "no displacements": ("as_it_is", None),
    "displacements of one target that are still": (
        "_unread",
        {"keys": [(3, 1, "P1"), (3, 2, "P1")]},
    ),
    "poses that are still": ("_unread", {"keys": [(3, 2)]}),
}


@pytest.mark.parametrize("name", list(CORRECTED))
def test_a_finding_is_corrected_by_what_it_found(name):
    """The function, and what it corrects."""
    correct = SAID[name][0]().correct
    known = getattr(correct, "keywords", None)
    if known and isinstance(known.get("keys"), pd.MultiIndex):
        known = {"keys": list(known["keys"])}

    assert (getattr(correct, "func", correct).__name__, known) == CORRECTED[name]


def test_what_belongs_nowhere_is_lost_in_the_correction():
    """The first of a ring that is no ring: its row in the log, or of the loads, is left out."""
    rows = exchanged._of_rows(CASE, np.array([5, 3]), Ring((1, 0), ended=True), APART_M2)
    assert rows.correct.keywords == {"true": {3: 5}, "lost": 3}
    loads = of_loads((2, 0, 1), ended=True)
    assert loads.correct.keywords == {
        "true": {(4, 1): (3, 1), (3, 1): (3, 2)},
        "lost": [(4, 1)],
        "anchors": False,
    }
    assert loads.where == "f.csv pose03 rep1/pose04 rep1 off by one"


def test_names_of_a_ring_are_put_back_the_other_way():
    """A reading at the place of P1 that is written as P2 is one of P1."""
    ring = {"P1": "P2", "P2": "P3", "P3": "P1"}
    found = labels._finding(CASE, "p3_pull1", ring, np.full(len(ROWS), 0.5), ROWS)
    assert found.correct.keywords["true"] == {"P2": "P1", "P3": "P2", "P1": "P3"}
    assert found.alike == "P1 and P2 and P3"
