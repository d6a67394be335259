"""The raw files of a game, as brought home by the operator."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

import numpy as np

from bench.league.machine import turned
from bench.league.play import NAMES, joints_log, loads_log
from bench.worlds.cell import Cell
from bench.worlds.payloads import CENTER_SIGMA_M, GRAVITY, MASS_SIGMA_KG, Log, Payload
from pipeline.base.arrays import Array

START = datetime(2026, 11, 3, 8)


def raw(
    cell: Cell,
    record: Array,
    stated: str,
    instrument: Sequence[str],
    factor: float,
    timed: bool,
) -> dict[str, bytes]:
    """Content of the raw folder.

    Args:
        cell: What was measured.
        record: Readings of the tracker, its own frame, shape (r, 3) [m].
        stated: Line on the noise in `[tracker]`, or empty.
        instrument: Lines of `[instrument]`; empty if not stated.
        factor: Factor from the force to the log of the scale.
        timed: Whether the export states the time of each reading.
    """
    lines = ["group,target,x_mm,y_mm,z_mm" + (",time" if timed else "")]
    for slot, at in zip(cell.slots, 1e3 * record, strict=True):
        when = START + timedelta(seconds=round(3600 * slot.hours))
        row = f"{slot.group},{slot.target},{at[0]:.4f},{at[1]:.4f},{at[2]:.4f}"
        lines.append(f"{row},{when.isoformat()}" if timed else row)
    joints = joints_log(cell.robot, cell.course)
    return {
        "campaign.toml": _toml(cell, stated, instrument).encode(),
        "tracker.csv": ("\n".join(lines) + "\n").encode(),
        "loads.csv": _loads(cell, factor).encode(),
        "joints.csv": (_with_torques(cell, cell.log, joints) if cell.log else joints).encode(),
    }


def _loads(cell: Cell, factor: float) -> str:
    """loads.csv: forces, weights, or the names of payloads."""
    if cell.payloads:
        rows = zip(cell.course.pose, cell.course.repeat, cell.which, strict=True)
        body = [f"{p + 1},{r + 1},{cell.payloads[w].name}" for p, r, w in rows]
        return "\n".join(["pose,repeat,payload", *body]) + "\n"
    if cell.rules.hang:
        return loads_log(cell.course, cell.scale / GRAVITY, "mass_kg")
    return loads_log(cell.course, factor * cell.scale)


def _with_torques(cell: Cell, log: Log, joints: str) -> str:
    """joints.csv with torques of the controller: a row for each state, or one for each pose."""
    names = [f"tau{j}_{'n' if s else 'nm'}" for j, s in enumerate(cell.robot.prismatic, 1)]
    titles, *rows = joints.splitlines()
    out = [",".join([titles, *(["repeat"] if log.by_state else []), *names])]
    for i, (pose, repeat) in enumerate(zip(cell.course.pose, cell.course.repeat, strict=True)):
        if not log.by_state:
            out.append(",".join([rows[pose], *_told(log.loaded[i] - log.unloaded[i])]))
            continue
        if repeat == 0:
            out.append(",".join([rows[pose], "0", *_told(log.unloaded[i])]))
        out.append(",".join([rows[pose], str(repeat + 1), *_told(log.loaded[i])]))
    return "\n".join(out) + "\n"


def _told(torques: Array) -> list[str]:
    return [f"{v:.1f}" for v in torques]


def _payload(one: Payload) -> list[str]:
    return [
        f"[payload.{one.name}]",
        f"mass_kg = {one.stated.mass_kg}",
        f"mass_sigma_kg = {MASS_SIGMA_KG}",
        f"center_m = {list(one.stated.center_m)}",
        f"center_sigma_m = {CENTER_SIGMA_M}",
    ]


def line(reading: int) -> int:
    """Line of a reading in tracker.csv, from 1, after the titles."""
    return reading + 2


def _toml(cell: Cell, stated: str, instrument: Sequence[str]) -> str:
    base = turned(cell.base, cell.one.base_turn)
    names = NAMES[: cell.rules.targets]
    points = zip(("load_point", *names), cell.plan.tool.tolist(), strict=False)
    q = np.where(cell.robot.prismatic, cell.test_q, np.rad2deg(cell.test_q))
    sigma = [] if cell.payloads else [f"sigma_n = {0.1 if cell.rules.hang else 2.0}"]
    gravity = ["[gravity]", f"m_s2 = {GRAVITY}"] if cell.payloads else []
    return "\n".join(
        [
            "format = 1",
            'name = "game"',
            f'robot = "{cell.robot.name}"',
            *(["[instrument]", *instrument] if instrument else []),
            "[tracker]",
            'files = ["tracker.csv"]',
            stated,
            "[naming]",
            f"measured = {list(names)}",
            "[base_frame]",
            *(f"B{k + 1} = {[round(v, 7) for v in row]}" for k, row in enumerate(base.tolist())),
            "[scale]",
            'file = "loads.csv"',
            *sigma,
            *gravity,
            *(text for one in cell.payloads for text in _payload(one)),
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
