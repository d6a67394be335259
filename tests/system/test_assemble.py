"""Each column of the error factors is the effect of that error on c - B x."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.reduced import reduce
from pipeline.machine.cell import paper_cell, predict
from pipeline.machine.effect import HUNG, PULLED
from pipeline.machine.effects import catalogue, unlisted
from pipeline.machine.law import Law
from pipeline.reduction.bring import conformed
from pipeline.reduction.effector import tool
from pipeline.reduction.settings import Scale
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.assemble import assemble, by_force, second_order


@pytest.fixture(scope="module")
def raw():
    plan = Plan(
        name="c", poses={"count": 4}, scale={"sigma_n": 3.0, "sigma_rel": 1e-3, "gain_sigma": 2e-3}
    )
    return in_memory(simulate(plan).files)


@pytest.fixture(scope="module")
def data(raw):
    return reduce(raw, conformed).data


@pytest.fixture(scope="module")
def cell(raw):
    return paper_cell(raw.robot, tool(raw.settings))


def misfit(cell, data):
    """Residual of c with the nominal compliances."""
    x = cell.robot.nominal_compliance
    system = assemble(cell, data, x)
    return system.c - system.B @ x


def block(cell, data, source):
    """Columns of one source, dense."""
    errors = assemble(cell, data, cell.robot.nominal_compliance).errors
    return errors.G[:, errors.source == source].toarray()


def with_force(data, force):
    return replace(data, pulls=replace(data.pulls, force=force))


def test_a_scale_reading_moves_its_own_pull_only(cell, data):
    """One standard uncertainty of the fifth scale reading changes c - B x by its column."""
    G = block(cell, data, "force_reading")
    size = np.linalg.norm(data.pulls.force, axis=1)
    force = data.pulls.force.copy()
    force[4] *= 1 + np.hypot(3.0, 1e-3 * size[4]) / size[4]

    change = misfit(cell, with_force(data, force)) - misfit(cell, data)

    assert G.shape[1] == len(size)
    assert change == pytest.approx(G[:, 4], abs=1e-12)
    assert set(np.flatnonzero(np.abs(change) > 1e-9) // 9) == {4}


def test_the_gain_moves_all_pulls_together(cell, data):
    """A scale that shows 0.2 % too much."""
    change = misfit(cell, with_force(data, 1.002 * data.pulls.force)) - misfit(cell, data)

    assert change == pytest.approx(block(cell, data, "force_gain")[:, 0], abs=1e-12)


def test_a_gain_that_drifts_leaves_the_mean_gain_open(cell, data):
    """The scale's 2e-3, and 4 % of drift as a uniform distribution, by the law of propagation."""
    drift = unlisted.effect(
        cell.robot, Law("scale", "reading", "smooth", "time", 0, 1.0, 0.0, data.pulls.time.max())
    )
    drifting, x = cell.with_effects(drift), cell.robot.nominal_compliance

    def gain(values):
        errors = assemble(drifting, data, np.append(x, values)).errors
        return errors.G[:, errors.source == "force_gain"].toarray()

    still, moved = gain(0.0), gain(0.04)

    assert still == pytest.approx(block(cell, data, "force_gain"), rel=1e-9)
    assert np.linalg.norm(moved) / np.linalg.norm(still) == pytest.approx(
        np.hypot(2e-3, 0.04 / np.sqrt(12)) / 2e-3, rel=0.03
    )


def test_a_zero_that_jumps_leaves_its_level_open(cell, data):
    """Beside a stated zero of 3 N, a jump of 20 N adds a uniform distribution about either end."""
    size = np.linalg.norm(data.pulls.force, axis=1)
    ends = float(size.min()), float(size.max())
    jump = unlisted.effect(
        cell.robot, Law("scale", "zero", "step", "force", 0, 1.0, *ends, sum(ends) / 2)
    )
    stated, x = replace(data, scale=Scale(zero_sigma_n=3.0)), cell.robot.nominal_compliance

    def zero(cell, values):
        errors = assemble(cell, stated, values).errors
        return np.linalg.norm(errors.G[:, errors.source == "force_zero"].toarray())

    jumping = zero(cell.with_effects(jump), np.append(x, 20.0))

    assert jumping / zero(cell, x) == pytest.approx(np.hypot(3.0, 20 / np.sqrt(3)) / 3.0, rel=0.03)


def test_the_zero_of_the_scale_moves_all_pulls_by_the_same_force(cell, data):
    """Two newtons of tare: every force longer by as much, and the model evaluated again."""
    wrong = replace(data, scale=Scale(zero_sigma_n=2.0))
    errors = assemble(cell, wrong, cell.robot.nominal_compliance).errors
    (column,) = errors.G[:, errors.source == "force_zero"].toarray().T

    size = np.linalg.norm(data.pulls.force, axis=1, keepdims=True)
    longer = replace(data.pulls, force=data.pulls.force * (1 + 2.0 / size))
    x = cell.robot.nominal_compliance
    more = predict(cell, longer, x).displacement - predict(cell, data.pulls, x).displacement
    assert column == pytest.approx(-more[data.pull, data.target].ravel(), rel=1e-9, abs=1e-15)
    assert errors.common[errors.source == "force_zero"].all()


@pytest.mark.parametrize(
    ("source", "step"),
    [("force_gain", lambda size: 2e-3 * size), ("force_zero", lambda size: 2.0 + 0 * size)],
)
def test_a_scale_tells_nothing_of_what_is_hung_on(cell, data, source, step):
    """Pulls by a chain err together, weights of two bodies by the mass of each."""
    m = len(data.pulls)
    body = np.arange(m) % 3 - 1
    acts_at = np.where(body[:, None] >= 0, [0.1, -0.05, 0.3], np.nan)
    pulls = replace(data.pulls, acts_at=acts_at, by=np.where(body < 0, PULLED, HUNG))
    mass_std, scale = np.where(body >= 0, 1.0 + body, 0.0), Scale(gain_sigma=2e-3, zero_sigma_n=2.0)
    hung = replace(
        data, body=body, mass_std=mass_std, center_std=np.zeros(m), pulls=pulls, scale=scale
    )
    size = np.linalg.norm(data.pulls.force, axis=1)
    along, here = data.pulls.force / size[:, None], misfit(cell, hung)

    def moved(by):
        longer = data.pulls.force + by[:, None] * along
        return misfit(cell, replace(hung, pulls=replace(hung.pulls, force=longer))) - here

    (column,) = block(cell, hung, source).T
    assert column == pytest.approx(moved((body < 0) * step(size)), abs=1e-12)
    masses = block(cell, hung, "payload_mass").T
    assert len(masses) == 2
    for k, one in enumerate(masses):
        assert one == pytest.approx(moved((body == k) * (1.0 + k)), abs=1e-12)


def test_a_turned_tracker_turns_displacements_and_forces(cell, data):
    """The columns of the registration are those of small rotations, however combined."""
    G = block(cell, data, "registration")
    changes = []
    for axis in np.eye(3):
        turn = Rotation.from_rotvec(1e-7 * axis).as_matrix()
        turned = replace(with_force(data, data.pulls.force @ turn.T), delta=data.delta @ turn.T)
        changes.append((misfit(cell, turned) - misfit(cell, data)) / 1e-7)
    D = np.array(changes).T

    assert pytest.approx(D @ data.rotation_cov @ D.T, abs=1e-17) == G @ G.T


def test_the_direction_moves_as_its_covariance_says(cell, data):
    """First-order propagation of every pull's direction covariance, by differences."""
    G = block(cell, data, "direction")
    size = np.linalg.norm(data.pulls.force, axis=1)
    expected = np.zeros((len(G), len(G)))
    for pull in range(len(size)):
        D = []
        for axis in np.eye(3):
            force = data.pulls.force.copy()
            force[pull] += 1e-4 * size[pull] * axis
            D.append((misfit(cell, with_force(data, force)) - misfit(cell, data)) / 1e-4)
        expected += np.array(D).T @ data.direction_cov[pull] @ np.array(D)

    assert pytest.approx(expected, abs=1e-16) == G @ G.T


def test_the_zero_of_a_pose_moves_all_its_pulls(cell, data):
    """Pulls of one pose and target share the zero; other poses and targets do not."""
    V = block(cell, data, "zero")
    V = V @ V.T
    rows = assemble(cell, data, cell.robot.nominal_compliance).rows
    same = (
        (rows.pose[:, None] == rows.pose)
        & (rows.target[:, None] == rows.target)
        & (rows.axis[:, None] == rows.axis)
    )

    assert V[same] == pytest.approx(np.full(same.sum(), 3e-5**2 / 2), rel=1e-9)
    assert np.abs(V[~same]).max() < 1e-24


def test_every_loaded_reading_errs_by_itself(cell, data):
    """The tracker's block is diagonal for isotropic noise."""
    G = block(cell, data, "tracker")

    assert pytest.approx(3e-5**2 * np.eye(len(G)), abs=1e-22) == G @ G.T


def tilted(rng, shape, size):
    """Covariances with arbitrary axes and standard uncertainties of about `size`."""
    half = size * rng.standard_normal((*shape, 3, 3))
    return half @ half.swapaxes(-1, -2)


def test_readings_err_in_the_directions_they_are_stated_to(cell, data):
    """Oblique covariances.

    V of each displacement is its own plus that of its zero, shared by pulls.
    """
    rng = np.random.default_rng(2)
    loaded = tilted(rng, (len(data.pull),), 3e-5)
    zero = tilted(rng, (data.zero.max() + 1,), 2e-5)[data.zero]
    asked = replace(data, loaded_cov=loaded, zero_cov=zero)

    own, shared = (block(cell, asked, source) for source in ("tracker", "zero"))

    own, shared = own @ own.T, shared @ shared.T
    for i in range(len(data.pull)):
        for j in range(len(data.pull)):
            at = np.ix_(range(3 * i, 3 * i + 3), range(3 * j, 3 * j + 3))
            same = data.zero[i] == data.zero[j]
            assert own[at] == pytest.approx(loaded[i] * (i == j), rel=1e-9, abs=1e-18)
            assert shared[at] == pytest.approx(zero[i] * same, rel=1e-9, abs=1e-18)


def test_a_tilted_direction_errs_along_its_own_axes(cell, data):
    """Drawn directions of one pull: c - B x scatters by its columns, and no other pull's."""
    rng, pull = np.random.default_rng(9), 5
    cov = np.zeros_like(data.direction_cov)
    cov[pull] = tilted(rng, (), 1e-4)
    G = block(cell, replace(data, direction_cov=cov), "direction")

    size, drawn = np.linalg.norm(data.pulls.force[pull]), []
    for off in np.linalg.cholesky(cov[pull]).T:  # three rotations of the chain that span it
        force = data.pulls.force.copy()
        force[pull] += size * off
        drawn.append(misfit(cell, with_force(data, force)) - misfit(cell, data))

    assert pytest.approx(np.array(drawn).T @ np.array(drawn), rel=1e-6, abs=1e-18) == G @ G.T


def test_every_wrong_point_of_the_tool_is_a_column_of_its_own(cell, data):
    """The model with one coordinate off by a sigma, load point first: the change of c - B x."""
    G = block(cell, replace(data, tool_std=1e-4), "geometry")
    here, columns = misfit(cell, data), []
    for point in range(4):
        for axis in range(3):
            points = np.vstack([cell.tool.load_point, cell.tool.points])
            points[point, axis] += 1e-4
            tool_ = replace(cell.tool, load_point=points[0], points=points[1:])
            columns.append(misfit(replace(cell, tool=tool_), data) - here)
    felt = [column for column in columns if np.abs(column).max() > 0]

    assert pytest.approx(np.array(felt).T, abs=1e-15) == G


def test_every_wrong_zero_of_a_joint_is_a_column_of_its_own(cell, data):
    """The log of one joint off by its sigma in all poses; an exact joint has no column."""
    std = np.array([1e-3, 0.0, 1e-4, 2e-4, 0.0, 3e-4, 1e-4])
    G = block(cell, replace(data, joint_std=std), "geometry")
    here, columns = misfit(cell, data), []
    for joint in np.flatnonzero(std):
        q = data.pulls.q.copy()
        q[:, joint] += std[joint]
        columns.append(misfit(cell, replace(data, pulls=replace(data.pulls, q=q))) - here)
    felt = [column for column in columns if np.abs(column).max() > 0]

    assert len(felt) >= 4
    assert pytest.approx(np.array(felt).T, abs=1e-15) == G


def test_what_is_surely_known_has_no_column(cell, data):
    """Without uncertainty of geometry, gain, scale or frame, none of them is a source."""
    sure = replace(
        data, scale=Scale(), rotation_cov=np.zeros((3, 3)), reading_std=0 * data.reading_std
    )
    errors = assemble(cell, sure, cell.robot.nominal_compliance).errors

    assert set(errors.source) == {"tracker", "zero", "direction"}
    assert not errors.common.any()


def test_only_what_moves_all_poses_is_common(cell, data):
    """Frame, gain and geometry; everything else is confined to one pose."""
    asked = replace(data, tool_std=1e-4, joint_std=np.full(7, 1e-4), bends=True)
    system = assemble(cell, asked, cell.robot.nominal_compliance)
    errors, pose = system.errors, system.rows.pose
    poses = [len(set(pose[np.flatnonzero(column)])) for column in errors.G.toarray().T]

    assert set(errors.source[errors.common]) == {
        "registration", "force_gain", "geometry", "second_order",
    }  # fmt: skip
    assert {n for n, common in zip(poses, errors.common, strict=True) if not common} == {1}
    assert min(n for n, common in zip(poses, errors.common, strict=True) if common) > 1


def test_what_the_deflected_robot_does_more_is_one_column(cell, data):
    """Data of a robot that deflects: c - B x, as an error of the undeformed model, up to sign."""
    x = cell.robot.nominal_compliance
    bent = predict(replace(cell, equilibrium="deformed"), data.pulls, x).displacement
    real = replace(data, delta=bent[data.pull, data.target], bends=True)

    G = block(cell, real, "second_order")

    assert G.shape[1] == 1
    assert np.abs(G).max() > 1e-8
    assert misfit(cell, real) == pytest.approx(G[:, 0], abs=1e-15)
    deflected = assemble(replace(cell, equilibrium="deformed"), real, x).errors
    assert "second_order" not in deflected.source


def test_a_spring_that_came_out_wild_bends_as_its_table_says(cell, data):
    """Negative, or beyond twenty typical compliances: the nominal one is used instead."""
    x = cell.robot.nominal_compliance
    wild = x.copy()
    typical = np.array([p.typical for p in cell.parameters])
    wild[1], wild[4] = -x[1], 21 * typical[4]
    near = x.copy()
    near[4] = 19 * typical[4]

    assert second_order(cell, data, wild) == pytest.approx(second_order(cell, data, x), abs=1e-18)
    assert np.abs(second_order(cell, data, near) - second_order(cell, data, x)).max() > 1e-8


def test_a_noise_that_nobody_stated_scales_what_the_tracker_gave(cell, data):
    """Relative columns times s are those of the noise s; those of scale and frame are in metres.

    Directions use a step of 10 um, whatever their unit.
    """
    unit = data.scaled(1 / 3e-5)
    relative = replace(unit, noise_stated=False)
    found, x = relative.in_metres(3e-5), cell.robot.nominal_compliance
    loose, tight = (assemble(cell, one, x) for one in (relative, found))

    assert loose.relative
    assert not tight.relative
    assert set(loose.errors.source) == set(tight.errors.source)
    for source in set(tight.errors.source):
        V, found_V, stated_V = (
            (G @ G.T).toarray()
            for G in (
                one.errors.G[:, one.errors.source == source]
                for one in (loose, tight, assemble(cell, data, x))
            )
        )
        unit_m = 3e-5 if source in ("tracker", "zero", "direction") else 1.0
        near = {"rel": 1e-6, "abs": 1e-8 * found_V.max()}
        assert found_V == pytest.approx(V * unit_m**2, **near)
        assert found_V == pytest.approx(stated_V, **near)


def test_each_row_is_the_coordinate_it_says(cell, data):
    """Changing one coordinate of one displacement changes the row of that name, and no other."""
    x = cell.robot.nominal_compliance
    before = assemble(cell, data, x)
    rows = before.rows
    for displacement, axis in ((0, 2), (7, 0), (len(data.pull) - 1, 1)):
        delta = data.delta.copy()
        delta[displacement, axis] += 1e-3
        (row,) = np.flatnonzero(assemble(cell, replace(data, delta=delta), x).c != before.c)
        pull = data.pull[displacement]
        assert (rows.pose[row], rows.repeat[row]) == (
            data.pulls.pose[pull],
            data.pulls.repeat[pull],
        )
        assert (rows.pull[row], rows.axis[row]) == (pull, axis)
        assert rows.target[row] == data.name[displacement]
    order = np.lexsort((rows.axis, rows.target.astype(str), rows.repeat, rows.pose))
    assert order.tolist() == list(range(len(rows)))


def test_a_model_that_is_not_linear_is_met_where_it_stands(cell, data):
    """The residual at x0 is c - B x0, and B is the change by a small step of each parameter."""
    effect = next(e for e in catalogue(cell.robot) if e.name == "rail_backlash")
    wide = cell.with_effects(effect)
    typical = np.array([p.typical for p in wide.parameters])
    x = np.append(cell.robot.nominal_compliance, 0.6 * typical[7:])

    def displaced(values):
        return predict(wide, data.pulls, values).displacement[data.pull, data.target].ravel()

    system = assemble(wide, data, x)

    assert system.c - system.B @ x == pytest.approx(data.delta.ravel() - displaced(x), abs=1e-15)
    for k, size in enumerate(typical):
        step = np.zeros(len(x))
        step[k] = 1e-3 * size
        slope = (displaced(x + step) - displaced(x - step)) / (2e-3 * size)
        assert system.B[:, k] == pytest.approx(slope, rel=1e-6, abs=1e-6 * np.abs(slope).max())


def test_a_newton_more_moves_the_reflectors_along_the_pull(cell, data):
    """`by_force` is the change of the model's displacement for forces larger by 1 N."""
    x, force = cell.robot.nominal_compliance, data.pulls.force
    longer = force + force / np.linalg.norm(force, axis=1, keepdims=True)
    more, here = (
        predict(cell, with_force(data, one).pulls, x).displacement[data.pull, data.target].ravel()
        for one in (longer, force)
    )

    assert by_force(cell, data, x) == pytest.approx(more - here, rel=1e-6, abs=1e-15)
