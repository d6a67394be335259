"""B for 10 000 readings against a loop over Pinocchio; the solve against numpy's lstsq."""

import numpy as np
import pinocchio as pin

from bench.timing import ratio
from pipeline.campaign import in_memory
from pipeline.cell import Tool, jacobian, paper_cell
from pipeline.effects import Pulls
from pipeline.robot import load
from pipeline.robot.model import model
from pipeline.run import reduce, tool
from pipeline.simulate import Plan, simulate
from pipeline.stages.assemble import assemble
from pipeline.stages.estimate import solve
from pipeline.stages.whiten import whitener
from pipeline.tables import conform

READINGS = 10_000


def run() -> list[tuple[str, float, str]]:
    """Ratios, each with its target."""
    return [_assembly(), *_solve()]


def _assembly() -> tuple[str, float, str]:
    robot = load("kr500_rail")
    points = {"P1": [0.20, 0.05, 0.12]}
    effector = Tool(np.array([0.15, 0, 0.25]), np.array(["P1"], object), np.array([points["P1"]]))
    cell = paper_cell(robot, effector)
    rng = np.random.default_rng(1)
    q = rng.uniform(robot.lower, robot.upper, (READINGS, robot.n))
    force = rng.normal(size=(READINGS, 3)) * 1000
    none = np.zeros(READINGS)
    pulls = Pulls(none.astype(int), none.astype(int), q, force, none, none, none, none)
    built = model(robot, {"load": effector.load_point, **points})
    data = built.createData()
    at, tip = built.getFrameId("P1"), built.getFrameId("load")

    def looped() -> np.ndarray:
        out = np.empty((READINGS, 3, robot.n))
        for i in range(READINGS):
            pin.computeJointJacobians(built, data, q[i])
            pin.updateFramePlacements(built, data)
            J = pin.getFrameJacobian(built, data, at, pin.LOCAL_WORLD_ALIGNED)[:3]
            Jl = pin.getFrameJacobian(built, data, tip, pin.LOCAL_WORLD_ALIGNED)[:3]
            out[i] = J * (Jl.T @ force[i])
        return out

    def batched() -> np.ndarray:
        return jacobian(cell, pulls, robot.nominal_compliance)[:, 0]

    gap = np.abs(looped() - batched()).max() / np.abs(looped()).max()
    times = ratio(batched, looped, runs=5)
    return "B of 10 000 readings: Pinocchio loop / batched", times, f"aim >= 10; gap {gap:.0e}"


def _solve() -> list[tuple[str, float, str]]:
    raw = in_memory(simulate(Plan(name="bench")).files)
    data = reduce(raw, lambda _, table, promise: conform(table, promise).to_pandas()).data
    typical = raw.robot.nominal_compliance
    cell = paper_cell(raw.robot, tool(raw.settings))
    system = assemble(cell, data, typical)
    white = whitener(system.errors, system.rows.pose)
    A, y = white(system.B) * typical, white(system.c)

    def plain() -> object:
        return np.linalg.lstsq(white(system.B) * typical, white(system.c), rcond=None)

    same = np.abs(solve(system, typical, white).value / plain()[0] / typical - 1).max()
    return [
        (
            "solve of 432 rows with covariance and chi2 / lstsq",
            ratio(
                lambda: np.linalg.lstsq(A, y, rcond=None), lambda: solve(system, typical, white), 51
            ),
            f"aim <= 3; both from whitened rows; values differ by {same:.0e}",
        ),
        (
            "the same, whitening included on both sides",
            ratio(plain, lambda: solve(system, typical, white), 51),
            "aim <= 3",
        ),
    ]
