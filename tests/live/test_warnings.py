"""Early warnings: zero of the scale, scatter of the tracker, a knock."""

import numpy as np
import pytest
import report_sample
from test_live import BASE, READINGS, of_pose, table

from bench.live import _turn
from pipeline import identify, load_campaign, simulate_campaign
from pipeline.live.update import _warnings, update_of
from pipeline.machine.robot import configure, load


def warned(campaign):
    return update_of(campaign, identify(campaign)).warnings


@pytest.mark.whole
@pytest.mark.parametrize(
    ("effect", "poses", "done"),
    [("scale_zero=2x", 8, "read it empty"), ("scale_hysteresis=2x", 4, "pull up only"),
     ("tracker_noise=2x", 4, "look for vibration")],
)  # fmt: skip
def test_a_cause_of_the_measurement_is_told_with_what_to_do(effect, poses, done):
    """With a quarter or half of the poses measured."""
    made = simulate_campaign(seed=11, name="hall", effects=[effect])
    files = dict(made.campaign.files)
    titles, *lines = files["tracker.csv"].decode().splitlines(keepends=True)
    some = [one for one in lines if one[:4] == "pose" and int(one[4:6]) <= poses]
    base = [one for one in lines if one.startswith("base_start")]
    files["tracker.csv"] = "".join([titles, *base, *some]).encode()

    (said,) = warned(load_campaign(files, name="hall"))

    assert said.startswith(effect.partition("=")[0].replace("_", " ").capitalize())
    assert done in said


def moved(line, at=None):
    """A reading after a knock of the tracker."""
    group, target, x, y, z, time = line.split(",")
    there = [group, target, f"{float(x) + 1.5:.4f}", f"{float(y) - 0.8:.4f}", z, at or time]
    return ",".join(there)


@pytest.mark.whole
def test_a_tracker_that_was_knocked_sends_one_to_the_base_reflectors():
    """Before the base is read again, also without times, and afterwards."""
    poses = [one for k in range(1, 6) for one in of_pose(k)]
    poses += [moved(one) for k in range(6, 9) for one in of_pose(k)]
    again = [one.replace("base_start", "base_end") for one in BASE]
    timed = [moved(one, f"2026-11-03T10:0{k}:00\n") for k, one in enumerate(again)]

    for rounds in ((), [moved(one) for one in again], timed):
        said = warned(load_campaign(table(*poses, *rounds), name="demo"))
        assert any("read the base reflectors again" in one for one in said)


@pytest.mark.whole
def test_a_knock_that_only_the_base_shows_is_told_by_its_name():
    """Every pose was read before it, so that no cause is left to be named."""
    poses = [one for k in range(1, 6) for one in of_pose(k)]
    again = [one for one in READINGS if one.startswith("base_end")]
    late = [moved(one.replace("_end", "_late"), f"2026-11-03T12:00:0{k}\n")
            for k, one in enumerate(again)]  # fmt: skip

    said = warned(load_campaign(table(*poses, *again, *late), name="demo"))

    assert any(one.startswith("Tracker knocked: see that tracker") for one in said), said
    assert warned(load_campaign(table(*poses, *again), name="demo")) == ()


@pytest.mark.whole
@pytest.mark.parametrize(
    ("moved", "name", "done"),
    [
        (lambda axes, p: p + axes @ [0.8, -0.5, 0.6], "Target moved (P2) since pose 9",
         "see whether its nest is loose"),
        (lambda _, p: np.add(p, [1.5, -0.8, 0.3]), "Base moved since pose 9",
         "see what holds robot and tracker"),
    ],
    ids=["a nest", "the tracker"],
)  # fmt: skip
def test_what_moved_between_poses_is_told_with_what_to_do(moved, name, done):
    """One reflector on the effector by 1.1 mm, or all of them by 1.7 mm, base read only before."""
    made = simulate_campaign(seed=8105, name="hall", stiffness_spread=0.3)
    robot, files = made.campaign.robot, dict(made.campaign.files)
    joints = [row.split(",") for row in files["joints.csv"].decode().splitlines()[1:]]
    q = {int(row[0]): np.array(row[1:8], float) for row in joints}
    titles, *lines = files["tracker.csv"].decode().splitlines(keepends=True)
    base = [line for line in lines if line.startswith("base_start")]
    turn = _turn(base, made.campaign)
    out = [titles]
    for line in lines:
        group, target, *xyz, time = line.split(",")
        late = group.startswith("pose") and int(group[4:6]) >= 9
        if late and (target == "P2" or not name.startswith("Target")):
            pose = configure(robot, robot.from_degrees(q[int(group[4:6])])[None])
            axes = turn.T @ pose.flange_axes[0]
            there = moved(axes, np.array(xyz, float))
            line = ",".join([group, target, *(f"{x:.4f}" for x in there), time])
        out.append(line)
    files["tracker.csv"] = "".join(out).encode()

    said = warned(load_campaign(files, name="hall"))

    assert any(one.startswith(name) and done in one for one in said), said


@pytest.mark.whole
def test_a_tracker_that_wanders_is_told_and_nobody_blames_the_robot(wandering):
    """Each state is displaced by a further random step of 0.04 mm per axis."""
    said = warned(load_campaign(wandering(10), name="hall"))

    assert any(one.startswith("Tracker wander") and "read each zero" in one for one in said), said
    assert not any("robot" in one for one in said)


@pytest.mark.whole
def test_scatter_with_far_readings_is_not_of_the_robot(wandering):
    """With so few poses a wandering tracker appears as heavy tails."""
    (said,) = warned(load_campaign(wandering(5), name="hall"))

    assert said.startswith("Heavy tails")
    assert said.endswith("nothing cuts the beam.")


@pytest.fixture
def wandering():
    """Files of a campaign up to some pose."""
    made = simulate_campaign(seed=8103, name="hall", stiffness_spread=0.3)
    titles, *lines = made.campaign.files["tracker.csv"].decode().splitlines(keepends=True)
    rng, at, out, last = np.random.default_rng(3), np.zeros(3), [], None
    for line in lines:
        group, target, *xyz, time = line.split(",")
        if group.startswith("pose"):
            at, last = (at if group == last else at + rng.normal(0, 0.04, 3)), group
            xyz = [f"{float(x) + d:.4f}" for x, d in zip(xyz, at, strict=True)]
        out.append((group, ",".join([group, target, *xyz, time])))

    def until(pose):
        some = [line for group, line in out if group == "base_start"
                or (group[:4] == "pose" and int(group[4:6]) <= pose)]  # fmt: skip
        return dict(made.campaign.files) | {"tracker.csv": "".join([titles, *some]).encode()}

    return until


def test_a_warning_says_where_and_since_when():
    """Of a cause with a form that is no time, the form is left out."""

    def since(form):
        def say(content):
            (cause,) = content["diagnosis"]["causes"]
            cause |= {"where": 2, "form": form}

        answer = report_sample.revised(report_sample.answer(), say)
        (said,) = _warnings(answer, load("kr500_rail"))
        return said

    assert since("since pose 9").startswith("Rail roll (2) since pose 9, probability 0.98")
    assert since("quadratic").startswith("Rail roll (2), probability 0.98")
