"""Parts of the tests of faults, from tables of a few rows and numbers put in by hand."""

from dataclasses import dataclass
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest

from pipeline.faults import (
    chain,
    conventions,
    dead_sensor,
    exchanged_pulls,
    joint_row,
    labels,
    mistake,
    placement,
    pull,
    reading,
    stale_reading,
    unit_since,
)
from pipeline.faults.assignment import Ring
from pipeline.faults.entries import DoubtfulEntry
from pipeline.machine.effect import HUNG, PULLED
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.measured import STILL_M
from pipeline.reduction.settings import Scale
from pipeline.system.simultaneous import cost

XYZ = ["x_m", "y_m", "z_m"]


@pytest.mark.parametrize(
    ("near", "far", "spread", "alike"),
    [
        (0.95, 0.15, 0.0, True),
        (0.95, 0.17, 0.0, True),  # 20 mm are no gross distance
        (0.95, 0.19, 0.0, False),
        (0.99, 0.15, 0.0, False),
        (0.95, 0.19, 0.01, True),  # ten times what is usual
        (0.95, 0.26, 0.01, False),
    ],
)
def test_an_exchange_leaves_both_ends_hung_as_usual(near, far, spread, alike):
    """Ends 0.15 and 0.95 m from the load point in five pulls, the sixth is read the other way."""
    off = spread * np.array([-1, 1, 0, 1, -1])
    table = pd.DataFrame(
        {
            "pose": [1, 1, 2, 2, 3, 4],
            "near": [*(0.15 + off), near],
            "far": [*(0.95 + off), far],
        }
    )
    turned = np.arange(6) == 5
    assert labels._hung_alike(table, turned).tolist() == [True] * 5 + [alike]
    assert GROSS_DISTANCE_M == 0.03


def test_a_pull_hung_as_the_others_of_its_pose_is_hung_alike():
    """Though those of other poses hang otherwise."""
    table = pd.DataFrame(
        {"pose": [1, 1, 1, 2, 2, 2, 2], "near": [0.15] * 3 + [0.4, 0.4, 0.4, 1.5],
         "far": [0.95] * 3 + [1.5, 1.5, 1.5, 0.4]}
    )  # fmt: skip
    assert labels._hung_alike(table, np.arange(7) == 6).all()


@pytest.mark.parametrize(
    ("stated", "off", "expected"),
    [
        (2e-3, [1e-3, 3e-3], 1e-3),  # zeros repeat better than stated
        (2e-4, [1e-3, 3e-3], 2e-4),
        (2e-3, [], 2e-3),  # nothing repeated
        (np.nan, [1e-3, 3e-3], 2e-3),  # the median of 1, 1, 1, 3, 3, 3
        (np.nan, [], 5e-5),
        (1e-6, [1e-3], 5e-5),
    ],
)
def test_the_scatter_of_digits_is_the_smaller_of_what_is_stated_and_seen(stated, off, expected):
    """Differences of repeated zeros, equal ones left out; nowhere below the last digit."""
    at = np.cumsum([0.0, *off, 0.0])
    still = pd.DataFrame({"at": 1, "target": "P1", **dict.fromkeys(XYZ, at)})
    C = {name: stated**2 if name[1] == name[2] else 0.0 for name in
         ("cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2")}  # fmt: skip
    found = stale_reading._scatter(pd.DataFrame([C, C]), still, 5e-5)
    if np.isfinite(stated) and len(off) == 2:
        expected = min(stated, 2e-3)
    np.testing.assert_allclose(found, np.full((2, 3), expected))


def test_a_group_without_extent_is_too_small_by_its_extent_over_a_micrometre():
    """Two targets 2 mm apart: 1 mm rms from their centre; one target, or none, has no extent."""
    places = {"P1": (0.0, 0, 0), "P2": (0.0, 0, 2e-3)}
    names, at = np.array(["P1", "P2", "B1", "P1"], object), np.zeros((4, 3))
    assert unit_since._too_small(places, names, at) == pytest.approx(1e-3 / STILL_M)
    at[1, 0], at[3] = 4e-3, 9.0  # of a target read twice the first
    assert unit_since._too_small(places, names, at) == pytest.approx(0.5)
    assert np.isnan(unit_since._too_small(places, names[[0, 2, 3]], at[:3]))
    assert np.isnan(unit_since._too_small({}, names, at))


class Pulls(Some):
    """Pulls with a number."""

    def __len__(self):
        return len(self.pose)


def scale(force, implied, by=PULLED):
    """A campaign of single pulls, read as `force` [N], that moved the robot as `implied` ones."""
    m = len(force)
    pulls = Pulls(pose=np.arange(m), repeat=np.ones(m, int), by=np.full(m, by),
                 force=np.array(force, float)[:, None] * [[0, 0.6, 0.8]])  # fmt: skip
    moved = np.array(force, float)[:, None] * [[1e-6, 0, 2e-6]]
    delta = np.array(implied, float)[:, None] * [[1e-6, 0, 2e-6]]
    data = Some(pulls=pulls, pull=np.arange(m), target=np.zeros(m, int), delta=delta)
    loads = pd.DataFrame(
        {"pose": np.arange(m), "repeat": 1, "file": "f.csv", "line": np.arange(m) + 2}
    )
    rows = pd.DataFrame({"pose": np.arange(m), "repeat": 1, "state": "loaded"})
    return Some(loads=loads, readings=rows), data, moved


GIVEN = [900.0, 1500, 2100, 1200, 1800, 2000, 1000]


def test_a_scale_that_shows_nothing_in_some_pulls_was_dead():
    """Two and a half newtons where the robot moved as by thousands."""
    force = [*GIVEN[:2], 2.5, 2.5, 2.5, 2.5, GIVEN[6]]
    (found,) = dead_sensor._silent(*scale(force, GIVEN))

    meant = np.sqrt(np.mean(np.square(GIVEN[2:6])))  # 1807 N
    assert found.evidence == (
        "4 pulls have forces of 2.5 N (rms; f.csv:4–7), and moved the robot as 1800 N would with "
        "its typical stiffnesses: none is 30 times as compliant. The scale was dead"
    )
    assert found.before == pytest.approx(2.5 / meant)
    assert (found.name, found.where, found.after) == ("dead_sensor", "f.csv force", 1.0)
    assert found.at == ("f.csv:4", "f.csv:5", "f.csv:6", "f.csv:7")
    assert found.correct.keywords == {"pulls": {(k, 1) for k in range(2, 6)}}


@pytest.mark.parametrize(
    ("force", "implied"),
    [
        (GIVEN, GIVEN),
        ([*GIVEN[:2], 2.5, 2.5, *GIVEN[4:]], GIVEN),  # two pulls are too few
        ([2.5] * 7, GIVEN),  # all of them may be in another unit
        ([*GIVEN[:2], 2.1, 1.2, 1.8, 2.0, GIVEN[6]], GIVEN),  # some in kN follow the motion
        ([*GIVEN[:2], 90.0, 90.0, 90.0, 90.0, GIVEN[6]], GIVEN),  # a twentieth is not nothing
        ([*GIVEN[:2], 2.5, 2.5, 2.5, 2.5, GIVEN[6]], [*GIVEN[:2], *[9e5] * 4, GIVEN[6]]),
    ],
)
def test_other_small_forces_are_no_dead_scale(force, implied):
    """Nor is a motion that no pull causes."""
    assert [*dead_sensor._silent(*scale(force, implied))] == []


def test_without_loads_and_without_a_scale_none_was_dead():
    """Forces as given, or weights."""
    case, data, moved = scale([*GIVEN[:2], 2.5, 2.5, 2.5, 2.5, GIVEN[6]], GIVEN)
    assert [*dead_sensor._silent(Some(**{**vars(case), "loads": []}), data, moved)] == []
    weights = scale([*GIVEN[:2], 2.5, 2.5, 2.5, 2.5, GIVEN[6]], GIVEN, HUNG)
    assert [*dead_sensor._silent(*weights)] == []


@pytest.mark.parametrize(
    ("f", "g", "related"),
    [
        ([1.0, 2, 3, 4], [10.0, 20, 30, 40.1], True),
        ([1.0, 2, 3, 4], [-10.0, -20, -30, -40.1], True),
        ([1.0, 2, 3, 4], [5.0, 4, 4, 5], False),
        ([1.0, 1, 1, 1], [1.0, 2, 3, 4], False),
        ([1.0, 2, 3, 4], [2.0, 2, 2, 2], False),
    ],
)
def test_readings_follow_others_beyond_chance_or_not(f, g, related):
    """By their correlation, whatever its sign; what is constant follows nothing."""
    assert dead_sensor._correlated(np.array(f), np.array(g)) == related


def test_turns_of_a_frame_in_words():
    """Right angles have a sign, half turns have none; others have no axis."""
    said = {how for _, how in conventions._as_turned("base_frame")}
    x, y = np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1])
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    ring = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])

    assert len(said) == len(conventions._TURNS) == 47
    assert conventions._turn(x, "F_b") == "turned by 180 deg about x of F_b"
    assert conventions._turn(y, "F_b") == "turned by 180 deg about y of F_b"
    assert conventions._turn(quarter, "F_b") == "turned by 90 deg about z of F_b"
    assert conventions._turn(quarter.T, "F_b") == "turned by -90 deg about z of F_b"
    assert conventions._turn(ring, "F_b") == "turned by 120 deg of F_b"
    assert conventions._turn(-np.eye(3), "F_b") == "mirrored"
    assert conventions._turn(-quarter, "F_b") == "turned by 90 deg about z of F_b and mirrored"
    assert ", turned by 90 deg about z of F_b: [x, y, z] there is [-y, x, z] here" in said
    tool = [how for _, how in conventions._as_turned("tool")]
    assert (
        ", maybe the controller's, turned by 180 deg about z of the flange: [x, y, z] there is "
        "[-x, -y, z] here"
    ) in tool


@pytest.mark.parametrize(
    ("weights", "reduced", "share", "said"),
    [
        (True, False, None, (
            "weights pull the other way than [gravity] states: 5 of 6 clear compliances are "
            "negative, the robot would move against them",
            "recomputed with weights pulling the other way in F_b")),
        (False, False, 0.75, (
            "the pull is reversed: 5 of 6 clear compliances are negative, the robot would move "
            "against the force, and in 75% of the pulls the first end is farther from the load "
            "point", "recomputed with Pl1 and Pl2 exchanged")),
        (False, False, None, (
            "the pull is reversed: 5 of 6 clear compliances are negative, the robot would move "
            "against the force", "recomputed with Pl1 and Pl2 exchanged")),
        (False, True, None, (
            "the pull is reversed: 5 of 6 clear compliances are negative, the robot would move "
            "against the force", "recomputed with all forces reversed")),
    ],
)  # fmt: skip
def test_a_reversed_pull_in_words(weights, reduced, share, said):
    """Of weights, of a chain, and of forces as given."""
    settings = Some(naming=Some(chain=["Pl1", "Pl2"]), displacements=Some() if reduced else None)
    loads = pd.DataFrame({"force_n": [np.nan if weights else 3.0, np.nan]})
    case = Some(settings=settings, loads=loads.iloc[:0] if reduced else loads)
    assert pull._reversed(case, 5, 6, share) == said


def test_lengths_and_deviations_in_words():
    """Two digits below ten standard deviations, three above, none beyond a thousand."""
    assert mistake.length(1.0) == "1.00 m"
    assert mistake.length(0.99996) == "999.96 mm"
    assert mistake.apart(9.94) == "9.9 standard deviations"
    assert mistake.apart(10.0) == "10.0 standard deviations"
    assert mistake.apart(999.6) == "1000 standard deviations"
    assert mistake.apart(1000.1) == "more than 1000 standard deviations"
    assert joint_row._mm(0.1) == "100 mm"
    assert joint_row._mm(0.0999) == "100 mm"
    assert joint_row._mm(0.01234) == "12 mm"
    assert chain._told_direction(0.0123, 12.3) == (
        "the chain's direction deviates by 12.3 ± 1.0 mrad from that of the other pulls of the "
        "pose, 12.3 standard deviations"
    )


def test_a_mistake_that_leaves_too_little_is_hopeless():
    """And what a single reading of the tracker is, that noise may explain."""
    one = mistake.outlying("g/P1", "off", "out", before=5.0, correct=None, p_value=3.0)
    assert one.p_value == 1.0
    assert (one.of_reading, one.may_be_noise, one.hopeless) == (True, True, False)
    lost = one.lost
    assert (lost.hopeless, lost.correct, lost.before) == (True, mistake.as_it_is, 5.0)
    assert lost.correction.startswith("nothing can be corrected, too few displacements are left")
    for known in ({"size_unit": "N"}, {"name": "exchanged"}):
        other = mistake.outlying("g", "", "", before=1.0, correct=None, p_value=0.1, **known)
        assert (other.of_reading, other.may_be_noise) == (False, False)
    for known in ({"together": True}, {"unit": "mm"}, {"p_value": None}):
        known = {"p_value": 0.1, **known}
        other = mistake.outlying("g", "", "", before=1.0, correct=None, **known)
        assert (other.of_reading, other.may_be_noise) == (True, False)


@pytest.mark.parametrize(
    ("rows", "most"),
    [
        ((0, 1, 2, 9), False),
        ((0, 2, 4, 6, 9), False),  # five of ten rows
        ((0, 2, 4, 6, 8), True),  # of nine
        ((5, 6, 8, 10, 13, 15), True),  # six of eleven
    ],
)
def test_most_rows_stand_elsewhere_by_their_number_between_first_and_last(monkeypatch, rows, most):
    """In the order of the log, whatever that of the pulls."""
    asked_, ring = [], Ring(tuple(15 - k for k in rows))
    loads = pd.DataFrame({"pose": np.arange(16), "repeat": 1})
    pulls = Some(pose=np.arange(16)[::-1], repeat=np.ones(16, int))
    asked = Some(case=Some(loads=loads), reduced=Some(data=Some(pulls=pulls)))
    moved = Some(pull=np.arange(16), force=np.ones(16), least=9.0)
    fit = Some(cost=np.zeros((16, 16)))

    def happens(one, pose, most):
        asked_.append((one, pose.tolist(), most))
        return True

    monkeypatch.setattr(exchanged_pulls, "_orders", lambda *_: [[ring]])
    monkeypatch.setattr(exchanged_pulls, "_fitting", lambda *_: fit)
    monkeypatch.setattr(exchanged_pulls, "_happens", happens)
    for name in ("_changes", "_both"):
        monkeypatch.setattr(exchanged_pulls, name, lambda *_: True)
    monkeypatch.setattr(exchanged_pulls, "of_loads", lambda *given: given[3])

    (one,) = exchanged_pulls._loads(asked, moved, None)
    assert asked_ == [(ring, pulls.pose.tolist(), most)]
    assert one == ring


def test_the_order_that_leaves_fewest_forces_unexplained_is_taken(monkeypatch):
    """What has no force counts for neither; of equals that of fewest moves, then the next."""
    m = 6
    loads = pd.DataFrame({"pose": np.arange(m), "repeat": 1})
    pulls = Some(pose=np.arange(m), repeat=np.ones(m, int))
    asked = Some(case=Some(loads=loads), reduced=Some(data=Some(pulls=pulls)))
    moved = Some(pull=np.arange(m), force=np.ones(m), least=9.0)
    bad = np.full((m, m), 10.0)
    two, ended = Ring((0, 1)), Ring((2, 3), ended=True)
    some = np.where(np.arange(m) < 2, 10.0, 0.0) * np.ones((m, m))
    orders = [(Some(cost=bad), [two]), (Some(cost=some.T), [two]), (Some(cost=some), [ended])]
    monkeypatch.setattr(exchanged_pulls, "_orders", lambda *_: [[], *(one for _, one in orders)])
    for name in ("_happens", "_changes"):
        monkeypatch.setattr(exchanged_pulls, name, lambda *_, **__: True)
    monkeypatch.setattr(exchanged_pulls, "of_loads", lambda *given: (given[2], given[3]))

    for allowed in ([0, 1, 2], [0, 2], [0], []):
        kept = [orders[k][0] for k in allowed]
        monkeypatch.setattr(
            exchanged_pulls, "_both", lambda fit, *_, kept=kept: any(fit is one for one in kept)
        )
        fits = iter(orders)
        monkeypatch.setattr(exchanged_pulls, "_fitting", lambda *_, fits=fits: next(fits)[0])
        found = exchanged_pulls._loads(asked, moved, None)
        first = next((k for k in (2, 1, 0) if k in allowed), None)
        assert found == ([] if first is None else [(orders[first][0], orders[first][1][0])])


@pytest.mark.parametrize(
    ("gains", "moved"),
    [
        ({4: -1.0, 5: -2.0, 9: -1.0}, set()),
        ({4: -1.0, 5: 0.5, 9: -1.0}, {5}),
        ({4: 0.7, 5: 0.5, 9: 0.1}, {4, 9}),
        ({4: 0.0, 5: -1.0, 9: 0.1}, {9}),
    ],
)
def test_of_each_pose_the_state_that_moved_most_surely_moved(monkeypatch, gains, moved):
    """Two pulls of a pose, in the second of which two targets are off, and a zero of another."""
    pose, pull = np.zeros(10, int), np.full(10, 7)
    pose[[4, 5, 6, 9]], pull[[4, 5, 6, 9]] = (3, 3, 3, 8), (0, 1, 1, -1)
    asked, held = [], Some(which=np.array([4, 5, 6, 9]), variance=2.0)

    class Beside:
        """A base of four rows, which knows beside what it is."""

        def __init__(self, others=()):
            self.others = tuple(others)

        def more(self, others):
            """Beside other readings, too."""
            return Beside(others)

        def beside_all(self, columns):
            """All at once: the first reading of each state moves a row."""
            return self.others, columns.astype(int)[0].tolist()

    shifted = Some(
        readings=Some(pose=pose, pull=pull, nth=np.zeros(10, int)),
        _rigid=lambda base, k: np.full((4, 6), k),
    )

    def rows(base, which):
        """What is held beside, as it is; columns of the readings of a pose, three of each."""
        return np.repeat(np.ones((4, 1)) * which, 3, axis=1) if base.others else tuple(which)

    suspects = Some(rows=rows)

    def as_one(every, mode, own, variance):
        asked.append((every[0], mode.tolist(), own.tolist(), variance))
        first = every[1][mode[0]]
        return gains[first]

    monkeypatch.setattr(reading, "_as_one", as_one)
    found = reading.Shifted._moved_as_a_whole(shifted, held, Beside(), suspects)

    assert found == moved
    assert [one[1][0] for one in asked] == [0, 6, 0]
    assert [len(one[2]) for one in asked] == [3, 3, 1]
    assert asked[0][2] == [[12, 13, 14], [15, 16, 17], [18, 19, 20]]
    assert {one[3] for one in asked} == {2.0}


LOG = pd.DataFrame(
    {"pose": [1, 2, 3, 4], "file": "j.csv", "line": [2, 3, 4, 5],
     "theta1_deg": [1.0, 2.0, 3.0, 1.0], "theta2_deg": [5.0, 6.0, 7.0, 5.0]}
)  # fmt: skip


def test_a_wrong_row_of_the_log_in_words():
    """By the rms of its unloaded reflectors, 300 mm, and of those of the other good poses, 1 mm."""
    pose = np.array([0, 0, 1, 1, 2, 3, 3])
    zero = np.array([True, True, True, True, True, True, False])
    away = np.array([0.18, 0.24, 1e-3, 1e-3, 0.5, 1e-3, 9.0])[:, None] * [1.0, 0, 0]
    away[:2] *= np.sqrt(2)
    read = Some(poses=np.array([1, 2, 3, 4]), pose=pose, zero=zero)
    laid = Some(away=away, apart=np.array([True, False, True, False]))
    case = Some(joints=LOG, joint_columns=["theta1_deg", "theta2_deg"])
    found = joint_row._finding(case, read, laid, 0)

    assert found.evidence == (
        "the row of pose 1 in the joint log (j.csv:2) does not match its readings but repeats that "
        "of pose 4: the unloaded reflectors are 300 mm from where it places them, those of the "
        "other poses 1.0 mm"
    )
    assert (found.where, found.at, found.unit) == ("j.csv pose01", ("j.csv:2",), "mm")
    assert (found.before, found.after, found.size) == pytest.approx((300.0, 1.0, 0.3))
    assert found.correct.keywords == {"poses": [1]}
    assert found.correction == "recomputed without pose 1"
    assert joint_row._same(case, LOG.iloc[1]) == ""


def test_a_frame_that_is_another_one_in_words(monkeypatch):
    """Turned by a right angle about z and shifted by half a metre; or without [base_frame]."""
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    expected = np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3], [1, 1, 1]])
    shift = np.array([0.3, 0.0, 0.4])
    seen = (expected - shift) @ turn  # where it has to be turned from
    monkeypatch.setattr(placement, "not_rigid", lambda case: None)
    monkeypatch.setattr(placement, "miss", lambda case, fewest: 0.002)
    monkeypatch.setattr(placement, "unloaded", lambda case: "zeros")
    monkeypatch.setattr(placement, "pairs", lambda case, zeros: (seen, expected, None))
    monkeypatch.setattr(placement, "anchored", lambda case: (np.eye(3), np.zeros(3)))
    away = np.median(np.linalg.norm(seen - expected, axis=1))
    how = f"turned by 90.0 deg and {mistake.length(away)} away"
    after = "after transforming them, the unloaded reflectors are 2.0 mm from where the robot file"
    for base, what, more in (
        ({"B1": (0.0, 0, 0)}, "[base_frame] is", ""),
        ({}, "without [base_frame] the readings are", "; fill in [base_frame]"),
    ):
        (found,) = placement.placement(Some(settings=Some(base_frame=base)))
        assert found.evidence == (
            f"{what} in another frame than the one in which the robot file begins, {how}: {after} "
            "places them"
        )
        assert found.correction == f"recomputed with the readings transformed into it{more}"
        assert (found.name, found.where) == ("sign_or_convention", "base_frame")
        assert (found.before, found.after) == pytest.approx((1e3 * away, 2.0))
        np.testing.assert_allclose(found.correct.args[0], turn, atol=1e-12)
        np.testing.assert_allclose(found.correct.args[1], shift, atol=1e-12)
    for name, value in (("miss", None), ("miss", GROSS_DISTANCE_M), ("anchored", None),
                        ("not_rigid", 0.1), ("miss", away / 2.9)):  # fmt: skip
        with monkeypatch.context() as one:
            one.setattr(placement, name, lambda case, fewest=0, value=value: value)
            assert placement.placement(Some(settings=Some(base_frame={}))) == []


@pytest.mark.parametrize(("off", "told"), [(GROSS_DISTANCE_M, 1), (0.029, 0), (None, 0)])
def test_a_column_that_is_copied_over_another_in_words(monkeypatch, off, told):
    """Of one unit, equal in every row, and the table does not place the reflectors then."""
    log = LOG.assign(theta3_deg=LOG["theta1_deg"] + [0, 0, 0, 3], r4_m=0.0)
    log = log.assign(theta5_deg=log["theta3_deg"], r6_m=log["theta3_deg"], r7_m=0.0)
    columns = [name for name in log if name.endswith(("_deg", "_m"))]
    monkeypatch.setattr(dead_sensor, "miss", lambda case: off)
    found = [*dead_sensor._one_column(Some(joints=log, joint_columns=columns))]

    assert len(found) == told
    for one in found:
        assert one.evidence == (
            "j.csv: theta3 and theta5 are equal in every row, and the unloaded reflectors are "
            "30.00 mm from where the robot file then places them: one column was copied over the "
            "other"
        )
        assert (one.name, one.where, one.hopeless) == ("copied_column", "j.csv theta3/theta5", True)
        assert (one.before, one.after, one.unit) == (pytest.approx(30.0), 0.0, "mm")
        assert one.at == tuple(f"j.csv:{k}" for k in range(2, 6))
        assert one.correction == "nothing can be corrected, the values of one joint were not logged"
        assert one.correct is mistake.as_it_is


@dataclass(frozen=True)
class Filed:
    """A campaign with nothing but its settings."""

    settings: object


@pytest.mark.parametrize("stated", [None, Scale(sigma_n=3.0)])
def test_forces_that_were_not_logged_are_known_to_their_order_of_magnitude(stated):
    """Readings and gain to 100 %; whatever else is stated of the scale is kept."""
    copied = Some(scale=stated, model_copy=lambda update: Some(**update))
    found = dead_sensor._unlogged(Filed(copied)).settings.scale
    assert (found.sigma_rel, found.gain_sigma) == (1.0, 1.0)
    assert found.sigma_n == (stated or Scale()).sigma_n


def test_an_entry_has_its_path_and_its_distance():
    """Of one point by its name; of a table in another unit that of the table."""
    at = np.array([3e-3, 0.0, 4e-3])
    one = DoubtfulEntry("tool", ("P1", "P2"), None, np.zeros(3), at, at, 0.9)
    assert one.path == ["tool", "P1"]
    assert one.off_m == pytest.approx(5e-3)
    table = DoubtfulEntry("base_frame", (), "mm", np.zeros(0), np.zeros(0), np.zeros(0), 0.9)
    assert table.path == ["base_frame"]


@pytest.mark.parametrize(("with_first", "with_second"), [(200.0, 45.0), (45.0, 200.0)])
def test_a_motion_is_weighed_beside_the_readings_that_it_needs(with_first, with_second):
    """It alone explains 40, two readings 50; the one that adds most to the motion stays."""
    drops = {(): 40.0, (6,): with_first, (9,): with_second, (6, 9): 202.0}

    def parts(which):
        """Drop of some columns: the motion's first six, and those of readings."""
        each = []
        for one in which.tolist():
            alone = min(one) > 5
            each.append(50.0 if alone else drops[tuple(k for k in (6, 9) if k in one)])
        return Some(drop=np.array(each))

    own = np.arange(6, 12).reshape(2, 3)
    found = reading._as_one(Some(parts=parts), np.arange(6), own, 2.0)
    each = float(cost(50 / 2 / 2, 3))
    alone = (40 - 50) / 2 - float(cost(20.0, 6)) + 2 * each
    both = (200 - 50) / 2 - float(cost(100.0, 6)) + each
    assert found == pytest.approx(max(alone, both))
    assert both > alone
