"""Settings as typed records that know every word they allow, and how large a number may be.

A bound is what nothing in a hall exceeds, with room for a unit that was mistaken: a thousand times
too large must still be read, or nobody can say which unit it is. Squares and products of all of
them stay numbers, which those of 1e160 do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from pipeline.base import patterns
from pipeline.base.errors import InputError, first_wrong
from pipeline.base.shown import is_printable, printable


def _visible(least: float) -> AfterValidator:
    """For numbers above zero: one that is as good as zero is a slip, and its square is none."""

    def check(value: float) -> float:
        if value < least:
            raise ValueError(f"{value:g} is as good as zero; the least that counts is {least:g}")
        return value

    return AfterValidator(check)


Positive = Annotated[float, Field(gt=0, le=1e12), _visible(1e-12)]
"""A number of any kind: a time, a weight, a factor."""
NotNegative = Annotated[float, Field(ge=0, le=1e12)]
"""The same, or zero."""

Seconds = Annotated[float, Field(ge=0, le=1e6)]
"""Between one reading and the next [s]: a week has 6e5."""
Length = Annotated[float, Field(ge=-1e5, le=1e5)]
"""A coordinate or a distance [m]: 100 m of hall in millimetres."""
Degrees = Annotated[float, Field(ge=-1e5, le=1e5)]
"""An angle [deg]: 280 turns."""
JointValue = Length
"""A joint's, [m] or [deg]."""
Force = Annotated[float, Field(ge=-1e7, le=1e7)]
"""A force or a part of one [N]: a thousand tonnes."""
LEAST_FORCE = 1e-6
"""A pull is stronger [N]: nothing measures what a micronewton does to a robot."""
Pull = Annotated[float, Field(gt=0, le=1e7), _visible(LEAST_FORCE)]
"""A force that is not zero [N]."""
Stiffness = Annotated[float, Field(gt=0, le=1e18), _visible(1e-3)]
"""A joint's [N/m] or [N m/rad]: a cube of steel of a metre has 2e11, a rubber band 1e1."""

Scatter = Annotated[float, Field(gt=0, le=10), _visible(1e-10)]
"""Standard uncertainty of a reading [m]: less than an atom, more than a room."""
Uncertainty = Annotated[float, Field(ge=0, le=10)]
"""Standard uncertainty of a length [m], of an angle [rad], or one relative to a length or force."""
ForceUncertainty = Annotated[float, Field(ge=0, le=1e7)]
"""Standard uncertainty of a force [N]: as large as the largest."""
STANDARD_GRAVITY = 9.80665
"""[m/s^2]; CGPM 1901. Between equator and pole it is 9.780 to 9.832 (WGS 84)."""
LEAST_MASS = 1e-7
"""A weight is heavier [kg]: it pulls with a micronewton."""
Temperature = Annotated[float, Field(ge=-50, le=100)]
"""Of a hall [degC]; kelvins and Fahrenheit of most halls are above."""
Mass = Annotated[float, Field(gt=0, le=1e6), _visible(LEAST_MASS)]
"""Of a weight or payload [kg]: a thousand tonnes."""
MassUncertainty = Annotated[float, Field(ge=0, le=1e6)]
"""Standard uncertainty of a mass [kg]: as large as the largest."""


def _plain(name: str) -> str:
    if not is_printable(name) or not name.strip():
        raise ValueError(f'"{printable(name, 80)}" is no name: use letters that can be seen')
    return name


def _prose(text: str) -> str:
    if not is_printable(text.replace("\n", " ").replace("\t", " ")):
        raise ValueError(f'"{printable(text, 80)}" holds control characters')
    return text


def _inside(name: str) -> str:
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise ValueError(f'"{name}" lies outside the campaign folder, put it beside campaign.toml')
    if not PurePosixPath(name).parts:
        raise ValueError(f'"{name}" is no file')
    return PurePosixPath(name).as_posix()


def _glob(pattern: str) -> str:
    if any("**" in part and part != "**" for part in PurePosixPath(pattern).parts):
        raise ValueError(f'"{pattern}": ** stands for whole folders, as in **/*.csv')
    return pattern


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_plain)]
"""Of anything, typed by a person: one line that can be shown."""
Prose = Annotated[str, Field(max_length=10_000), AfterValidator(_prose)]
"""Sentences by a person, which may have several lines."""
FileName = Annotated[Name, AfterValidator(_inside)]
"""A path relative to the campaign's folder that does not leave it."""
Glob = Annotated[FileName, AfterValidator(_glob)]
"""The same with *, ?, [...] and, for any folders, **."""


def with_parts(*names: str) -> AfterValidator:
    """For text that must be a regular expression with some named parts."""
    needed = ", ".join(f"(?P<{name}>...)" for name in names)

    def check(pattern: str) -> str:
        if not {*names} <= patterns.named(pattern):
            raise ValueError(f"needs the named parts {needed}")
        return pattern

    return AfterValidator(check)


class Strict(BaseModel):
    """A table that reports unknown words instead of overlooking them."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_Record = TypeVar("_Record", bound=Strict)


def checked(
    kind: type[_Record], content: Mapping[str, Any], file: str, whole: str, way_out: str
) -> _Record:
    """The content of a file as a record.

    Args:
        kind: Of the record.
        content: What the file says.
        file: Its name, for the message.
        whole: What it is called where no word of it alone is wrong.
        way_out: What to do about it.

    Raises:
        InputError: An unknown word, a missing table or a value of the wrong kind.
    """
    try:
        return kind.model_validate(content)
    except ValidationError as problem:
        words, message = first_wrong(problem)
        raise InputError(f"{'.'.join(words) or whole}: {message}", way_out, file=file) from problem
