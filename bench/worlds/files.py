"""What the operator takes home: the raw files of a game."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from bench.league.play import NAMES, joints_log, loads_log
from bench.worlds.cell import Cell
from pipeline.base.arrays import Array

START = datetime(2026, 11, 3, 8)
GRAVITY = 9.81
"""Free fall where the weights hang [m/s^2]."""


def raw(
    cell: Cell, record: Array, stated: str, instrument: str, factor: float, timed: bool
) -> dict[str, bytes]:
    """Content of the raw folder.

    Args:
        cell: What was measured.
        record: What the tracker recorded, its own frame, shape (r, 3) [m].
        stated: Line on the noise in `[tracker]`, or empty.
        instrument: Its kind in `[instrument]`, or empty.
        factor: The log of the scale shows so many times the force.
        timed: The export says when each reading was taken.
    """
    hang = cell.rules.hang
    lines = ["group,target,x_mm,y_mm,z_mm" + (",time" if timed else "")]
    for slot, at in zip(cell.slots, 1e3 * record, strict=True):
        when = START + timedelta(seconds=round(3600 * slot.hours))
        row = f"{slot.group},{slot.target},{at[0]:.4f},{at[1]:.4f},{at[2]:.4f}"
        lines.append(f"{row},{when.isoformat()}" if timed else row)
    shown = cell.scale / GRAVITY if hang else factor * cell.scale
    loads = loads_log(cell.course, shown, "mass_kg" if hang else "force_n")
    return {
        "campaign.toml": _toml(cell, stated, instrument).encode(),
        "tracker.csv": ("\n".join(lines) + "\n").encode(),
        "loads.csv": loads.encode(),
        "joints.csv": joints_log(cell.robot, cell.course).encode(),
    }


def line(reading: int) -> int:
    """Line of a reading in tracker.csv, from 1, behind the titles."""
    return reading + 2


def _toml(cell: Cell, stated: str, instrument: str) -> str:
    base = cell.base + np.cross(cell.one.base_turn, cell.base)
    names = NAMES[: cell.rules.targets]
    points = zip(("load_point", *names), cell.plan.tool.tolist(), strict=False)
    q = np.where(cell.robot.prismatic, cell.test_q, np.rad2deg(cell.test_q))
    kind = ["[instrument]", f'kind = "{instrument}"'] if instrument else []
    return "\n".join(
        [
            "format = 1",
            'name = "game"',
            f'robot = "{cell.robot.name}"',
            *kind,
            "[tracker]",
            'files = ["tracker.csv"]',
            stated,
            "[naming]",
            f"measured = {list(names)}",
            "[base_frame]",
            *(f"B{k + 1} = {[round(v, 7) for v in row]}" for k, row in enumerate(base.tolist())),
            "[scale]",
            'file = "loads.csv"',
            "sigma_n = 0.1" if cell.rules.hang else "sigma_n = 2.0",
            "[joints]",
            'file = "joints.csv"',
            "[tool]",
            *(f"{label} = {row}" for label, row in points),
            "[test_pose]",
            f"q = {[round(v, 6) for v in q.tolist()]}",
            f"force_n = {[round(v, 2) for v in cell.test_force.tolist()]}",
            "",
        ]
    )
