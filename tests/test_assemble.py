"""Each column of the error factors is what that error really does to c - B x."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.machine.cell import paper_cell
from pipeline.reduction.bring import conformed
from pipeline.run import reduce, tool
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.assemble import assemble


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
    """What the nominal compliances leave of c."""
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
    """One standard uncertainty on the fifth scale reading changes c - B x as its column says."""
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


def test_a_turned_tracker_turns_displacements_and_forces(cell, data):
    """The registration's columns are those of small rotations, however they are combined."""
    G = block(cell, data, "registration")
    changes = []
    for axis in np.eye(3):
        turn = Rotation.from_rotvec(1e-7 * axis).as_matrix()
        turned = replace(with_force(data, data.pulls.force @ turn.T), delta=data.delta @ turn.T)
        changes.append((misfit(cell, turned) - misfit(cell, data)) / 1e-7)
    D = np.array(changes).T

    assert pytest.approx(D @ data.rotation_cov @ D.T, abs=1e-17) == G @ G.T


def test_the_direction_moves_as_its_covariance_says(cell, data):
    """First order propagation of every pull's direction covariance, by differences."""
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
