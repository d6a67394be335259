"""Where the uncertainty of a stiffness comes from."""

import re

import numpy as np
import pytest

from pipeline.machine.cell import paper_cell
from pipeline.reduction.bring import conformed
from pipeline.run import reduce, tool
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.budget import budget
from pipeline.system.estimate import identify

PLAN = Plan(name="budget", seed=7, poses={"count": 8}, scale={"sigma_n": 5.0, "gain_sigma": 3e-3})
EVERY = ["tracker", "zero", "force_reading", "direction", "registration", "force_gain", "geometry"]


def identified(files):
    """System and estimate of a campaign's files."""
    raw = in_memory(files)
    data = reduce(raw, conformed).data
    start = raw.robot.nominal_compliance
    return identify(paper_cell(raw.robot, tool(raw.settings)), data, start)


def edited(files, old, new):
    """The files with one change in campaign.toml."""
    text = files["campaign.toml"].decode()
    assert re.search(old, text)
    return {**files, "campaign.toml": re.sub(old, new, text, count=1).encode()}


def with_tool_uncertainty(files, sigma):
    text = files["campaign.toml"].decode() + f"\n[tool_uncertainty]\nsigma_m = {sigma}\n"
    return {**files, "campaign.toml": text.encode()}


def test_contributions_add_up_to_the_covariance():
    """Every source is there, and nothing is lost or counted twice."""
    files = with_tool_uncertainty(simulate(PLAN).files, 5e-5)
    system, estimate = identified(files)

    split = budget(system, estimate)

    assert list(split.source) == EVERY
    ratio = split.cov.sum(axis=0) / np.sqrt(np.outer(*[np.diag(estimate.cov)] * 2))
    expected = estimate.cov / np.sqrt(np.outer(*[np.diag(estimate.cov)] * 2))
    assert ratio == pytest.approx(expected, abs=1e-9)
    assert split.share.sum(axis=0) == pytest.approx(1.0)


def test_a_gain_error_moves_all_stiffnesses_alike():
    """The scale's gain of 0.3 % is 0.3 % of every stiffness, from no other source."""
    system, estimate = identified(simulate(PLAN).files)

    split = budget(system, estimate)
    gain = split.std[list(split.source).index("force_gain")]

    assert gain == pytest.approx(3e-3 * estimate.value, rel=1e-6)


def test_the_part_of_the_geometry_is_what_wrong_tool_points_do():
    """Move each coordinate of the tool by hand, identify again, and add the squares."""
    files = simulate(PLAN.without_noise()).files
    system, estimate = identified(with_tool_uncertainty(files, 1e-9))
    split = budget(system, estimate)
    claimed = split.std[list(split.source).index("geometry")] * 1e5

    moved = []
    step = 1e-4
    for name, at in PLAN.tool.items():
        for axis in range(3):
            point = list(at)
            point[axis] += step
            _, other = identified(edited(files, rf"\n{name} = .*", f"\n{name} = {point}"))
            moved.append(other.value - estimate.value)

    assert claimed == pytest.approx(np.linalg.norm(moved, axis=0), rel=0.02)


def test_the_part_of_the_joints_is_what_a_wrong_zero_does():
    """Turn the log of each joint by hand, identify again, and add the squares."""
    files = simulate(PLAN.without_noise()).files
    said = edited(files, r'file = "joints.csv"', 'file = "joints.csv"\nsigma_rad = 1e-9')
    system, estimate = identified(said)
    split = budget(system, estimate)
    claimed = split.std[list(split.source).index("geometry")] * 1e5

    head, *lines = files["joints.csv"].decode().splitlines()
    rows = np.array([[float(v) for v in line.split(",")] for line in lines])
    moved = []
    for joint in range(2, 8):
        turned = rows.copy()
        turned[:, joint] += np.rad2deg(1e-4)
        text = [
            head,
            *(
                ",".join([f"{r[0]:.0f}", *map(repr, r[1:-1]), f"{r[-1]:.0f}"])
                for r in turned.tolist()
            ),
        ]
        _, other = identified({**files, "joints.csv": "\n".join(text).encode()})
        moved.append(other.value - estimate.value)

    assert claimed == pytest.approx(np.linalg.norm(moved, axis=0), rel=0.02)


def test_a_quieter_scale_leaves_the_trackers_part_alone():
    """Without force noise the part of the force reading is zero."""
    quiet = revised(PLAN, {"scale": {"sigma_n": 0.0}})
    system, estimate = identified(simulate(quiet).files)

    assert "force_reading" not in budget(system, estimate).source
