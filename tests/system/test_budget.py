"""Uncertainty budget of a stiffness."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse

from bench.reduced import reduce
from pipeline.base.arrays import Parameter
from pipeline.machine.cell import paper_cell
from pipeline.reduction.bring import conformed
from pipeline.reduction.effector import tool
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.budget import budget
from pipeline.system.estimate import identify, solve
from pipeline.system.system import Errors, RowIndex, System

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


def with_tool_uncertainty(files, sigma, key="sigma_m"):
    text = files["campaign.toml"].decode() + f"\n[tool_uncertainty]\n{key} = {sigma}\n"
    return {**files, "campaign.toml": text.encode()}


def test_contributions_add_up_to_the_covariance():
    """Every source is present, and nothing is lost or counted twice."""
    files = with_tool_uncertainty(simulate(PLAN).files, 5e-5)
    system, estimate = identified(files)

    split = budget(system, estimate)

    assert list(split.source) == EVERY
    ratio = split.cov.sum(axis=0) / np.sqrt(np.outer(*[np.diag(estimate.cov)] * 2))
    expected = estimate.cov / np.sqrt(np.outer(*[np.diag(estimate.cov)] * 2))
    assert ratio == pytest.approx(expected, abs=1e-9)
    assert split.share.sum(axis=0) == pytest.approx(1.0)


def test_a_gain_error_moves_all_stiffnesses_alike():
    """A scale gain uncertain by 0.3 % gives 0.3 % of every stiffness, and no other source does."""
    system, estimate = identified(simulate(PLAN).files)

    split = budget(system, estimate)
    gain = split.std[list(split.source).index("force_gain")]

    assert gain == pytest.approx(3e-3 * estimate.value, rel=1e-6, abs=0)


@pytest.mark.parametrize(
    ("key", "points"),
    [
        pytest.param("sigma_m", [*PLAN.tool], marks=pytest.mark.whole),
        ("load_point_sigma_m", ["load_point"]),
    ],
)
def test_the_part_of_the_geometry_is_what_wrong_tool_points_do(key, points):
    """Shift each coordinate of the tool, or of its load point, identify again, add the squares."""
    files = simulate(PLAN.without_noise()).files
    system, estimate = identified(with_tool_uncertainty(files, 1e-9, key))
    split = budget(system, estimate)
    claimed = split.std[list(split.source).index("geometry")] * 1e5

    moved = []
    step = 1e-4
    for name in points:
        for axis in range(3):
            point = list(PLAN.tool[name])
            point[axis] += step
            _, other = identified(edited(files, rf"\n{name} = .*", f"\n{name} = {point}"))
            moved.append(other.value - estimate.value)

    assert claimed == pytest.approx(np.linalg.norm(moved, axis=0), rel=0.02)


@pytest.mark.whole
def test_the_part_of_the_joints_is_what_a_wrong_zero_does():
    """Shift the log of each joint, identify again, and add the squares."""
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
    """Without force noise the contribution of the force reading is zero."""
    quiet = revised(PLAN, {"scale": {"sigma_n": 0.0}})
    system, estimate = identified(simulate(quiet).files)

    assert "force_reading" not in budget(system, estimate).source


TYPICAL = np.array([2e-8, 3e-7, 1e-6])


def made(rng, stated=True):
    """Four poses, and columns of five sources in any order, one of them without contribution."""
    pose = rng.permutation(np.repeat([4, 9, 2, 7], [5, 3, 6, 4]))
    M = len(pose)
    B = rng.standard_normal((M, 3)) * 2e-3 / TYPICAL
    parts = {
        "zero": (pose[:, None] == np.unique(pose)) * 3e-5,
        "registration": 1e-4 * rng.standard_normal((M, 2)),
        "tracker": np.diag(rng.uniform(1e-5, 6e-5, M)),
        "direction": np.diag(rng.uniform(1e-5, 6e-5, M)),
        "geometry": np.zeros((M, 1)),
    }
    source = np.concatenate([[name] * part.shape[1] for name, part in parts.items()])
    order = rng.permutation(len(source))
    errors = Errors(
        scipy.sparse.csr_array(np.hstack(list(parts.values()))[:, order]),
        source[order].astype(object),
        np.isin(source[order], ["registration", "geometry"]),
    )
    return System(
        parameters=tuple(Parameter(f"c{k}", "m/N", t) for k, t in enumerate(TYPICAL)),
        rows=RowIndex(pose, pose, np.full(M, "P1", object), np.zeros(M, int), np.arange(M)),
        B=B,
        c=B @ TYPICAL + errors.G @ rng.standard_normal(len(source)),
        errors=errors,
        noise_stated=stated,
    )


def moved(system, column):
    """Change of the estimate by one standard uncertainty of one error, identified again."""
    c = system.c + system.errors.G[:, [column]].toarray()[:, 0]
    return solve(replace(system, c=c), TYPICAL).value - solve(system, TYPICAL).value


@pytest.mark.parametrize("seed", range(4))
def test_each_source_does_what_its_errors_do_to_the_estimate(seed):
    """Each error shifted by one standard uncertainty in turn, and the estimate repeated."""
    system = made(np.random.default_rng(seed))
    estimate = solve(system, TYPICAL)

    split = budget(system, estimate)

    unit = np.outer(TYPICAL, TYPICAL)
    assert list(split.source) == list(dict.fromkeys(system.errors.source))
    for name, cov in zip(split.source, split.cov, strict=True):
        columns = np.flatnonzero(system.errors.source == name)
        expected = sum(np.outer(d, d) for d in (moved(system, column) for column in columns))
        assert cov / unit == pytest.approx(expected / unit, rel=1e-6, abs=1e-13)
    assert split.cov.sum(axis=0) / unit == pytest.approx(estimate.cov / unit, rel=1e-9, abs=1e-14)
    assert split.std**2 == pytest.approx(
        np.array([np.diag(cov) for cov in split.cov]), rel=1e-6, abs=0
    )
    assert split.share == pytest.approx(split.std**2 / estimate.std**2)


def test_one_source_alone_has_the_whole_uncertainty():
    """If only the tracker contributes, its share is the covariance, including correlations."""
    system = made(np.random.default_rng(8))
    mine = system.errors.source == "tracker"
    alone = Errors(system.errors.G[:, mine], system.errors.source[mine], system.errors.common[mine])
    system = replace(system, errors=alone)
    estimate = solve(system, TYPICAL)

    split = budget(system, estimate)

    assert list(split.source) == ["tracker"]
    assert split.cov[0] == pytest.approx(estimate.cov, rel=1e-9, abs=0)
    assert split.share == pytest.approx(np.ones((1, 3)))


def test_where_no_noise_is_stated_the_parts_are_scaled_as_the_whole():
    """Contributions are scaled like the covariance, and sum to it."""
    stated, relative = (made(np.random.default_rng(3), stated) for stated in (True, False))
    one, two = (budget(system, solve(system, TYPICAL)) for system in (stated, relative))

    assert two.share == pytest.approx(one.share)
    assert two.cov.sum(axis=0) == pytest.approx(solve(relative, TYPICAL).cov, rel=1e-8, abs=0)
    found = replace(relative, found_m=3e-5)
    again = budget(found, solve(found, TYPICAL)).cov
    assert again == pytest.approx(one.cov, rel=1e-8, abs=0)


def test_what_nothing_determines_has_no_share_and_spoils_none():
    """A parameter without effect: its contributions are zero, those of the others sum to one."""
    system = made(np.random.default_rng(5))
    system = replace(system, B=system.B * [1, 0, 1])

    split = budget(system, solve(system, TYPICAL))

    assert not split.share[:, 1].any()
    assert split.share[:, [0, 2]].sum(axis=0) == pytest.approx(np.ones(2))
