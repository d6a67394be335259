"""An arm without a rail on a base that yields, made by a machine of 4 x 4 matrices."""

from functools import partial

import numpy as np
import pytest

from bench.league.machine import Machine, Spring
from pipeline.machine.robot import axes, load
from pipeline.run import campaign_answer
from pipeline.store.campaign import in_memory

FANUC, POSES, NOISE_M = load("fanuc_r2000ic"), 20, 1e-5

TOML = """
format = 1
name   = "pedestal"
robot  = "fanuc_r2000ic"

[displacements]
file    = "displacements.csv"
forces  = "forces.csv"
sigma_m = 1e-5

[joints]
file = "joints.csv"

[tool]
load_point = [0.0, 0.1, 0.3]
A          = [0.2, 0.1, 0.2]
B          = [-0.2, 0.15, 0.15]
C          = [0.0, -0.25, 0.3]
"""


def rows(head, *columns):
    """A csv of columns side by side."""
    table = np.column_stack([np.asarray(one, object) for one in columns])
    return "\n".join([head, *(",".join(map(str, row)) for row in table)]).encode()


def campaign(below, seed, first=140.0):
    """Two pulls at each pose, with springs of the joints and of the base; joint 1 turns so far."""
    rng = np.random.default_rng(seed)
    far = np.deg2rad([first, 40.0, 40.0, 160.0, 90.0, 160.0])
    q = np.repeat(rng.uniform(-far, far, (POSES, 6)), 2, axis=0)
    way = rng.standard_normal((2 * POSES, 3))
    force = rng.uniform(200, 600, (2 * POSES, 1)) * way / np.linalg.norm(way, axis=1)[:, None]
    c = FANUC.nominal_compliance * rng.uniform(0.8, 1.2, 6)
    points = np.array([[0.2, 0.1, 0.2], [-0.2, 0.15, 0.15], [0.0, -0.25, 0.3]])

    def settled(size):
        own = [
            Spring(f"j{k}", k + 1, (0, 0, 1), False, lambda t, _, c=c[k]: size * c * t)
            for k in range(6)
        ]
        return Machine(FANUC, own + below(size, c)).settle(
            q, points, np.array([0, 0.1, 0.3]), force
        )[0]

    moved = settled(1.0) - settled(0.0)
    moved = (moved + NOISE_M * rng.standard_normal(moved.shape)).reshape(-1, 3)
    pose, repeat = np.repeat(np.arange(1, POSES + 1), 2), np.tile([1, 2], POSES)
    each = [np.repeat(pose, 3), np.repeat(repeat, 3), np.tile(list("ABC"), 2 * POSES)]
    shown = axes.displayed(FANUC, q[::2])
    joints = ",".join(f"J{k}_deg" for k in range(1, 7))
    return in_memory(
        {
            "campaign.toml": TOML.encode(),
            "displacements.csv": rows("pose,repeat,target,dx_m,dy_m,dz_m", *each, *moved.T),
            "forces.csv": rows("pose,repeat,fx_n,fy_n,fz_n", pose, repeat, *force.T),
            "joints.csv": rows("pose," + joints, np.arange(1, POSES + 1), *shown.T),
        }
    )


def base(size, c, height, more=1.4, share=0.15):
    """A cantilever: its top turns about its middle, and shears by H^2 / 12 of that."""
    at, turn = (0.0, 0.0, -FANUC.placement[0][2, 3] - height / 2), share * size * c[0]
    softness = {"x": more, "y": 1.0}  # in the plane across the axis
    axes_of = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}

    def spring(name, axis, slides, k):
        return Spring(name, 1, axes_of[axis], slides, lambda own, _: k * own, at, True)

    return [
        *(spring(f"r{a}", a, False, turn * softness[b]) for a, b in ("xy", "yx")),
        *(spring(f"t{a}", a, True, turn * softness[a] * height**2 / 12) for a in "xy"),
    ]


def causes(made):
    """Name, and those of the rivals, of each cause found."""
    found = campaign_answer("pedestal", made).answer.diagnosis
    return str(found.verdict), [
        ({one.name}, {rival.name for rival in one.rivals}) for one in found.causes
    ]


@pytest.mark.whole
def test_a_column_that_bends_under_an_arm_is_the_pedestal():
    """Where joint 1 turns, it is the pedestal and nothing else."""
    made = campaign(partial(base, height=1.0), 1)

    assert causes(made) == ("explained", [({"pedestal_tilt"}, set())])


@pytest.mark.whole
def test_axes_between_those_of_two_forms_make_no_other_cause_certain():
    """A column of 0.8 m: the pedestal is certain, and what its form leaves is no name."""
    answer = campaign_answer("pedestal", campaign(partial(base, height=0.8), 1)).answer
    chance = {one.name: one.probability for one in answer.diagnosis.causes}

    assert chance.pop("pedestal_tilt") > 0.99
    assert all(other < 0.5 for other in chance.values())


@pytest.mark.whole
@pytest.mark.parametrize(("below", "first"), [({}, 0.5), ({"more": 1.0, "share": 1.8}, 140.0)])
def test_where_both_are_one_its_bearing_is_a_rival(below, first):
    """Pulls at one angle of joint 1, or a base as soft in both directions, of any size."""
    made = campaign(partial(base, height=0.0, **below), 1, first=first)
    verdict, [(name, rivals), *more] = causes(made)

    assert verdict == "ambiguous"
    assert name | rivals >= {"pedestal_tilt", "joint_tilt"}
    assert not more


@pytest.mark.whole
def test_an_arm_on_a_rigid_base_has_no_pedestal():
    """Joint springs alone are all that is found."""
    assert causes(campaign(lambda size, c: [], 2)) == ("adequate", [])
