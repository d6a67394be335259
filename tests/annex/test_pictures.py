"""What the pictures of a campaign are drawn from: against the simulator's truth and Pinocchio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from made_system import dense, generalised, made
from small_case import PLAN, small

from bench.as_pinocchio import model
from pipeline.annex.figure_tables import enough, models_table
from pipeline.annex.scene import MOST_POSES, scene
from pipeline.annex.seen_laws import laws
from pipeline.annex.workspace import arm_in_plane
from pipeline.answer.recommended import joint_springs
from pipeline.diagnosis.average import Hypothesis
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.run import ingested
from pipeline.simulate import revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.estimate import identify
from pipeline.system.fit import fit

XYZ = [f"{a}_m" for a in "xyz"]


@pytest.fixture(scope="module")
def values():
    """A simulated campaign of six poses with its joint springs."""
    case = small()
    return joint_springs(fit(case, bring(case)))


@pytest.fixture(scope="module")
def cell(values):
    """The tables of its scene."""
    return scene(values)


def test_the_arm_ends_where_the_tracker_saw_the_reflectors(cell):
    """A rod of the effector ends at its reflector as measured, through registration and joints."""
    rods = cell["scene"].query("part == 'tool' and name != 'load_point'")
    seen = rods.merge(cell["vectors"], left_on=["pose", "name"], right_on=["pose", "target"])
    off = seen[[f"to_{a}" for a in XYZ]].to_numpy() - seen[XYZ].to_numpy()

    assert len(seen) == len(cell["vectors"]) == 6 * 3
    assert np.abs(off).max() < 2e-4  # the tracker scatters by 0.03 mm


def test_the_tracker_stands_where_the_simulator_put_it(values, cell):
    """Its origin in F_b is that of the plan, to the scatter of the base reflectors."""
    row = cell["scene"].query("part == 'tracker'").iloc[0]
    at = row[[f"from_{a}" for a in XYZ]].to_numpy(float)

    assert at == pytest.approx(np.array(PLAN.tracker.position), abs=1e-3)


def test_the_strongest_pull_of_a_pose_is_drawn(values, cell):
    """Displacement and residual are those of the pull with the largest force, from the raw log."""
    loads = values.fitted.case.loads
    strongest = loads.loc[loads.groupby("pose")["force_n"].idxmax()].set_index("pose")["repeat"]
    moved = values.fitted.reduced.shown["displacements"].set_index(["pose", "repeat", "target"])
    for row in cell["vectors"].to_dict("records"):
        one = moved.loc[(row["pose"], strongest[row["pose"]], row["target"])]
        assert [row[f"moved_{a}"] for a in XYZ] == pytest.approx(
            one[[f"d{a}" for a in XYZ]].to_list(), abs=1e-15
        )


def test_a_pose_names_its_lines(values, cell):
    """The lines of the export that a pose names hold its readings and no other pose's."""
    readings = values.fitted.case.readings
    for row in cell["poses"].to_dict("records"):
        within = readings["line"].between(row["first_line"], row["last_line"])
        assert set(readings[within & readings["pose"].notna()]["pose"]) == {row["pose"]}
        assert (readings["pose"] == row["pose"]).sum() == within.sum()


@pytest.mark.whole
def test_of_many_poses_the_worst_are_drawn():
    """A large campaign is thinned to what a picture holds, and its worst pose is kept."""
    case = small(poses={"count": MOST_POSES + 5}, pulls={"steps_n": [2500.0]})
    reduced = bring(case)
    found = joint_springs(fit(case, reduced))
    left = np.linalg.norm(found.first.estimate.residual.reshape(-1, 3), axis=1)
    data = found.fitted.data
    worst = data.pulls.pose[data.pull[int(left.argmax())]]

    shown = scene(found)["poses"]["pose"]

    assert len(shown) == MOST_POSES
    assert worst in set(shown)


def test_the_models_add_up_to_what_was_measured(values):
    """Measured minus a model is its residual; an unknown nominal stiffness is no number."""
    fitted = values.fitted
    nominal = fitted.case.robot.nominal_compliance.copy()
    nominal[2] = np.nan
    table = models_table(fitted.system, fitted.estimate, fitted.estimate.residual, nominal)

    assert table["nominal_m"].isna().all()
    off = (table["measured_m"] - table["recommended_m"]).to_numpy()
    assert off == pytest.approx(fitted.estimate.residual, abs=1e-15)
    assert (table["joint_springs_m"] == table["recommended_m"]).all()


@pytest.mark.parametrize("common", [True, False])
def test_fewer_poses_know_what_the_textbook_says(common):
    """U over the number of poses is that of (B' V^-1 B)^-1 on whole matrices of the poses kept."""
    system = made(np.random.default_rng(7), pulls=(3, 2, 3, 2, 4), common=common)
    order = np.array([4, 2, 5, 1, 3])
    order = np.unique(system.rows.pose)[order - 1]
    V, size = dense(system), np.array([2.0, 3.0, 5.0])
    names = ["a", "b", "c"]

    table = enough(system, size, names, order, ratio=1.5)

    for count in (2, 3, 5):
        kept = np.isin(system.rows.pose, order[:count])
        cov = generalised(system.B[kept], system.c[kept], V[np.ix_(kept, kept)])[1]
        found = table[table["poses"] == count].set_index("parameter").loc[names, "relative_std"]
        assert found.to_numpy() == pytest.approx(1.5 * np.sqrt(np.diag(cov)) / size, rel=1e-7)


def test_measuring_all_of_it_again_halves_the_variance_but_not_that_of_the_scale():
    """What poses have to themselves averages out; an error common to all of them does not."""
    alone = made(np.random.default_rng(7), pulls=(3, 2, 3), common=False)
    shared = made(np.random.default_rng(7), pulls=(3, 2, 3), common=True)
    fall = []
    for system in (alone, shared):
        table = enough(system, np.ones(3), ["a", "b", "c"], np.unique(system.rows.pose))
        now, twice = (table[table["poses"] == n]["relative_std"].to_numpy() for n in (3, 6))
        fall.append(twice / now)

    assert fall[0] == pytest.approx(np.full(3, np.sqrt(0.5)), rel=1e-9)
    assert (fall[1] > np.sqrt(0.5) + 1e-3).any()
    assert (fall[1] < 1).all()


SIZE = 2e-8
"""Roll of the carriage that is planted [rad/(N m)]."""


@pytest.fixture(scope="module")
def rolling():
    """Joint springs and roll, estimated from readings that do not scatter."""
    plan = revised(PLAN, {"poses": {"count": 8}, "hidden": {"effects": [f"rail_roll={SIZE}"]}})
    files = simulate(plan.without_noise(), np.random.default_rng(3)).files
    case = ingested(in_memory(files), plausible=False)
    data = bring(case).data
    roll = next(one for one in catalogue(case.robot, data.pulls) if one.name == "rail_roll")
    cell = case.cell.with_effects(roll)
    start = np.append(case.robot.nominal_compliance, 0.0)
    system, estimate = identify(cell, data, start)
    return Hypothesis(1.0, (roll,), cell, system, estimate), data


def test_a_law_is_seen_where_it_was_planted(rolling):
    """Without noise every pull gives the roll that was planted: c times the moment about y."""
    found, data = rolling
    other = model(found.cell.robot)
    here = other.createData()
    moment = {}
    for k, force in enumerate(data.pulls.force):
        pin.framesForwardKinematics(other, here, data.pulls.q[k])
        arm = here.oMf[other.nframes - 1].act(found.cell.tool.load_point)
        moment[data.pulls.pose[k], data.pulls.repeat[k]] = np.cross(arm, force)[1]

    table = laws(found, data)

    x = np.array([moment[key] for key in zip(table["pose"], table["repeat"], strict=True)])
    assert set(table["cause"]) == {"rail_roll"}
    assert len(table) == len(data.pulls)
    assert table["x"].to_numpy() == pytest.approx(x, abs=0.02 * np.abs(x).max())
    assert table["y"].to_numpy() == pytest.approx(SIZE * x, abs=0.03 * SIZE * np.abs(x).max())


def test_a_law_of_another_form_bends_away(rolling):
    """Where residuals bend with the load, pulls leave the law by as much, with its sign."""
    found, data = rolling
    rows = found.system.rows
    before = laws(found, data).set_index(["pose", "repeat"])
    by = found.system.B[:, -1]  # m per rad/(N m)
    more = found.estimate.residual + by * SIZE * (rows.repeat == rows.repeat.max())
    bent = replace(found, estimate=replace(found.estimate, residual=more))

    after = laws(bent, data).set_index(["pose", "repeat"])

    change = after["y"] - before["y"]
    last = change.index.get_level_values("repeat") == rows.repeat.max()
    assert change[last].to_numpy() == pytest.approx(SIZE * before["x"][last].to_numpy(), rel=1e-6)
    assert np.abs(change[~last]).max() < 1e-12


def test_the_arm_in_its_plane_ends_at_the_test_pose(values):
    """The last part ends at the load point: its height is that of Pinocchio's, its reach too."""
    fitted = values.fitted
    robot, tool = fitted.case.robot, fitted.case.tool
    where = place_of_interest(fitted.case.settings.test_pose, robot, fitted.data.pulls)
    other = model(robot)
    data = other.createData()
    pin.framesForwardKinematics(other, data, where.q)
    point = data.oMf[other.nframes - 1].act(tool.load_point)

    arm = arm_in_plane(fitted.case.cell, where)

    assert arm["to_height_m"].iloc[-1] == pytest.approx(point[2], abs=1e-9)
    assert (arm["radius_m"] > 0).all()
