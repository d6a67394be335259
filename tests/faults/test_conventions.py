"""Mistakes that affect a whole campaign: planted, found, and corrected to the last digit."""

import json
import re
from dataclasses import replace
from functools import cache
from itertools import permutations

import numpy as np
import pandas as pd
import pytest

from pipeline.base import covariance
from pipeline.faults.base_names import base_names
from pipeline.faults.conventions import (
    anchored_miss,
    conventions,
    mapped,
    miss,
    pairs,
    renamed,
    supposed_mistakes,
    unloaded,
    unloaded_points,
)
from pipeline.faults.placement import placement
from pipeline.machine.instrument import InstrumentNoise, beam_covariance
from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import changed, dh_parameters
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

XYZ = ["x_m", "y_m", "z_m"]
PLAN = Plan(name="good", seed=11, poses={"count": 4}, pulls={"steps_n": [3000.0]})


@cache
def good():
    """A campaign of four poses in which nothing is wrong."""
    return ingested(in_memory(simulate(PLAN).files), plausible=False)


def with_readings(case, **columns):
    return replace(case, readings=case.readings.assign(**columns))


def in_unit(factor):
    """Coordinates that appear as if their unit were `factor` times larger."""

    def plant(case):
        return with_readings(case, **{axis: case.readings[axis] * factor for axis in XYZ})

    return plant


def with_joints(change, ending):
    """The joint log with changed columns of one kind."""

    def plant(case):
        which = [name for name in case.joint_columns if name.endswith(ending)]
        return replace(
            case, joints=case.joints.assign(**{c: change(case.joints[c]) for c in which})
        )

    return plant


def mirrored(case):
    """The y axis of the tracker reversed, in the readings and in their covariances."""
    C = covariance.matrices(case.readings)
    C[:, 1, :] *= -1
    C[:, :, 1] *= -1
    six = dict(zip(covariance.columns(), covariance.flat(C).T, strict=True))
    return with_readings(case, y_m=-case.readings["y_m"], **six)


def as_controller(case):
    """Values of the controller's axes logged under the names of the joints."""
    q = case.joints[case.joint_columns].to_numpy(float)
    axes = np.linalg.solve(case.robot.controller_matrix, (q - case.robot.controller_offset).T)
    return replace(
        case, joints=case.joints.assign(**dict(zip(case.joint_columns, axes, strict=True)))
    )


def turned_round(joint):
    column = {"r1": "r1_m"}.get(joint, f"{joint}_rad")
    return lambda case: replace(case, joints=case.joints.assign(**{column: -case.joints[column]}))


def written(names):
    """P1 logged under the first of these names, P2 under the second, P3 under the third."""

    def plant(case):
        as_said = dict(zip(["P1", "P2", "P3"], names, strict=True))
        return with_readings(
            case, target=[as_said.get(t, t) for t in case.readings["target"].astype(str)]
        )

    return plant


def base_swapped(one, other):
    def plant(case):
        base = dict(case.settings.base_frame)
        base[one], base[other] = base[other], base[one]
        return replace(case, settings=case.settings.model_copy(update={"base_frame": base}))

    return plant


FOUND = {
    "mm": in_unit(1e3),
    "joints_m": with_joints(lambda x: x / 1e3, "_m"),
    "left_handed": mirrored,
    "all groups": written(["P2", "P3", "P1"]),
}
"""Mistakes by the place that is named for each; those of test_screening.py are not included."""

UNDONE = [
    *[("m", in_unit(f)) for f in (1e-3, 25.4e-3)],
    *[("inch", in_unit(f)) for f in (1 / 25.4, 1 / 25.4e-3)],
    ("mm", in_unit(25.4)),
    ("rad", with_joints(np.deg2rad, "_rad")),
    ("deg", with_joints(np.rad2deg, "_rad")),
    ("joints_mm", with_joints(lambda x: x * 1e3, "_m")),
    ("controller_axes", as_controller),
    *[(f"theta{k}_rad", with_joints(np.deg2rad, f"theta{k}_rad")) for k in (2, 4, 6)],
    *[(f"theta{k}_deg", with_joints(np.rad2deg, f"theta{k}_rad")) for k in (3, 7)],
    *[(f"theta{k}_reversed", turned_round(f"theta{k}")) for k in (2, 4, 5, 7)],
    ("r1_reversed", turned_round("r1")),
]


def same(case, other):
    """Readings, joints and base frame agree to rounding."""
    pd.testing.assert_frame_equal(
        case.readings.astype({"target": str}), other.readings.astype({"target": str}),
        rtol=1e-12, atol=1e-15,
    )  # fmt: skip
    pd.testing.assert_frame_equal(case.joints, other.joints, rtol=1e-12, atol=1e-14)
    assert case.settings == other.settings
    assert case.robot is other.robot


@pytest.mark.parametrize("where", FOUND)
def test_a_planted_mistake_is_named_and_undone(where):
    """Nothing else is found, and the corrected campaign is the good one to the last digit."""
    (found,) = conventions(FOUND[where](good()))

    assert found.where == where
    same(found.correct(FOUND[where](good())), good())
    assert found.before > 30
    assert found.after < 1


@pytest.mark.parametrize("pair", [("B1", "B2"), ("B1", "B3"), ("B2", "B4"), ("B3", "B4")])
def test_two_base_reflectors_with_each_other_s_names_are_told(pair):
    """From their distances, or from the DH parameters if a rectangle leaves distances ambiguous."""
    bad = base_swapped(*pair)(good())
    assert miss(bad) > 0.03 or anchored_miss(bad) > 0.3

    (found,) = base_names(bad)

    assert (found.name, found.where) == ("label_swap", "-".join(pair))
    same(found.correct(bad), good())


@pytest.mark.sampled(8)
@pytest.mark.parametrize(("where", "plant"), UNDONE, ids=[where for where, _ in UNDONE])
def test_every_hypothesis_undoes_its_own_mistake(where, plant):
    """Of all hypotheses, those with its name restore the good campaign, and no other does."""
    bad = plant(good())
    assert miss(bad) > 0.03 or anchored_miss(bad) > 0.3
    points, right = (unloaded_points(case) for case in (bad, good()))

    exact = [h for h in supposed_mistakes(bad) if alike(h.moves(points), right)]

    assert [h.where for h in exact] == [where]
    same(exact[0].correct(bad), good())


def alike(one, other):
    """The same readings, in the same places by the same robot, and the same base reflectors."""
    pairs = ((getattr(p, name) for p in (one, other)) for name in ("seen", "q", "tool", "base"))
    return (
        all(np.allclose(*pair, rtol=1e-12, atol=1e-14) for pair in pairs)
        and (one.target == other.target).all()
        and (one.names == other.names).all()
        and one.nominal == other.nominal
        and one.robot is other.robot
    )


def test_what_is_tried_on_the_points_is_what_the_case_is_corrected_by():
    """Every hypothesis moves the unloaded points to where they are in the campaign it corrects."""
    names = good().readings["target"].astype(str)
    bad = with_readings(good(), target=names.where(names != "B1", "P1"))
    points = unloaded_points(bad)

    odd = [h.says for h in supposed_mistakes(bad)
           if not alike(h.moves(points), unloaded_points(h.correct(bad)))]  # fmt: skip

    assert odd == []
    assert {"B2", "P1"} < set(points.names)


@pytest.mark.parametrize("names", list(permutations(["P1", "P2", "P3"]))[1:])
def test_exchanged_names_are_put_back_whatever_they_were(names):
    """Two exchanged or all three cyclically: exactly one hypothesis corrects each."""
    bad = written(names)(good())
    right = [
        h
        for h in supposed_mistakes(bad)
        if h.name == "label_swap"
        and h.where == "all groups"
        and (h.correct(bad).readings["target"] == good().readings["target"]).all()
    ]

    assert len(right) == 1
    assert miss(bad) > 0.03
    assert miss(right[0].correct(bad)) == pytest.approx(miss(good()))


def test_a_good_campaign_is_left_alone():
    """Also one with a robot 20 mm off its DH parameters, or measured in two poses only."""
    assert conventions(good()) == []
    assert miss(good()) < 1e-3
    rng = np.random.default_rng(4)
    moved = {a: good().readings[a] + 0.011 * rng.standard_normal(len(good().readings)) for a in XYZ}
    assert conventions(with_readings(good(), **moved)) == []
    few = replace(good(), joints=good().joints[good().joints["pose"] <= 2])
    assert miss(in_unit(1e3)(few)) is None


def test_what_no_mistake_explains_to_the_end_is_not_corrected():
    """Readings in another unit and scattered over 50 mm.

    The corrected ones still miss by too much.
    """
    rng = np.random.default_rng(5)
    off = 0.05 * rng.standard_normal((len(good().readings), 3))
    strewn = {a: good().readings[a] + off[:, k] for k, a in enumerate(XYZ)}
    bad = in_unit(1e3)(with_readings(good(), **strewn))

    assert miss(bad) > 100 * miss(mapped(1e-3 * np.eye(3), bad))
    assert conventions(bad) == []


def test_how_far_the_reflectors_miss_is_what_moves_within_a_pose():
    """A rigid motion of all readings is no miss; with the base fixed it is seen, with its size."""
    points = good().readings[XYZ].to_numpy(float)
    base = good().readings["pose"].isna().to_numpy()
    shift = np.where(base[:, None], 0.0, [0.3, -0.4, 1.2])
    moved = with_readings(good(), **dict(zip(XYZ, (points + shift).T, strict=True)))

    assert miss(moved) == pytest.approx(miss(good()), rel=1e-6)
    assert anchored_miss(moved) == pytest.approx(1.3, abs=1e-2)
    assert anchored_miss(good()) < 1e-3
    bare = good().settings.model_copy(update={"base_frame": {}})
    assert anchored_miss(replace(good(), settings=bare)) is None


def test_a_base_reading_metres_off_turns_no_base_frame():
    """One of all rounds: the frame is that of the others, and no nominal place is wrong."""
    case = good()
    rows = case.readings
    base = rows.index[rows["pose"].isna()]
    off = rows.copy()
    off.loc[base[1], XYZ] = rows.loc[base[1], XYZ].to_numpy(float) + np.array([3.0, -2, 2])
    bad = replace(case, readings=off)

    assert anchored_miss(bad) == pytest.approx(anchored_miss(case), abs=1e-4)
    assert conventions(bad) == []
    assert placement(bad) == []


def turned_base(case):
    """[base_frame] measured along the other edge of the plate: a right angle and a metre off."""
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    base = {
        name: tuple((turn @ at + [1.0, 0, 0]).tolist())
        for name, at in case.settings.base_frame.items()
    }
    return replace(case, settings=case.settings.model_copy(update={"base_frame": base}))


def no_base(case):
    """Nothing filled in, and the readings in the tracker's frame."""
    return replace(case, settings=case.settings.model_copy(update={"base_frame": {}}))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("plant", [turned_base, no_base])
def test_readings_that_are_not_in_the_base_frame_are_brought_there(plant):
    """Corrected as a whole, forces are then as before, to a tenth of a degree."""
    bad = plant(good())

    (found,) = conventions(bad) or placement(bad)
    right = found.correct(bad)

    assert (found.name, found.where) == ("sign_or_convention", "base_frame")
    assert ("without [base_frame]" in found.evidence) is (plant is no_base)
    assert placement(right) == []
    assert placement(good()) == []
    force, true = (
        bring(one).shown["forces"][["fx_n", "fy_n", "fz_n"]].to_numpy() for one in (right, good())
    )
    away = np.linalg.norm(force - true, axis=1) / np.linalg.norm(true, axis=1)
    assert away.max() < 2e-3


@pytest.mark.parametrize(("poses", "targets", "told"), [(1, 3, False), (2, 1, False), (2, 3, True)])
def test_so_are_those_of_two_poses(poses, targets, told):
    """The same rigid motion explains their reflectors; that of one pose may be its joint row's.

    Two points leave the turn about the line through them open.
    """
    kept = set(np.unique(good().joints["pose"])[:poses])
    tables = {name: getattr(good(), name) for name in ("readings", "loads", "joints")}
    few = replace(
        good(),
        **{
            name: rows[rows["pose"].isna() | rows["pose"].isin(kept)]
            for name, rows in tables.items()
        },
    )

    gone = good().settings.measured[targets:]
    few = replace(few, readings=few.readings[~few.readings["target"].isin(gone)])

    found = placement(no_base(few))

    assert [one.where for one in found] == ["base_frame"] * told
    assert placement(few) == []
    assert all(placement(one.correct(no_base(few))) == [] for one in found)


def test_a_wrong_unit_takes_the_files_covariances_along_and_no_others():
    """Covariances in the export are in its unit; those in campaign.toml are in metres."""
    rows = good().readings
    own = np.arange(len(rows)) % 3 == 0
    mixed = with_readings(good(), covariance_from=np.where(own, "file", "stated"))

    right = mapped(1e3 * np.eye(3), mixed).readings

    factor = np.where(own, 1e6, 1.0)[:, None, None]
    expected = factor * covariance.matrices(rows)
    assert covariance.matrices(right) == pytest.approx(expected)
    assert right[XYZ].to_numpy() == pytest.approx(1e3 * rows[XYZ].to_numpy())


def test_a_mirrored_frame_mirrors_the_covariances():
    """Readings that scatter along oblique axes get back their original axes."""
    half = 1e-5 * np.random.default_rng(3).standard_normal((len(good().readings), 3, 3))
    six = covariance.flat(half @ half.swapaxes(1, 2))
    slanted = with_readings(good(), **dict(zip(covariance.columns(), six.T, strict=True)))
    mirror = next(h for h in supposed_mistakes(slanted) if h.where == "left_handed")

    same(mirror.correct(mirrored(slanted)), slanted)


def test_a_beam_is_as_long_as_the_corrected_unit_says():
    """Noise stated by range and angle is recomputed for the corrected readings."""
    beam = InstrumentNoise(range_m=8e-6, transverse_m=1e-5, transverse_per_m=6e-6)
    tracker = good().settings.tracker.model_copy(update={"sigma_m": None, "noise": beam})
    case = replace(good(), settings=good().settings.model_copy(update={"tracker": tracker}))

    right = mapped(25.4 * np.eye(3), case).readings

    expected = beam_covariance(25.4 * case.readings[XYZ].to_numpy(float), beam)
    assert right[covariance.columns()].to_numpy() == pytest.approx(expected)


def test_only_unloaded_readings_of_known_poses_are_judged():
    """Loaded ones, base and chain reflectors, and poses without joint values are not."""
    rows = unloaded(good())
    assert set(rows["state"]) == {"unloaded"}
    assert set(rows["target"]) == {"P1", "P2", "P3"}
    less = replace(good(), joints=good().joints[good().joints["pose"] != 3])
    assert set(unloaded(less)["pose"]) == set(rows["pose"]) - {3}
    again = renamed(
        renamed(good(), {"P1": "P2", "P2": "P3", "P3": "P1"}), {"P1": "P3", "P2": "P1", "P3": "P2"}
    )
    assert (again.readings["target"] == good().readings["target"]).all()


def test_the_robot_of_another_table_is_called_by_its_name():
    """If another robot that ships fits the readings, the message names it."""
    plan = PLAN.model_copy(update={"robot": "irb6640", "pulls": Plan().pulls})
    measured = ingested(in_memory(simulate(plan).files), plausible=False)
    (found,) = conventions(replace(measured, robot=load("kr210_r2700_2")))

    assert found.where == "irb6640"
    assert found.evidence.startswith("the robot is irb6640, not kr210_r2700_2: as given ")
    assert conventions(measured) == []


def test_one_length_of_the_same_robot_precedes_another_robot():
    """Left to the evidence against the table: a forearm shorter by 0.25 m is nearly an IRB 6700."""
    plan = PLAN.model_copy(update={"robot": "irb6640", "pulls": Plan().pulls})
    measured = ingested(in_memory(simulate(plan).files), plausible=False)
    (d,) = (one for one in dh_parameters(measured.robot) if one.label == "link_offset:4")
    short = changed(measured.robot, [d], np.array([-0.2495]))
    zeros = unloaded(measured)
    _, places, _ = pairs(replace(measured, robot=short), zeros)
    rows = measured.readings.copy()
    rows.loc[zeros.index, ["x_m", "y_m", "z_m"]] = places

    assert conventions(replace(measured, readings=rows)) == []


ABOUT_Z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
OTHER_AXES = {
    "half": ABOUT_Z @ ABOUT_Z,
    "quarter": ABOUT_Z,
    "x_is_z": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "mirrored": np.diag([1.0, -1.0, 1.0]),
}
"""Flange frames of controllers and drawings: axes of ours, with other names or signs."""
TURNS = {
    "half": "180 deg about z of the flange: [x, y, z] there is [-x, -y, z] here",
    "quarter": "-90 deg about z of the flange: [x, y, z] there is [y, -x, z] here",
    "mirrored": "mirrored: [x, y, z] there is [x, -y, z] here",
}
"""The turn as it is to be made: the half one is its own inverse, a quarter is made back."""


@pytest.mark.sampled(4)
@pytest.mark.parametrize("how", OTHER_AXES)
@pytest.mark.parametrize("table", ["tool", "base_frame"])
def test_a_table_in_a_frame_of_other_axes_is_turned_back(table, how):
    """The entries that it says to write are the right ones; nobody measures them again."""
    known = getattr(good().settings, table)
    places = {name: tuple((OTHER_AXES[how] @ at).tolist()) for name, at in known.items()}
    bad = replace(good(), settings=good().settings.model_copy(update={table: places}))

    (found,) = conventions(bad)

    assert (found.name, found.where) == ("sign_or_convention", table)
    assert found.after < 1 < 30 < found.before
    assert table != "tool" or TURNS.get(how, "") in found.evidence
    right = getattr(found.correct(bad).settings, table)
    assert right.keys() == known.keys()
    for name, at in known.items():
        assert right[name] == pytest.approx(at, abs=1e-12)
        shown = re.search(rf"{name} = (\[[^]]+\])", found.evidence.partition("; write ")[2])
        assert json.loads(shown[1]) == pytest.approx(at)
