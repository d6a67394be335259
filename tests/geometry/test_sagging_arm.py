"""An arm that sags under its links' weight: deflections from the potential energy of the chain.

The chain of the KR500 is multiplied here, and torques are differences of the energy of its links.
"""

from dataclasses import replace

import numpy as np
import pytest
from rail_chain import ALPHA, LETTERS, POINTS, D, R, stands, step

from pipeline.diagnosis.unloaded_geometry import from_unloaded
from pipeline.geometry.roughness import products, unrefined
from pipeline.geometry.unloaded import unloaded
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale

KR500 = load("kr500_rail")
MASS = [300.0, 350.0, 480.0, 420.0, 90.0, 60.0, 80.0]
CENTRE = [[0, 0, 0.1], [0.2, 0.1, -0.2], [0.5, 0.05, 0.1], [0.1, 0.1, 0.3], [0, 0, -0.2], [0, 0, 0],
          [0.05, 0, 0.15]]  # fmt: skip
POSES, NOISE_M = 16, 2e-5
DOWN = np.array([0.0, 0.0, -9.81])
TOOL = Tool(np.array([0.15, 0.0, 0.25]), np.array(["P1", "P2", "P3"], object), POINTS)


def energy(q, gravity):
    """Potential energy of all links [N m]."""
    T, U = np.eye(4), 0.0
    for j, (mass, centre) in enumerate(zip(MASS, CENTRE, strict=True)):
        theta, r = (0.0, R[j] + q[0]) if j == 0 else (q[j], R[j])
        T = T @ step("R", 0, ALPHA[j]) @ step("T", 0, D[j])
        T = T @ step("R", 2, theta) @ step("T", 2, r)
        U -= mass * gravity @ (T @ [*centre, 1.0])[:3]
    return U


def sagged(q, gravity):
    """Joint values under the weight; the rail does not give way."""
    c, out = KR500.nominal_compliance, q.copy()
    for j, h in zip(range(1, 7), 1e-4 * np.eye(7)[1:], strict=True):
        out[:, j] -= c[j] * np.array([
            (energy(one + h, gravity) - energy(one - h, gravity)) / 2e-4 for one in q
        ])  # fmt: skip
    return out


def measured(seed, gravity=DOWN, wrong=None):
    """Unloaded readings of a sagging arm with usual errors of its table."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(KR500.lower, KR500.upper, (POSES, 7))
    entries = {one.label: 2e-4 * rng.standard_normal() for one in LETTERS if one.joint > 1}
    entries |= {label: entries[label] + size for label, size in (wrong or {}).items()}
    at = stands(sagged(q, gravity), entries).reshape(-1, 3)
    at = at + NOISE_M * rng.standard_normal(at.shape)
    none, d = np.zeros(POSES), 3 * POSES
    noise = np.tile(NOISE_M**2 * np.eye(3), (d, 1, 1))
    pulls = Pulls(np.arange(POSES) + 1, none.astype(int), q, np.ones((POSES, 3)), *[none] * 4)
    return Measured(
        pulls=pulls, pull=np.repeat(np.arange(POSES), 3), target=np.tile(np.arange(3), POSES),
        name=np.tile(TOOL.targets, POSES), delta=np.zeros((d, 3)), unloaded=at, loaded_cov=noise,
        zero_cov=noise, zero=np.arange(d), reading_std=none + 1,
        direction_cov=np.zeros((POSES, 3, 3)), rotation_cov=1e-10 * np.eye(3), scale=Scale(),
        noise_stated=True, joint_std=np.zeros(7),
    )  # fmt: skip


def found(data):
    return from_unloaded(paper_cell(KR500, TOOL), data, 1.0, catalogue(KR500))


def test_the_weight_leaves_nothing_to_the_joints():
    """Estimated beside the table, also where no listed cause stands for it."""
    data = measured(1)
    left = []
    for weighs in (False, True):
        zeros = replace(unloaded(KR500, TOOL, None, data, 1.0), weighs=weighs)
        rows = zeros.about(np.zeros(zeros.columns.count))
        left.append(unrefined(zeros, products(rows)).transmission @ unrefined(
            zeros, products(rows)).weight)  # fmt: skip

    assert left[0] > 1.0
    assert left[1] < 0.2


@pytest.mark.whole
def test_a_typed_length_stands_out_beside_the_sag():
    """27 mm in one entry, as 1.258 for 1.285."""
    stood = found(measured(2, wrong={"link_offset:5": 0.027}))

    assert "link_offset:5" in [one.effect.label for one in stood.causes]
    assert stood.left_m < 5e-5
    assert not stood.unexplained


@pytest.mark.whole
def test_gravity_along_another_axis_is_said():
    """The arm hangs on a wall: what is left is stated, and the axis that explains it."""
    stood = found(measured(3, gravity=np.array([0.0, 9.81, 0.0])))

    assert stood.unexplained
    assert stood.down[0] == "+y"
    assert stood.down[1] < 5e-5


@pytest.mark.whole
def test_nothing_is_said_of_an_arm_that_hangs_as_stated():
    """Though it sags by millimetres."""
    stood = found(measured(4))

    assert stood.weighs
    assert not stood.causes
    assert not stood.unexplained
    assert stood.corrects
    assert stood.left_m < 5e-5 < 1e-3 < stood.miss_m


@pytest.mark.whole
def test_links_that_nobody_sees_weigh_nothing():
    """An arm as stiff as its joint log, with the same errors of its table."""
    assert not found(measured(5, gravity=np.zeros(3))).weighs


@pytest.mark.whole
@pytest.mark.parametrize("since", [5, 9])
def test_a_bumped_foot_is_named_beside_the_sag(since):
    """By 0.7 mm, a quarter of the sag; compared where the arm is, 9 m off the origin of F_b."""
    data = measured(6)
    shift = 4e-4 * np.array([1, -1, 1])
    at = data.unloaded + shift * (data.pull[:, None] >= since)
    (cause,) = found(replace(data, unloaded=at)).causes

    assert cause.effect.name == "base_moved"
    assert cause.probability > 0.95
    there = cause.value[:3] + np.cross(cause.value[3:], at.mean(axis=0))
    assert there == pytest.approx(shift, abs=5e-5)
    assert np.max(np.abs(cause.value - [*shift, 0, 0, 0]) / cause.std) < 4
