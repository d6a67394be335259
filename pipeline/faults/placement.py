"""A base frame that is missing, rotated or displaced, from the unloaded reflectors.

Readings are transformed into F_b by the base reflectors, or taken to be in it where campaign.toml
has no [base_frame]. If that is wrong, forces and torques are those of another pose: rotated by a
right angle they act along another axis. It shows where the reflectors agree with the robot's table
among each other, but are all displaced by a common motion.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.linear import extent, rigid
from pipeline.faults.base_names import not_rigid
from pipeline.faults.conventions import (
    GROSS_ANCHORED_M,
    anchored,
    mapped,
    miss,
    pairs,
    unloaded,
    with_places,
)
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, length
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.case import Case


def placement(case: Case) -> list[Mistake]:
    """The mistake that the readings are not in F_b, if only a common rigid motion is wrong.

    Two poses show it, if their targets are not on a line; of one the log may be wrong instead.
    """
    free, where = miss(case, fewest=2), anchored(case)
    if free is None or where is None or free >= GROSS_DISTANCE_M or not_rigid(case) is not None:
        return []
    seen, expected, _ = pairs(case, unloaded(case))
    R, t = where
    stand = seen @ R.T + t
    before = float(np.median(np.linalg.norm(stand - expected, axis=1)))
    if before < max(GROSS_ANCHORED_M, CLEARLY_NEARER * free) or extent(stand)[1] < GROSS_DISTANCE_M:
        return []
    turn, shift = rigid(stand, expected)
    angle = np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    base = case.settings.base_frame
    what = "[base_frame] is" if base else "without [base_frame] the readings are"
    far = f"turned by {angle:.1f} deg and {length(before)} away"
    says = f"{what} in another frame than the one in which the robot file begins, {far}"
    return [
        Mistake(
            name="sign_or_convention",
            where="base_frame",
            evidence=f"{says}: after transforming them, the unloaded reflectors are "
            f"{1e3 * free:.1f} mm from where the robot file places them",
            correction="recomputed with the readings transformed into it"
            + ("" if base else "; fill in [base_frame]"),
            before=1e3 * before,
            after=1e3 * free,
            correct=partial(_placed, turn, shift),
        )
    ]


def _placed(turn: Array, shift: Array, case: Case) -> Case:
    """The campaign transformed into F_b: what is stated there, or without [base_frame] readings."""
    if not case.settings.base_frame:
        return mapped(turn, case, shift)
    for table in ("base_frame", "anchors"):
        stated = getattr(case.settings, table)
        moved = {name: tuple((turn @ at + shift).tolist()) for name, at in stated.items()}
        case = with_places(table, moved, case)
    return case


FAULT = Fault("sign_or_convention", lambda asked: placement(asked.case), in_files=True)
