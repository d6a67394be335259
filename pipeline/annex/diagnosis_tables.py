"""Tables for the figures of a diagnosis."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.annex import promises
from pipeline.diagnosis.facts import Diagnosed
from pipeline.machine.cell import Cell, load
from pipeline.machine.robot.configuration import torque
from pipeline.reduction.measured import Measured
from pipeline.system.system import Estimate, System

_AXES = np.array(["x", "y", "z"], dtype=object)


def clues_table(diagnosis: Diagnosed) -> pd.DataFrame:
    """Table DIAGNOSIS."""
    named = {cause.effect.label for cause in diagnosis.causes}
    rows = [
        {
            "name": clue.effect.name,
            "where": "" if clue.effect.where is None else str(clue.effect.where),
            "location": clue.effect.location,
            "form": clue.effect.form,
            "p_value": clue.p_value,
            "threshold_p": diagnosis.threshold,
            "log_evidence": clue.log_evidence,
            "absorbed": clue.absorbed,
            "smallest_visible": clue.smallest_visible,
            "named": clue.effect.label in named,
        }
        for clue in diagnosis.clues
    ]
    return pd.DataFrame(rows, columns=promises.DIAGNOSIS.names)


def apart_table(diagnosis: Diagnosed) -> pd.DataFrame:
    """Table SEPARABILITY."""
    labels = np.array(diagnosis.apart_labels, dtype=object)
    n = len(labels)
    return pd.DataFrame(
        {
            "cause": np.repeat(labels, n),
            "rival": np.tile(labels, n),
            "sigmas": diagnosis.apart.ravel(),
            "sigmas_found": diagnosis.apart_found.ravel(),
        }
    )


def examined_table(
    diagnosis: Diagnosed, cell: Cell, data: Measured, system: System, estimate: Estimate
) -> pd.DataFrame:
    """Table `promises.examined`.

    Args:
        diagnosis: The diagnosis.
        cell: The joint springs model.
        data: The measurements.
        system: The linear system of the joint springs.
        estimate: Its solution.
    """
    rows = system.rows
    loaded = load(cell, data.pulls, estimate.value)
    tau = torque(loaded.configuration.twists, loaded.load_point, loaded.force)[rows.pull]
    place = np.repeat(loaded.points[data.pull, data.target], 3, axis=0)
    extended = diagnosis.estimate
    table = {
        "row": np.arange(len(rows)),
        "pose": rows.pose,
        "repeat": rows.repeat,
        "target": rows.target,
        "axis": _AXES[rows.axis],
        "x_m": place[:, 0],
        "y_m": place[:, 1],
        "z_m": place[:, 2],
        "force_n": np.linalg.norm(data.pulls.force, axis=1)[rows.pull],
        "time_s": data.pulls.time[rows.pull],
        "residual_m": estimate.residual,
        "residual_extended_m": estimate.residual if extended is None else extended.residual,
        "left_out_m": diagnosis.left_out_before_m,
        "left_out_extended_m": diagnosis.left_out_after_m,
    }
    for j, joint in enumerate(cell.robot.joints):
        table[tables.joint_column(joint.name, joint.prismatic)] = data.pulls.q[rows.pull, j]
        table[f"tau_{joint.name}"] = tau[:, j]
    return pd.DataFrame(table)
