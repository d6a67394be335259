"""The part of an entry's answer that is scored: a subset of result.json; the rest is ignored."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from pipeline.base.errors import first_wrong

Odds = Annotated[FiniteFloat, Field(ge=0, le=1)]
Ends = tuple[FiniteFloat | None, FiniteFloat | None]


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Named(_Part):
    """A cause, or a rival of one."""

    name: str
    where: int | str | None = None
    probability: Odds | None = None

    @property
    def label(self) -> str:
        """`joint_tilt:3`, or `rail_roll` without a place."""
        return self.name if self.where is None else f"{self.name}:{self.where}"


class Cause(Named):
    """A cause with its rivals."""

    rivals: tuple[Named, ...] = ()


class Diagnosis(_Part):
    """The verdict, and the causes named."""

    verdict: str
    causes: tuple[Cause, ...] = ()


class Spring(_Part):
    """A stiffness [N/m] or [N m/rad]; null means unknown, or an interval without that end."""

    name: str
    value: FiniteFloat | None = None
    ci95: Ends = (None, None)


class Deflection(_Part):
    """Loaded minus unloaded position of one target, F_b [mm], and standard uncertainties."""

    target: str
    dx_mm: FiniteFloat | None = None
    dy_mm: FiniteFloat | None = None
    dz_mm: FiniteFloat | None = None
    std_mm: tuple[FiniteFloat | None, FiniteFloat | None, FiniteFloat | None] = (None,) * 3


class Reply(_Part):
    """An answer.

    Attributes:
        stiffness: Stiffnesses of the joints, by name.
        diagnosis: What is wrong with model or data.
        test_pose_deflection: Deflections at the test pose of campaign.toml.
        predictions: The same for further loads, by name.
    """

    stiffness: tuple[Spring, ...] = ()
    diagnosis: Diagnosis
    test_pose_deflection: tuple[Deflection, ...] = ()
    predictions: dict[str, tuple[Deflection, ...]] = {}

    def deflections(self, name: str) -> dict[str, Deflection]:
        """Deflections of one prediction, by target."""
        at_test_pose = name == "test_pose"
        rows = self.test_pose_deflection if at_test_pose else self.predictions.get(name, ())
        return {row.target: row for row in rows}


def read(said: dict[str, Any] | None) -> tuple[Reply | None, str]:
    """An answer, and why it cannot be scored; such an answer counts as none."""
    if said is None:
        return None, "no answer"
    try:
        return Reply.model_validate(said), ""
    except ValidationError as problem:
        words, what = first_wrong(problem)
        return None, f"an answer that cannot be scored, {'.'.join(words)}: {what}"
