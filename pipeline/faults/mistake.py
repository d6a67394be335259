"""The record of a mistake in the data."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.base.errors import listed
from pipeline.base.quantities import plain
from pipeline.base.toml import line_of
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ


@dataclass(frozen=True)
class Mistake:
    """One mistake, the evidence for it, and its correction.

    Attributes:
        name: Name of its fault: `outlier`, `label_swap`, `unit_mixup`, `sign_or_convention`, ...
        where: A reading `group/target`, a group, or which unit, sign or convention.
        evidence: Sentence for the engineer, with its numbers.
        correction: Sentence that says how the corrected result was obtained.
        before: Misfit with the mistake, in `unit`.
        correct: Function that corrects a campaign, or for positions their table.
        after: Misfit once it is corrected, in `unit`.
        unit: `mm`, `sigma`, `1`.
        size: Magnitude of the mistake, where it has one.
        size_unit: Unit of `size`.
        p_value: Probability of such evidence by chance, None where chance plays no part.
        at: Lines that are wrong, `file:line`; empty if it is no single row.
        axes: Number of coordinates whose squares sum to that of `before`, where that is in sigma.
        together: Whether several readings are displaced alike, which noise tails of single readings
            do not explain.
        since: Line where a unit changes in mid-file, `file:line`; None if it does not.
        hopeless: Whether it cannot be corrected, and no value of the campaign holds.
        rivalled: Whether a cause that was not yet sought may do as much.
        instead: Places, or units, of which one may be wrong instead; nothing tells which.
        alike: What it has in common with others of one origin, with which it is told as one; empty
            where it stands alone.
        places: Number of places in the pulls that were compared to find it, of which chance alone
            makes one the best; 0 if the pulls are not what shows it.
        entry: Path of the entry of campaign.toml that is wrong; empty if it is none.
        near: Of a single reading of the base, for each other one of its round: its squared error in
            standard uncertainties, and the number of coordinates that it tells of.
    """

    name: str
    where: str
    evidence: str
    correction: str
    before: float
    correct: Callable[[Any], Any]
    after: float = 0.0
    unit: str = "mm"
    size: float | None = None
    size_unit: str = "1"
    p_value: float | None = None
    at: tuple[str, ...] = ()
    axes: int = 3
    together: bool = False
    since: str | None = None
    hopeless: bool = False
    rivalled: bool = False
    instead: tuple[str, ...] = ()
    alike: str = ""
    places: int = 0
    entry: tuple[str, ...] = ()
    near: tuple[tuple[float, float], ...] = ()

    @property
    def lost(self) -> Mistake:
        """The mistake if too few displacements remain without it, so that no value holds."""
        text = "nothing can be corrected, too few displacements are left without it"
        return replace(self, correct=as_it_is, correction=text, hopeless=True)

    def in_toml(self, text: str) -> Mistake:
        """The mistake with the line of its entry in campaign.toml, of which this is the text."""
        place = f"campaign.toml:{line_of(text, self.entry)}"
        return replace(self, at=(place,)) if self.entry else self

    @property
    def of_reading(self) -> bool:
        """Whether it is a single reading of the tracker."""
        return self.name == "outlier" and self.size_unit == "m"

    @property
    def may_be_noise(self) -> bool:
        """Whether it is so by a probability, which depends on the tails of the noise."""
        single = self.of_reading and not self.together
        return single and self.unit == "sigma" and self.p_value is not None


def told_once(found: Sequence[Mistake], toml: str) -> tuple[Mistake, ...]:
    """The mistakes, those of one origin as one with all their lines, where the first of them is.

    Args:
        found: The mistakes.
        toml: Text of campaign.toml, by which wrong entries get their lines.
    """
    origins: dict[tuple[str, str | int], list[Mistake]] = {}
    for k, one in enumerate(found):
        origins.setdefault((one.name, one.alike or k), []).append(one.in_toml(toml))
    return tuple(_as_one(*of) for of in origins.values())


_IN_COMMON = (["target", "state"], ["target"], ["pose"])
"""What wrong readings may have in common, the narrowest first."""

_BY_CHANCE = 0.01
"""Probability below which readings drawn at random have it in common [1]."""

_STILL = 0.1
"""Maximum motion of a target that did not follow the load, over the error of its readings [1]."""


def in_common(found: Sequence[Mistake], readings: pd.DataFrame) -> str:
    """Sentence on what all wrong readings of the poses have in common; empty without anything.

    Args:
        found: The mistakes.
        readings: All readings of the campaign.
    """
    if not found or not all(one.of_reading and one.at for one in found):
        return ""
    readings = readings[readings["pose"].notna()]
    rows = readings[np.isin(lines_of(readings), [line for one in found for line in one.at])]
    if len(rows) < len(found):
        return ""
    columns = next((one for one in _IN_COMMON if _alike(rows[one], readings[one])), None)
    return _shared(found, rows, columns, readings) if columns else ""


def _alike(rows: pd.DataFrame, readings: pd.DataFrame) -> bool:
    """Whether rows agree in all columns, which as many drawn at random would hardly do."""
    share, alike = (float((one == rows.iloc[0]).all(axis=1).mean()) for one in (readings, rows))
    return alike == 1 and share ** (len(rows) - 1) < _BY_CHANCE


def _shared(
    found: Sequence[Mistake], rows: pd.DataFrame, columns: list[str], readings: pd.DataFrame
) -> str:
    """`All of them are of pose 5.`, or of one target, and whether it did not move with the load."""
    first = rows.iloc[0]
    if columns == ["pose"]:
        return f"All of them are of pose {int(first['pose'])}."
    states = f"{first['state']} states of " if "state" in columns else ""
    mine = readings[(readings["target"] == first["target"]) & (readings["state"] == "unloaded")]
    zero = mine.groupby("pose")[XYZ].mean().reindex(rows["pose"]).to_numpy(float)
    moved = np.linalg.norm(rows[XYZ].to_numpy(float) - zero, axis=1)
    off_m = float(np.median([one.size or 0 for one in found]))
    still = states and float(np.median(moved)) < _STILL * off_m
    how = ", which did not move with the load" if still else ""
    return f"All of them are of {states}{first['target']}{how}: look there first."


def _as_one(first: Mistake, *others: Mistake) -> Mistake:
    if not others:
        return first
    few = listed((one.where for one in others), 3)
    return replace(
        first,
        evidence=f"{first.evidence}; the same in {few}",
        correction=f"{first.correction}, and the same in {few}",
        before=max(one.before for one in (first, *others)),
        after=max(one.after for one in (first, *others)),
        at=tuple(dict.fromkeys(line for one in (first, *others) for line in one.at)),
    )


def as_it_is(case: Case) -> Case:
    """The case unchanged, for mistakes without a correction."""
    return case


def lines_of(rows: pd.DataFrame) -> tuple[str, ...]:
    """Lines of the rows of a table: `file:line`."""
    return tuple(f"{file}:{line}" for file, line in zip(rows["file"], rows["line"], strict=True))


def as_read(case: Case) -> pd.DataFrame:
    """Readings without the ends of chains that follow from anchors: they are in no file."""
    rows = case.readings
    pull = pd.MultiIndex.from_frame(rows[["pose", "repeat"]])
    follows = pull.isin([*case.anchors, *case.anchors_read])
    return rows[~(follows & rows["target"].isin(case.settings.naming.chain))]


def left_out(case: Case, at: Collection[str]) -> Case:
    """The campaign without some of its readings, `file:line` each."""
    by_file: dict[str, list[int]] = {}
    for file, _, line in (place.rpartition(":") for place in at):
        by_file.setdefault(file, []).append(int(line))
    table = case.readings
    for file, numbers in by_file.items():
        table = table[(table["file"] != file) | ~table["line"].isin(numbers)]
    return replace(case, readings=table)


def pulls_of(rows: pd.DataFrame) -> set[tuple[int, int]]:
    """Pose and repeat of some rows."""
    return set(zip(rows["pose"], rows["repeat"], strict=True))


def without_pulls(case: Case, pulls: Collection[tuple[int, int]]) -> Case:
    """The campaign without the loads of some pulls, by pose and repeat: a line may have several."""
    keys = zip(case.loads["pose"], case.loads["repeat"], strict=True)
    return replace(case, loads=case.loads[[key not in pulls for key in keys]])


def of_group(case: Case, group: str, targets: Collection[str]) -> tuple[str, ...]:
    """Lines of the readings of some targets of a group: `file:line`."""
    rows = case.readings
    return lines_of(rows[(rows["group"] == group) & rows["target"].isin(targets)])


_FAR = 1000.0
"""Maximum number of standard deviations stated in a sentence."""


def apart(sigmas: float) -> str:
    """A deviation in standard deviations, in words."""
    far = f"more than {_FAR:.0f}" if sigmas > _FAR else plain(sigmas, 2 if sigmas < 10 else 3)
    return f"{far} standard deviations"


def length(size_m: float) -> str:
    """A length with a suitable unit, in words."""
    return f"{size_m:.2f} m" if size_m >= 1 else f"{1e3 * size_m:.2f} mm"


def outlying(where: str, evidence: str, correction: str, **known: Any) -> Mistake:
    """The mistake of one reading, or row, that contradicts all others; `known` as in `Mistake`."""
    usual: dict[str, Any] = {"name": "outlier", "after": 0.0, "unit": "sigma", "size_unit": "m"}
    told = usual | known
    if told.get("p_value") is not None:
        told["p_value"] = min(told["p_value"], 1.0)  # a sum over readings may exceed 1
    return Mistake(where=where, evidence=evidence, correction=correction, **told)
