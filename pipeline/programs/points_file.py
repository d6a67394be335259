"""Rows of joint values to be predicted, and the predictions as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Bools, Ints, Strings
from pipeline.base.errors import InputError, listed
from pipeline.library.targets import PredictedTargets
from pipeline.machine.robot import Robot, configure
from pipeline.prediction.model import IdentifiedModel
from pipeline.readers.export_settings import OWN_LOG
from pipeline.readers.logs import AXES, FORCE, TEMPERATURE, Quantity, joint_values, with_joints
from pipeline.reduction.limits import LEEWAY

_FURTHER = [
    *(Quantity(f"f{axis}", FORCE, needed=False) for axis in AXES),
    Quantity("temperature", TEMPERATURE, needed=False),
    Quantity("payload", {}, "name", needed=False),
]
"""Columns that rows to be predicted may have beside their joint values."""


def read_points(
    name: str, data: bytes, robot: Robot, payloads: Sequence[str]
) -> tuple[Array, Array, Ints, Array]:
    """Joint values (m, n), force [N] (m, 3), payload (m,) and temperature [degC] (m,).

    Payload 0 is none; others are numbered from 1 in the order of `payloads`.

    Raises:
        InputError: A row cannot be read, is beyond the limits of a joint, or names a payload that
            the campaign does not contain.
    """
    log = with_joints(name, data, robot, OWN_LOG, _FURTHER)
    for _, line, reason in log.rejected:
        thing, _, way_out = reason.partition("; ")
        raise InputError(thing, way_out or "correct the row", file=name, line=line)
    m = len(log.line)
    nothing = np.zeros(m)
    force = [np.nan_to_num(log.number.get(f"f{axis}", nothing)) for axis in AXES]
    words = log.word.get("payload", np.full(m, "", dtype=object))
    number = {"": 0, **{one: k for k, one in enumerate(payloads, 1)}}
    for word, line in zip(words, log.line, strict=True):
        if word not in number:
            raise InputError(
                f'payload "{word}" is not known',
                f"the campaign knows {listed(payloads) or 'none'}",
                file=name,
                line=int(line),
            )
    q = joint_values(log, robot)
    over = np.maximum(robot.lower - q, q - robot.upper)
    for k, j in np.argwhere(over > LEEWAY).tolist():
        raise InputError(
            f"joint {robot.joints[j].name} is beyond the limits of the robot file, where nothing "
            "is known of it",
            "correct the row, or the limits",
            file=name,
            line=int(log.line[k]),
        )
    return (
        q,
        np.column_stack(force),
        np.array([number[word] for word in words], dtype=np.int64),
        log.number.get("temperature", np.full(m, np.nan)),
    )


def under_pulls(model: IdentifiedModel, q: Array, force: Array) -> PredictedTargets:
    """Positions of targets under a force at the load point, by a model estimated from pulls.

    The uncertainty is that of the deflection; the unloaded position follows from the DH parameters
    of the model, and how uncertain it is alone is not known: NaN in rows without a force.

    Args:
        model: Model of a campaign of pulls.
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot [N], F_b, shape (m, 3).
    """
    here, points = configure(model.robot, q), model.tool.points
    each = [model.deflection(*row) for row in zip(q, force, strict=True)]
    moved, std = (np.stack([one[k] for one in each]) for k in (0, 1))
    cov = np.zeros((*moved.shape[:2], 6, 6))
    axis = np.arange(3)
    cov[..., axis, axis] = np.where((force != 0).any(axis=1)[:, None, None], std**2, np.nan)
    turn = np.repeat(here.flange_axes[:, None], len(points), axis=1)
    return PredictedTargets(here.points(points) + moved, turn, cov, moved, std)


def as_csv(targets: Strings, six: Bools, found: PredictedTargets) -> str:
    """CSV `row,target,x_m,y_m,z_m,std_x_m,...`.

    With `dx_m` ... where any row has a force, and with orientation for targets that have one.
    """
    m, t = found.at.shape[:2]
    std = found.std.reshape(m * t, 6)
    table = {
        **_columns("{}_m", found.at.reshape(m * t, 3)),
        **_columns("std_{}_m", std[:, :3]),
    }
    if found.moved.any():
        table |= _columns("d{}_m", found.moved.reshape(m * t, 3))
        table |= _columns("std_d{}_m", found.moved_std.reshape(m * t, 3))
    if six.any():
        turned = Rotation.from_matrix(found.turn.reshape(-1, 3, 3)).as_euler("XYZ")
        known = np.tile(six, m)[:, None]
        table |= _columns("r{}_rad", np.where(known, turned, np.nan))
        table |= _columns("std_r{}_rad", np.where(known, std[:, 3:], np.nan))
    names = [_quoted(str(name)) for name in targets]
    lines = _written(np.column_stack(list(table.values())))
    rows = (f"{k // t + 1},{names[k % t]}{line}" for k, line in enumerate(lines))
    return "\n".join([",".join(["row", "target", *table]), *rows, ""])


def _written(values: Array) -> Iterator[str]:
    """Rows with a comma before every value, in m or rad with nine decimals; NaN is left empty.

    pandas takes five times as long to write such a table.
    """
    form = ",%.9f" * values.shape[1]
    for row in values.tolist():
        yield (form % tuple(row)).replace("nan", "")


def _quoted(name: str) -> str:
    sink = io.StringIO()
    csv.writer(sink, lineterminator="").writerow([name])
    return sink.getvalue()


def _columns(name: str, values: Array) -> dict[str, Array]:
    return {name.format(axis): values[:, k] for k, axis in enumerate(AXES)}
