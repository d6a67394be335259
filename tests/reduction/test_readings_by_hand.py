"""Raw readings, row by row: what each is, what is left out and why, which of them belong together.

Rows are few and written out; what becomes of each is worked out by hand.
"""

from types import SimpleNamespace as Some

import numpy as np
import pyarrow as pa
import pytest

from pipeline.base.errors import InputError
from pipeline.readers._log_table import GroupState, Log
from pipeline.readers.pose_names import coded
from pipeline.reduction import _raw_readings as raw
from pipeline.reduction._pulls import complete
from pipeline.reduction._raw_readings import BASE, STRANGE, RawReadings
from pipeline.reduction._size import _CERTAIN_FACTORS, _off, _spread, check_units
from pipeline.reduction.set_aside import kept as aside
from pipeline.reduction.settings import Naming

ROLES = {"P1": 0, "P2": 1, "A": 2, "B": 3, "B1": BASE, "B2": BASE, "X": STRANGE}
WIDTH = 4
SETTINGS = Some(
    measured=["P1", "P2"],
    naming=Some(chain=["A", "B"]),
    base_frame={"B1": (0.0, 0.0, 0.0), "B2": (2.0, 0.0, 0.0)},
    loads_file="loads.csv",
    tool={"P1": (0.0, 0.0, 0.0), "P2": (0.3, 0.4, 0.0)},
    tracker=None,
)


def readings(*rows, states=(), covariance=None, files=("t.csv",)):
    """Rows (slot, target, x [m], time [s] or None[, file]); states (pose, repeat, loaded)."""
    named = [f"g{row[0]}" if row[0] >= 0 else "base" for row in rows]
    targets = [row[1] for row in rows]
    times = [None if row[3] is None else int(row[3] * 1e9) for row in rows]
    pose, repeat, loaded = np.array([*states, (0, 0, False)]).T[:, :-1]
    return RawReadings(
        files=files,
        file=np.array([row[4] if len(row) > 4 else 0 for row in rows]),
        line=2 + np.arange(len(rows)),
        group=pa.array(named).dictionary_encode(),
        target=pa.array(targets).dictionary_encode(),
        position=np.array([[row[2], 2 * row[2], -row[2]] for row in rows], float),
        covariance=covariance,
        time=pa.array(times, pa.timestamp("ns")),
        role=np.array([ROLES[name] for name in targets]),
        slot=np.array([row[0] for row in rows]),
        pose=pose.astype(np.int64),
        repeat=repeat.astype(np.int64),
        loaded=loaded.astype(bool),
        rejected=(),
    )


STATES = ((4, 0, False), (4, 1, True), (7, 0, False), (7, 2, True))


def pose(first, *, chain=True):
    """Zero and pull of a pose, with its chain."""
    rows = [(first, "P1", 1.0, 10 * first), (first, "P2", 2.0, 10 * first + 1)]
    rows += [(first + 1, "P1", 1.1, 10 * first + 2), (first + 1, "P2", 2.1, 10 * first + 3)]
    ends = [(first + 1, "A", 3.0, 10 * first + 4), (first + 1, "B", 5.0, 10 * first + 5)]
    return rows + ends * chain


WHOLE = readings(*pose(0), *pose(2), (-1, "B1", 9.0, 100.0), (-1, "B2", 8.0, 101.0), states=STATES)


def lines(shots):
    """Lines of the readings that are left."""
    return shots.line.tolist()


def reasons(shots):
    """Line and reason of what was left out."""
    return {line: why for _, line, why in shots.rejected}


def test_readings_are_left_out_each_for_its_reason():
    """In their order, by row or by pose; base readings belong to no pose."""
    left = WHOLE.without({3: "x", 0: "y"})
    assert lines(left) == [3, 4, *range(6, 16)]
    assert left.rejected == (("t.csv", 2, "y"), ("t.csv", 5, "x"))
    assert left.without({0: "z"}).rejected[-1] == ("t.csv", 3, "z")
    assert WHOLE.without({}) is WHOLE
    of_pose = WHOLE.without_poses({7: "bad", 9: "never"})
    assert reasons(of_pose) == dict.fromkeys(range(8, 14), "bad")
    assert lines(of_pose) == [2, 3, 4, 5, 6, 7, 14, 15]
    assert [len(WHOLE), WHOLE.place(3)] == [14, "t.csv:5"]
    assert [WHOLE.named(k) for k in (0, 3)] == [
        "pose 4 repeat 0 unloaded", "pose 7 repeat 2 loaded"
    ]  # fmt: skip


def test_readings_are_counted_by_state_and_target():
    """Base reflectors are of no state."""
    shots = readings(
        (0, "P1", 1, 0), (0, "P1", 2, 0), (0, "B", 1, 0), (1, "A", 1, 0),
        (-1, "B1", 1, 0), states=STATES[:2],
    )  # fmt: skip
    assert shots.counted(4).tolist() == [[2, 0, 0, 1], [0, 0, 1, 0]]


def test_what_is_lost_is_counted_by_pose_and_by_target():
    """Poses of which no pull is left, and targets that were never read."""
    given = WHOLE
    used = given.without({6: "", 8: "", 9: "", 10: "", 11: "", 1: "", 3: ""})
    told = raw.lost(given, used, ["P1", "P2"])
    assert (told.readings, told.of, told.poses, told.absent) == (7, 14, (7,), ())
    assert raw.unused(given, used) == ("g3",)
    fewer = given.without(dict.fromkeys((1, 3, 7, 9), ""))
    assert raw.lost(given, fewer, ["P1", "P2"]).absent == ("P2",)
    assert raw.lost(given, given, ["P1", "P2"]).poses == ()


def found(names, logged=None, words=frozenset(), **naming):
    """Pose, repeat and state of groups, None where they have none."""
    slot, pose_, repeat, loaded = raw._slots(
        pa.array(names), Naming(**naming), logged or {}, frozenset(words)
    )
    return [
        None if k < 0 else (int(pose_[k]), int(repeat[k]), bool(loaded[k])) for k in slot.tolist()
    ]


def test_groups_have_pose_pull_and_state_by_their_name():
    """Or by what the log says of them; a name that does not match has none."""
    names = ["pose04_rep1_loaded", "pose04_rep0_unloaded", "base", "pose12_rep1_LOADED"]
    assert found(names[:3]) == [(4, 1, True), (4, 0, False), None]
    states = {"base": GroupState(9, 3, True, 7), "pose04_rep0_unloaded": GroupState(5, 2, False, 8)}
    assert found(names[:3], states) == [(4, 1, True), (5, 2, False), (9, 3, True)]
    own = r"P(?P<pose>[0-9]+)(?P<state>[a-z]+)(?P<repeat>[0-9]*)"
    words = {"Null": "unloaded", "Last": "loaded"}
    assert found(["P3null", "P3last2", "P3last", "P3last"], group=own, states=words) == [
        (3, 0, False), (3, 2, True), (3, 1, True), (3, 3, True)
    ]  # fmt: skip
    with pytest.raises(InputError, match='reads pose "3", state "lost", repeat ""'):
        found(["P3lost"], group=own, states=words)


@pytest.mark.parametrize(
    ("pose_", "repeat", "loaded", "counted"),
    [
        ([1, 1, 1], [-2, -2, -2], [0, 1, 1], [0, 1, 2]),
        ([1, 1, 1], [-2, 1, -2], [1, 1, 1], [2, 1, 3]),
        ([1, 2, 1], [-2, -2, 1], [1, 1, 0], [1, 1, 1]),
        ([1, 1], [5, 5], [1, 1], [5, 5]),
        ([1, 1, 1], [-2, 0, -2], [0, 0, 0], [1, 0, 2]),
    ],
)
def test_pulls_without_a_number_are_counted_beside_those_that_have_one(
    pose_, repeat, loaded, counted
):
    """Of each pose and state by itself; zeros from 0, pulls from 1."""
    told = raw._counted(np.array(pose_), np.array(repeat), np.array(loaded, bool))
    assert told.tolist() == counted


def test_parts_of_names_are_whole_numbers_below_a_limit():
    """Text and what is too large are none; a part that is missing is not numbered."""
    limit = raw.NUMBER_LIMIT
    cells = ["12", " 7 ", "x", "", str(limit), str(limit - 1), "9" * 25]
    part = pa.StructArray.from_arrays([pa.array(cells)], ["repeat"])
    told = raw._whole(part, "repeat", missing=-2)
    assert told.tolist() == [12, 7, -1, -2, -1, limit - 1, -1]
    assert raw._whole(part, "pose").tolist() == [-1] * 7
    plain = pa.StructArray.from_arrays([pa.array(["3", "0"])], ["pose"])
    assert raw._whole(plain, "pose").tolist() == [3, 0]


def test_letters_behind_a_pose_make_it_another_where_logs_have_such_poses():
    """`P04bis` is not `P04`; letters that all names have, and the state, are no part of a pose."""
    own = r"P(?P<pose>[0-9]+).*_(?P<state>loaded)"
    names = ["P04_loaded", "P04bis_loaded"]
    assert found(names, group=own) == [(4, 1, True), (4, 2, True)]
    assert found(names, words={"bis"}, group=own) == [(4, 1, True), (coded("4bis"), 1, True)]
    assert found(["P04bis_loaded", "P05bis_loaded"], words={"bis"}, group=own) == [
        (4, 1, True), (5, 1, True)
    ]  # fmt: skip
    cases = [
        ("P04bis_loaded", "bis"), ("P04_bis_loaded", "bis"), ("P04_ter_loaded", ""),
        ("P04loaded", ""), ("P04bisloaded", "bis"), ("P104_loaded", ""), ("P04", ""),
    ]  # fmt: skip
    for name, letters in cases:
        parts = {"pose": "04", "state": "loaded"}
        assert raw._letters_behind(name, parts, {"bis"}) == letters


def test_readings_of_strange_targets_and_of_no_group_are_left_out():
    """Each with what to do; a base reading needs no group."""
    shots = readings(
        (0, "P1", 1, 0), (0, "X", 1, 0), (-1, "P1", 1, 0), (-1, "B1", 1, 0), (-1, "X", 1, 0),
        states=STATES[:1],
    )  # fmt: skip
    left = raw.known(shots, SETTINGS)
    assert lines(left) == [2, 5]
    why = reasons(left)
    strange = (
        "target X is neither in naming.measured nor in naming.chain nor in [base_frame]; "
        "add it there or rename it"
    )
    assert (why[3], why[6]) == (strange, strange)
    assert why[4].startswith("the group does not match naming.group, so it holds base reflectors")
    by_log = raw.known(shots, SETTINGS, {"g": GroupState(1, 1, True, 1)})
    assert reasons(by_log)[4].startswith("loads.csv does not name the group, so")


def test_no_chain_is_read_in_a_group_that_is_at_rest():
    """In the file and line of the first; in a loaded group it is a pull."""
    shots = readings((0, "A", 1, 0), (1, "A", 1, 0), (1, "P1", 1, 0), states=STATES[:2])
    at_rest = {"g1": GroupState(4, 0, False, 12), "g0": GroupState(4, 1, True, 11)}
    with pytest.raises(InputError, match=r"group g1 has no force here, and A .*t\.csv:3") as wrong:
        raw.pulled_at_rest(shots, ["A", "B"], at_rest, "loads.csv")
    assert wrong.value.line == 12
    pulled = {name: one._replace(loaded=True) for name, one in at_rest.items()}
    raw.pulled_at_rest(shots, ["A", "B"], pulled, "loads.csv")
    raw.pulled_at_rest(shots, ["P2"], at_rest, "loads.csv")


def test_a_zero_and_a_pull_with_each_others_name_are_exchanged():
    """The zero has the chain, one pull of its pose has none; not if another zero has it, too."""
    swapped = [(0, "P1", 1.1, 0), (0, "A", 3, 1), (0, "B", 5, 2), (1, "P1", 1.0, 3)]
    right = [(2, "P1", 1, 4), (3, "P1", 1.1, 5), (3, "A", 3, 6), (3, "B", 5, 7)]
    told, pairs = raw.with_own_names(readings(*swapped, *right, states=STATES), WIDTH)
    assert told.slot.tolist() == [1, 1, 1, 0, 2, 3, 3, 3]
    assert told.group.to_pylist() == ["g1", "g1", "g1", "g0", "g2", "g3", "g3", "g3"]
    (pair,) = pairs
    assert (pair.pose, pair.groups) == (4, ("g0", "g1"))
    assert pair.at == ("t.csv:2", "t.csv:3", "t.csv:4", "t.csv:5")
    both = [(2, "P1", 1, 4), (2, "A", 3, 5), (2, "B", 5, 6), (3, "P1", 1.1, 7), (3, "A", 3, 8)]
    for rows in ([*swapped, *both], [*swapped[:2], swapped[3], *right]):
        shots = readings(*rows, states=STATES)
        assert raw.with_own_names(shots, WIDTH) == (shots, ())
    more = ((4, 0, False), (4, 1, True), (4, 2, True))
    shots = readings(*swapped, (2, "P1", 1.2, 9), states=more)
    assert raw.with_own_names(shots, WIDTH)[1] == ()


def test_zeros_before_and_after_the_pulls_are_rounds_of_their_own():
    """By the clock, or by the rows where a time is missing; a copy is no round."""
    rows = [(0, "P1", 1.0, 0), (0, "P2", 2.0, 1), (1, "P1", 1.1, 5)]
    rows += [(0, "P1", 1.001, 9), (0, "P2", 2.001, 10)]
    told = raw.in_rounds(readings(*rows, states=STATES[:2]), WIDTH)
    assert told.slot.tolist() == [0, 0, 1, 2, 2]
    assert (told.pose.tolist(), told.repeat.tolist()) == ([4, 4, 4], [0, 1, 2])
    assert told.loaded.tolist() == [False, True, False]
    mixed = [rows[k] for k in (3, 2, 0, 4, 1)]
    told = raw.in_rounds(readings(*mixed, states=STATES[:2]), WIDTH)
    assert told.slot.tolist() == [2, 1, 0, 2, 0]
    untimed = [(*row[:3], None) for row in rows]
    assert raw.in_rounds(readings(*untimed, states=STATES[:2]), WIDTH).slot.tolist() == [
        0, 0, 1, 2, 2
    ]  # fmt: skip
    together = [rows[0], rows[1], (0, "P1", 1.001, 2), (1, "P1", 1.1, 5)]
    assert raw.in_rounds(readings(*together, states=STATES[:2]), WIDTH).slot.tolist() == [
        0, 0, 0, 1
    ]  # fmt: skip
    copied = [*rows[:3], (0, "P1", 1.0, 9), rows[4]]
    assert raw.in_rounds(readings(*copied, states=STATES[:2]), WIDTH).slot.tolist() == [
        0, 0, 1, 0, 0
    ]  # fmt: skip
    thrice = [*rows, (1, "P2", 2.1, 11), (0, "P1", 1.002, 12)]
    told = raw.in_rounds(readings(*thrice, states=STATES[:2]), WIDTH)
    assert told.slot.tolist() == [0, 0, 1, 2, 2, 1, 3]
    assert told.repeat.tolist() == [0, 1, 2, 3]
    assert raw._rounds(np.array([1, 1, 2, 3, 3]), np.array([0, 1, 2, 0, 3])).tolist() == [
        0, 0, 0, 1, 1
    ]  # fmt: skip


def test_repeated_readings_are_used_once_and_contradicting_ones_never():
    """Of equal ones the first; base reflectors may be read again, but not be copied."""
    shots = readings(
        (0, "P1", 1.0, 0), (0, "P1", 1.0, 1), (0, "P2", 2.0, 2), (0, "P2", 2.5, 3),
        (0, "P2", 2.0, 4), (1, "P1", 1.0, 5), (-1, "B1", 9.0, 6), (-1, "B1", 9.0, 6),
        (-1, "B1", 9.0, 7), (-1, "B2", 9.0, 6), (1, "A", 3.0, 8), states=STATES[:2],
    )  # fmt: skip
    told = raw.once(shots, WIDTH)
    assert lines(told) == [2, 7, 8, 10, 11, 12]
    why = reasons(told)
    assert why[3] == "repeats t.csv:2; remove one of them"
    assert why[9] == "repeats t.csv:8; remove one of them"
    again = "the same target in the same state; keep the right one"
    assert why[4] == f"contradicts t.csv:5, {again}"
    assert why[5] == why[6] == f"contradicts t.csv:4, {again}"
    (one,) = raw.contradictions(shots, WIDTH)
    assert (one.pose, one.group, one.target) == (4, "g0", "P2")
    assert one.at == ("t.csv:4", "t.csv:5", "t.csv:6")
    assert one.apart_m == pytest.approx(0.5 * np.sqrt(6))


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ((0, "P2", 1.0, 1), True),
        ((0, "P2", 1.1, 1), False),
        ((0, "P1", 1.0, 1), False),
        ((1, "P2", 1.0, 1), False),
        ((0, "P2", 1.0, 1, 1), False),
    ],
)
def test_a_row_that_repeats_the_one_before_is_stale(second, said):
    """Of another target of the same state and file."""
    shots = readings((0, "P1", 1.0, 0), second, states=STATES[:2], files=("t.csv", "u.csv"))
    told = raw.stale(shots)
    assert len(told) == said
    for one in told:
        assert (one.group, one.target, one.of) == ("g0", "P2", "P1")
        assert (one.file, one.line) == ("t.csv", 3)
    base = readings((-1, "B1", 1.0, 0), (-1, "B2", 1.0, 1))
    assert raw.stale(base) == ()


def test_readings_without_an_uncertainty_go_if_others_have_one():
    """Of targets and chain; not if campaign.toml states a noise, nor if none has one."""
    C = np.full((4, 6), 1e-10)
    C[1, 3] = np.nan
    C[3] = np.nan
    rows = ((0, "P1", 1, 0), (0, "P2", 2, 0), (0, "A", 3, 0), (-1, "B1", 9, 0))
    shots = readings(*rows, states=STATES[:1], covariance=C)
    assert list(reasons(raw.weighed(shots, False))) == [3]
    assert raw.weighed(shots, True) is shots
    bare = readings(*rows, states=STATES[:1])
    assert raw.weighed(bare, False) is bare
    only_base = np.full((4, 6), np.nan)
    only_base[3] = 1e-10
    lone = readings(*rows, states=STATES[:1], covariance=only_base)
    assert raw.weighed(lone, False) is lone


def log(file, **number):
    """A log with these columns, lines from 2."""
    columns = {name: np.array(values, float) for name, values in number.items()}
    return Log(file, columns, {}, 2 + np.arange(len(number["pose"])), ())


def used(shots, loads=None, joints=None):
    """Lines and reasons of readings, and of rows of loads."""
    loads = loads or log("loads.csv", pose=[4, 7], repeat=[1, 2], force=[100.0, 200.0])
    joints = joints or log("joints.csv", pose=[4, 7])
    left, rows = complete(shots, SETTINGS, loads, joints)
    return reasons(left), rows.line.tolist(), {line: why for _, line, why in rows.rejected}


def test_a_whole_campaign_loses_nothing():
    """Every pull has zero, chain, force and joints."""
    assert used(WHOLE) == ({}, [2, 3], {})


def cut(*rows):
    """The whole campaign without some rows."""
    keep = np.ones(len(WHOLE), bool)
    keep[list(rows)] = False
    return WHOLE.kept(keep)


UNREAD = "has no usable loaded tracker reading; measure it or remove the row"


@pytest.mark.parametrize(
    ("shots", "logs", "out", "why", "load"),
    [
        (cut(4), {}, [4, 5, 7],
         "pose 4 repeat 1 has no loaded reading of A, so the direction of the pull is unknown; "
         "measure it", "same"),
        (cut(5), {}, [4, 5, 6],
         "pose 4 repeat 1 has no loaded reading of B, so the direction of the pull is unknown; "
         "measure it", "same"),
        (cut(0, 1), {}, [4, 5, 6, 7],
         "pose 4 has no unloaded reading; measure its zero or correct its group", "same"),
        (cut(0, 3), {}, [4, 6, 7],
         "pose 4 repeat 1 has no target read both unloaded and loaded; measure it", "same"),
        (WHOLE, {"joints": log("joints.csv", pose=[7])}, [2, 3, 4, 5, 6, 7],
         "pose 4 has no row in joints.csv; add its joint values", "same"),
        (WHOLE, {"loads": log("loads.csv", pose=[7], repeat=[2], force=[1.0])}, [4, 5, 6, 7],
         "pose 4 repeat 1 has no force in loads.csv; add the row", None),
        (cut(2, 3, 4, 5), {}, [], "", f"pose 4 repeat 1 {UNREAD}"),
        (cut(1), {}, [5], "P2 was not read unloaded in pose 4; measure its zero", None),
    ],
)  # fmt: skip
def test_what_lacks_its_counterpart_is_left_out(shots, logs, out, why, load):
    """Chain, zero, joints, force, a target in both states, and the row of the load with it."""
    lost, rows, of_rows = used(shots, **logs)
    assert lost == dict.fromkeys(out, why)
    if load is None:
        assert of_rows == {}
    else:
        assert of_rows == {2: why if load == "same" else load}
        assert rows == [3]


def test_weights_need_no_chain_and_a_chain_has_two_ends():
    """A load without a force is a weight; ends in one place are one reading entered twice."""
    hung = log("loads.csv", pose=[4, 7], repeat=[1, 2], force=[np.nan, 200.0])
    assert used(cut(4, 5), loads=hung)[0] == {}
    rows = [*pose(0)[:5], (1, "B", 3.0 + 4e-7, 5), *pose(2)]
    lost, *_ = used(readings(*rows, states=STATES))
    assert lost == dict.fromkeys(
        [4, 5, 6, 7], "pose 4 repeat 1 has no distance between A and B; measure them again"
    )
    rows[5] = (1, "B", 3.0 + 6e-7, 5)
    assert used(readings(*rows, states=STATES))[0] == {}
    lone = log("loads.csv", pose=[7], repeat=[2], force=[200.0])
    lost, *_ = used(cut(4), loads=lone)
    assert lost[4].startswith("pose 4 repeat 1 has no loaded reading of A")


def set_aside(name, **more):
    """Lines of readings and of both logs that stay."""
    loads = log("loads.csv", pose=[4, 7, 7], repeat=[1, 2, 3], force=[1.0, 2.0, 3.0])
    joints = log("joints.csv", pose=[4, 7])
    shots, (left, rest), told = aside(WHOLE, [loads, joints], {name: "why"}, {}, WIDTH)
    (one,) = told
    assert (one.name, one.reason, one.readings) == (name, "why", len(WHOLE) - len(shots))
    gone = sorted({*lines(WHOLE)} - {*lines(shots)})
    return gone, left.line.tolist(), rest.line.tolist()


@pytest.mark.parametrize(
    ("name", "gone", "loads", "joints"),
    [
        ("g1", [4, 5, 6, 7], [3, 4], [2, 3]),
        ("g0", [2, 3, 4, 5, 6, 7], [3, 4], [3]),
        ("pose 7", [8, 9, 10, 11, 12, 13], [2], [2]),
        ("Pose 7 pull 2", [10, 11, 12, 13], [2, 4], [2, 3]),
        ("pose 7 repeat 3", [], [2, 3], [2, 3]),
        ("t.csv:6", [4, 5, 6, 7], [3, 4], [2, 3]),
        ("t.csv:2", [2, 4], [2, 3, 4], [2, 3]),
        ("g1/P1", [4], [2, 3, 4], [2, 3]),
        ("P2", [3, 5, 9, 11], [2, 3, 4], [2, 3]),
        ("A", [4, 5, 6, 7, 10, 11, 12, 13], [4], [2, 3]),
        ("B1", [14], [2, 3, 4], [2, 3]),
        ("loads.csv:2", [4, 5, 6, 7], [3, 4], [2, 3]),
        ("joints.csv:3", [8, 9, 10, 11, 12, 13], [2], [2]),
    ],
)
def test_what_is_set_aside_goes_with_what_needs_it(name, gone, loads, joints):
    """A pull with its chain, its targets with their zero, a pose with its rows of both logs."""
    assert set_aside(name) == (gone, loads, joints)


def test_a_name_that_nothing_has_is_refused():
    """With one that is near, or with what a name may be."""
    for name, said in (("g11", "is it g1"), ("quite another", "write a group, a target")):
        with pytest.raises(InputError, match=f"names.*{name}") as wrong:
            set_aside(name)
        assert said in str(wrong.value)


def scaled_(factor, files=1, wrong=(0,), target=False):
    """Unloaded readings of two poses in each file, in some of them too large by a factor."""
    rows = []
    for file in range(files):
        f = factor if file in wrong else 1.0
        for slot in (0, 2):
            rows += [(slot, "P1", 0.0, 0, file), (slot, "P2", f * 0.5 / np.sqrt(6), 1, file)]
    names = tuple(f"{k}.csv" for k in range(files))
    return readings(*rows, states=STATES, files=names)


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1e3, "1000 times too large, as if millimetres were taken for metres"),
     (1e-3, "1000 times too small, as if metres were taken for millimetres"),
     (25.4, "25.4 times too large, as if millimetres were taken for inches"),
     (1 / 25.4, "25.4 times too small, as if inches were taken for millimetres"),
     (1e3 / 25.4, "39.4 times too large, as if inches were taken for metres")],
)  # fmt: skip
def test_a_wrong_unit_is_found_by_the_size_of_the_tool(factor, said):
    """Within a fifth of a factor that only a unit explains; in the file that has it."""
    for off in (0.85, 1.0, 1.2):
        with pytest.raises(InputError, match=said):
            check_units(scaled_(factor * off), SETTINGS)
    for off in (0.8, 1.25):
        check_units(scaled_(factor * off), SETTINGS)
    check_units(scaled_(1.0), SETTINGS)
    with pytest.raises(InputError, match=said) as wrong:
        check_units(scaled_(factor, 3, (1,)), SETTINGS)
    assert wrong.value.file == "1.csv"


def test_a_table_in_inches_is_not_the_exports_fault():
    """If every file says so and states its own unit."""
    inches = 25.4 / 1000
    with pytest.raises(InputError, match=r"\[tool\] is in inches: .* 39.4 times too large"):
        check_units(scaled_(inches), SETTINGS)
    stated = Some(**vars(SETTINGS) | {"tracker": Some(unit="m")})
    with pytest.raises(InputError, match="as if metres were taken for inches"):
        check_units(scaled_(inches), stated)
    with pytest.raises(InputError, match="as if metres were taken for inches"):
        check_units(scaled_(inches, 2, (0,)), SETTINGS)
    with pytest.raises(InputError, match="is in inches"):
        check_units(scaled_(inches, 2, (0, 1)), SETTINGS)
    base = readings((-1, "B1", 0.0, 0), (-1, "B2", 2000 / np.sqrt(6), 1), states=STATES)
    with pytest.raises(InputError, match=r"1000 times too large.*of those in \[base_frame\]"):
        check_units(base, SETTINGS)
    assert [_off(f) for f in (1000.0, 1 / 25.4)] == ["1000 times too large", "25.4 times too small"]
    assert len(_CERTAIN_FACTORS) == 6


def test_the_spread_of_a_set_is_that_about_its_mean():
    """Summed over points and axes."""
    rng = np.random.default_rng(2)
    points, member = rng.normal(size=(7, 3)), np.array([0, 1, 0, 2, 1, 0, 1])
    expected = [
        np.sqrt(np.sum((p - p.mean(0)) ** 2)) for k in range(3) for p in [points[member == k]]
    ]
    np.testing.assert_allclose(_spread(points, member), expected, atol=1e-15)
