"""What errs from pose to pose: a joint, or the carriage of a rail that is not straight.

The machine is computed with Pinocchio only and weighs nothing.
"""

from dataclasses import replace

import numpy as np
import pytest
from heavy_robot import TOOL, HeavyRobot, Truth, errors_of_table, read

from pipeline.machine.robot import load
from pipeline.positions.calibrate import ModelStructure
from pipeline.positions.initial import begin
from pipeline.positions.joint_laws import LawSearchData
from pipeline.positions.mechanism import ArmWeights, Payloads
from pipeline.positions.pose_errors import unusual
from pipeline.positions.scatter import start
from pipeline.positions.study import ModelStage, StageResult, Study

ROBOT = load("kr500_rail_kuka")
NOTHING = Payloads((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)))
POSES = 150


def short_waves(size):
    """A rail with waves of 0.11 to 0.17 m in all motions but along itself (z of its own frame)."""
    period = np.array([0.11, 0.13, 1.0, 0.17, 0.12, 0.14])

    def rail(along):
        return size * np.sin(2 * np.pi * along / period + np.arange(6))

    return rail


def identified(rail=None, errors=(0.0,) * 7, seed=4):
    """DH parameters and a smooth rail, estimated from readings of one target."""
    rng = np.random.default_rng(seed)
    low, high = np.deg2rad([[-60, 0, -30, -120, -100, -170], [60, 80, 60, 120, 100, 170]])
    q = np.column_stack([rng.uniform(0.5, 6.5, POSES), rng.uniform(low, high, (POSES, 6))])
    truth = Truth(np.zeros(7), rail=rail, mass=np.full(7, 1e-9))
    machine = HeavyRobot(ROBOT, errors_of_table(8, rng), truth)
    stands = q + np.asarray(errors) * rng.standard_normal(q.shape)
    seen = read(machine, stands, rng, noise=2e-5)
    readings = replace(
        seen, q=q, targets=seen.targets[:1], six=seen.six[:1], at=seen.at[:, :1],
        turn=seen.turn[:, :1],
    )  # fmt: skip
    weights = ArmWeights(np.zeros(3), NOTHING, np.zeros(POSES, dtype=np.int64))
    every = LawSearchData(readings, weights, (np.nan, np.nan), start(ROBOT, 2e-5))
    begun = begin(ROBOT, readings, {"P1": TOOL[0]})
    found = every.identify(begun, ModelStructure(springs=False, bed=True))
    return Study((StageResult(ModelStage.LAWS, found, {}),), (), ())


@pytest.mark.whole
def test_a_rail_with_waves_shorter_than_between_stations_is_the_carriage():
    """Joints cannot move a target as the carriage does, by 0.3 mm and 0.1 mrad rms here."""
    size = np.sqrt(2) * np.array([3e-4, 3e-4, 0.0, 1e-4, 1e-4, 1e-4])
    errs = unusual(identified(short_waves(size)))

    assert errs is not None
    assert errs.on_rail
    across = [k for k in range(3) if k != int(np.abs(ROBOT.placement[0][:3, 2]).argmax())]
    assert errs.carriage[across] == pytest.approx([3e-4, 3e-4], rel=0.5)


@pytest.mark.whole
@pytest.mark.parametrize(("joint", "error"), [(0, 5e-4), (1, 5e-4), (3, 5e-4)])
def test_a_joint_that_errs_on_a_rail_is_not_the_carriage(joint, error):
    errs = unusual(identified(errors=np.where(np.arange(7) == joint, error, 1e-5)))

    assert errs is not None
    assert errs.joints[0] == joint
    assert not errs.on_rail
    assert (errs.carriage is None) == (joint > 1)  # a drive, or a turn about the axis of joint 1


@pytest.mark.whole
def test_joints_that_err_as_usual_on_a_rail_are_none():
    assert unusual(identified(errors=[5e-5, *[1e-4] * 6])) is None
