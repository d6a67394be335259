"""`pipeline design --robot` for another robot than that of the paper: a problem of its own size."""

import numpy as np
import pytest

from pipeline.design import spec as specs
from pipeline.design.library import problem_of
from pipeline.design.planfile import problem_text
from pipeline.machine.robot import configure, load

OTHERS = ("ur10e", "kr210_r2700_2", "fanuc_m20ia", "gp180", "irb6700_200_260", "ur3e")


@pytest.mark.parametrize("name", OTHERS)
def test_another_robot_gets_a_problem_of_its_own_size(name):
    """No tool, pull, anchor or test pose of a KR500 is left, and the problem says so."""
    made, robot = problem_of("paper_reference", {"robot": name}), load(name)
    weight = 9.81 * robot.payload_kg
    q = np.zeros((1, robot.n)).clip(robot.lower, robot.upper)
    arm = np.linalg.norm(np.diff(configure(robot, q).origin[0], axis=0), axis=1).sum()
    ring = max(np.linalg.norm(at) for at in made.spec.tool.values())

    assert made.spec.name == name
    assert made.criterion.meaning
    assert made.spec.criterion.kind == "workspace"
    assert not made.spec.test_pose
    assert 0.1 * weight < max(made.spec.pull.steps_n) < weight
    assert 0.03 < ring / arm < 0.3
    assert made.anchor_upper[0] < 1.5 * arm
    assert made.anchor_upper[2] == 0.0
    assert "not yours" in made.spec.assumptions[0]


def test_what_is_said_goes_before_what_suits():
    """An own name, step, anchor and number of poses stand."""
    said = {"robot": "ur10e", "name": "hall7", "pull": {"steps_n": [50.0]},
            "anchor": {"x_m": 1.0, "y_m": 0.1, "z_m": 0.2}, "plan": {"poses": 6}}  # fmt: skip
    made = problem_of("paper_reference", said)

    assert made.spec.name == "hall7"
    assert made.spec.pull.steps_n == [50.0]
    assert made.anchor_lower.tolist() == [1.0, 0.1, 0.2]
    assert made.poses == 6


def test_robots_like_the_papers_keep_its_problem():
    """The same joints on the same rail: tool, anchor and test pose are of that cell."""
    made = problem_of("paper_reference", {"robot": "kr500_rail_kuka"})

    assert made.spec.test_pose
    assert made.spec.tool == problem_of("paper_reference", {}).spec.tool


@pytest.mark.parametrize("name", [*specs.SHIPPED, "ur10e"])
def test_a_problem_is_written_as_it_was_solved(name):
    """Its TOML gives the same problem again: cell, acceptance, programmes, pulls."""
    made = problem_of(name, {}) if name in specs.SHIPPED else problem_of("paper_reference",
                                                                       {"robot": name})  # fmt: skip

    assert specs.parse(problem_text(made.spec)).model_dump() == made.spec.model_dump()
