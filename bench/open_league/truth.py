"""truth.json: the truth of a campaign, as sealed by its author; see docs/open-league.md."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from pipeline.base import files
from pipeline.base.errors import InputError, first_wrong

Three = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


UNLISTED = "unlisted_law"
"""The right name for a cause outside the catalogue: a law at its place."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Cause(_Strict):
    """Something that the joint springs leave out.

    Attributes:
        name: A word of docs/causes.md if `listed`, else any.
        where: Joint number or part, as there.
        accept: Further labels that count as right (`joint_tilt:6`), such as twins.
        listed: Whether the catalogue contains it; if not, `UNLISTED` at its place is right.
        amplitudes: True parameters under the catalogue's names [SI].
    """

    name: str
    where: int | str | None = None
    accept: tuple[str, ...] = ()
    listed: bool = True
    amplitudes: dict[str, FiniteFloat] = {}

    @property
    def labels(self) -> frozenset[str]:
        """All labels that name it; those accepted if it is not listed and has no place."""
        name = self.name if self.listed else UNLISTED
        if self.where is not None:
            return frozenset((f"{name}:{self.where}", *self.accept))
        return frozenset((name, *self.accept)) if self.listed else frozenset(self.accept)


class Stiffness(_Strict):
    """True stiffness of one joint [N/m] or [N m/rad], name as in result.json (`k_theta2`)."""

    name: str
    value: Annotated[FiniteFloat, Field(gt=0)]


class Prediction(_Strict):
    """A load that is not in the campaign, and its true effect.

    Attributes:
        name: `test_pose` for the one that campaign.toml states.
        q: Joint values [m] or [deg].
        force_n: Force at the load point, F_b [N].
        deflection_m: By target, loaded minus unloaded, F_b [m].
    """

    name: str
    q: tuple[FiniteFloat, ...]
    force_n: Three
    deflection_m: dict[str, Three]


class Truth(_Strict):
    """The sealed truth of one campaign.

    Attributes:
        format: 1.
        salt: At least 32 random hexadecimal digits, so that the truth cannot be found by trial.
        kind: Kind of game, by which tables are sorted: `clean`, `one cause`, ...
        noise: Kind of noise, likewise.
        stiffness: Stiffnesses of the joints; those without one are left out.
        causes: Hidden causes; empty if the joint springs are the whole truth.
        predictions: Loads that are not measured.
    """

    format: Literal[1] = 1
    salt: Annotated[str, Field(pattern=r"^[0-9a-f]{32,}$")]
    kind: str
    noise: str = ""
    stiffness: tuple[Stiffness, ...]
    causes: tuple[Cause, ...]
    predictions: tuple[Prediction, ...] = ()


def read(path: Path) -> Truth:
    """Read a truth.

    Raises:
        InputError: The file is not a valid truth.
    """
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise InputError(
            f"the truth cannot be read ({problem.strerror})", "put it there", file=str(path)
        ) from problem
    try:
        return Truth.model_validate_json(data)
    except ValidationError as problem:
        words, what = first_wrong(problem)
        raise InputError(
            f"{'.'.join(words) or 'the file'}: {what}",
            "docs/open-league.md has the format",
            file=str(path),
        ) from problem


def write(path: Path, truth: Truth) -> None:
    """Write a truth, in the bytes that are hashed."""
    files.write(path, (truth.model_dump_json(indent=1) + "\n").encode())
