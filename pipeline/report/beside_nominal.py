"""A joint in a word: how its stiffness compares with the nominal one, or how well it is known."""

from __future__ import annotations

from typing import NamedTuple

from pipeline.answer.contract import Stiffness
from pipeline.base.quantities import MISSING, percent

_NAME = 8
"""Maximum length of a joint's name above the drawing [letters]; a longer one is replaced by its
number."""

NEAR, TELLS, _KNOWN = 0.05, 0.25, 0.02
"""Thresholds of the key, used for nothing else [1]: deviation from nominal that counts as nominal,
U over nominal above which the comparison is too uncertain, and relative standard uncertainty up to
which a joint without nominal stiffness counts as well known."""

SOFT, ALIKE, STIFF = "softer", "as nominal", "stiffer"
WIDE_OPEN, LOST = "too uncertain to tell", "not determined"
SURE, ROUGH = f"U up to {200 * _KNOWN:.0f} %", f"U above {200 * _KNOWN:.0f} %"


class JointClass(NamedTuple):
    """Class of a joint: its word in the key, and the text below its name."""

    word: str
    said: str


def stand(joint: Stiffness) -> JointClass:
    """Classify a joint by its ratio to nominal or, if none is stated, by relative uncertainty."""
    if joint.value is None:
        return JointClass(LOST, "?")
    if not joint.nominal:
        return _by_uncertainty(joint.relative_std)
    ratio, off = joint.value / joint.nominal, 2 * (joint.std or 0.0) / joint.nominal
    word = ALIKE if off <= TELLS else WIDE_OPEN
    if abs(ratio - 1) > max(NEAR, off):
        word = SOFT if ratio < 1 else STIFF
    text = MISSING if joint.ci95[1] is None else percent(ratio, 3 if ratio >= 1 else 2)
    return JointClass(word, text)


def _by_uncertainty(rough: float | None) -> JointClass:
    """Classify a joint without nominal stiffness by its relative standard uncertainty."""
    word = SURE if rough is not None and rough <= _KNOWN else ROUGH
    return JointClass(word, f"± {percent(None if rough is None else 2 * rough)}")


def drawn_as(joint: Stiffness) -> str:
    """Name of a joint in the drawing."""
    name = joint.axis or joint.joint_name
    return name if len(name) <= _NAME else f"J{joint.joint}"
