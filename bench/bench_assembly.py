"""B for 10 000 readings compared with a loop over Pinocchio; the solver with numpy's lstsq."""

import numpy as np
import pinocchio as pin

from bench.as_pinocchio import model
from bench.reduced import reduce
from bench.timing import ratio
from pipeline.machine.cell import Tool, jacobian, paper_cell
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import load
from pipeline.reduction.bring import conformed
from pipeline.reduction.effector import tool
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.assemble import assemble
from pipeline.system.estimate import least_squares, solve
from pipeline.system.whiten import whitener

READINGS = 9_999


def run() -> list[tuple[str, float, str]]:
    """Ratios, each with its target."""
    return [*_assembly(), *_solve()]


def _assembly() -> list[tuple[str, float, str]]:
    robot = load("kr500_rail")
    pull = Plan(name="bench").tool
    points = {name: at for name, at in pull.items() if name != "load_point"}
    effector = Tool(
        np.array(pull["load_point"]),
        np.array(list(points), object),
        np.array(list(points.values())),
    )
    cell = paper_cell(robot, effector)
    rng = np.random.default_rng(1)
    m = READINGS // len(points)
    q = rng.uniform(robot.lower, robot.upper, (m, robot.n))
    force = rng.normal(size=(m, 3)) * 1000
    none = np.zeros(m)
    pulls = Pulls(none.astype(int), none.astype(int), q, force, none, none, none, none)
    built = model(robot, {"load": effector.load_point, **points})
    data = built.createData()
    at, tip = [built.getFrameId(name) for name in points], built.getFrameId("load")

    def rows(i: int, frame: int) -> np.ndarray:
        J = pin.getFrameJacobian(built, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        Jl = pin.getFrameJacobian(built, data, tip, pin.LOCAL_WORLD_ALIGNED)[:3]
        return J * (Jl.T @ force[i])

    def reading_by_reading() -> np.ndarray:
        out = np.empty((m, len(at), 3, robot.n))
        for i in range(m):
            for t, frame in enumerate(at):
                pin.computeJointJacobians(built, data, q[i])
                pin.updateFramePlacements(built, data)
                out[i, t] = rows(i, frame)
        return out

    def pull_by_pull() -> np.ndarray:
        out = np.empty((m, len(at), 3, robot.n))
        for i in range(m):
            pin.computeJointJacobians(built, data, q[i])
            pin.updateFramePlacements(built, data)
            for t, frame in enumerate(at):
                out[i, t] = rows(i, frame)
        return out

    def batched() -> np.ndarray:
        return jacobian(cell, pulls, robot.nominal_compliance)

    gap = np.abs(pull_by_pull() - batched()).max() / np.abs(batched()).max()
    return [
        (
            f"B of {READINGS} readings: Pinocchio, {how} / batched",
            ratio(batched, loop),
            f"aim >= 10; largest difference {gap:.0e}",
        )
        for how, loop in (("per reading", reading_by_reading), ("per pull", pull_by_pull))
    ]


def _solve() -> list[tuple[str, float, str]]:
    raw = in_memory(simulate(Plan(name="bench")).files)
    data = reduce(raw, conformed).data
    typical = raw.robot.nominal_compliance
    cell = paper_cell(raw.robot, tool(raw.settings))
    system = assemble(cell, data, typical)
    white = whitener(system.errors, system.rows.pose)
    white_B, y = white(system.B), white(system.c)
    A = white_B * typical

    def plain() -> object:
        return np.linalg.lstsq(white(system.B) * typical, white(system.c), rcond=None)

    same = np.abs(solve(system, typical).value / plain()[0] / typical - 1).max()

    def ours() -> object:
        return least_squares(white_B, y, typical, typical)

    return [
        (
            "432 whitened rows: values, covariance, chi2 / lstsq",
            ratio(lambda: np.linalg.lstsq(A, y, rcond=None), ours, 51),
            f"aim <= 3; values differ by {same:.0e}",
        ),
        (
            "the whole solve / whitening and lstsq",
            ratio(plain, lambda: solve(system, typical), 51),
            "aim <= 3",
        ),
    ]
