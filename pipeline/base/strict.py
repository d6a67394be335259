"""Settings as typed records that reject unknown keys and implausible numbers.

A bound is more than anything in a hall, with room for a mistaken unit: a value that is a thousand
times too large must still be read, so that the unit can be identified. Squares and products of all
of them remain finite, unlike those of 1e160.
"""

from __future__ import annotations

import datetime
import functools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from pipeline.base import doors, patterns, toml
from pipeline.base.errors import InputError, decisive, first_wrong
from pipeline.base.shown import is_printable, printable


def _visible(least: float) -> AfterValidator:
    """For positive numbers: one that is practically zero is a slip, and its square underflows."""

    def check(value: float) -> float:
        if value < least:
            raise ValueError(f"{value:g} is as good as zero; the least that counts is {least:g}")
        return value

    return AfterValidator(check)


Positive = Annotated[float, Field(gt=0, le=1e12), _visible(1e-12)]
"""A positive number of any kind: a time, a weight, a factor."""
NotNegative = Annotated[float, Field(ge=0, le=1e12)]
"""The same, or zero."""

Day = Annotated[datetime.date, Field(ge=datetime.date(1980, 1, 1))]
"""A day of a measurement or a calibration; a number would be one of 1970, before any tracker."""
Seconds = Annotated[float, Field(ge=0, le=1e6)]
"""Time between two readings [s]; for comparison, a week has 6e5."""
Length = Annotated[float, Field(ge=-1e5, le=1e5)]
"""A coordinate or a distance [m]; the bound is a hall of 100 m in millimetres."""
Degrees = Annotated[float, Field(ge=-1e5, le=1e5)]
"""An angle [deg]; the bound is 280 turns."""
JointValue = Length
"""Value of a joint [m] or [deg]."""
AxisValue = Annotated[float, Field(ge=-1e6, le=1e6)]
"""Value of a controller's axis as displayed [mm] or [deg]."""
Force = Annotated[float, Field(ge=-1e7, le=1e7)]
"""A force or a component of one [N]; the bound is the weight of a thousand tonnes."""
LEAST_FORCE = 1e-6
"""Minimum pull [N]: no instrument resolves the effect of a micronewton on a robot."""
Pull = Annotated[float, Field(gt=0, le=1e7), _visible(LEAST_FORCE)]
"""A force that is not zero [N]."""
Stiffness = Annotated[float, Field(gt=0, le=1e18), _visible(1e-3)]
"""Stiffness of a joint [N/m] or [N m/rad]; for comparison, a steel cube of a metre has 2e11, a
rubber band 1e1."""

Scatter = Annotated[float, Field(gt=0, le=10), _visible(1e-10)]
"""Standard uncertainty of a reading [m]; the bounds are less than an atom and more than a room."""
Uncertainty = Annotated[float, Field(ge=0, le=10)]
"""Standard uncertainty of a length [m] or of an angle [rad]."""
Relative = Annotated[float, Field(ge=0, lt=1)]
"""Standard uncertainty relative to a length or force [1]: with 1 not even its sign is known."""
ForceUncertainty = Annotated[float, Field(ge=0, le=1e7)]
"""Standard uncertainty of a force [N]; the bound is the largest force."""
STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2]; CGPM 1901. From equator to pole it is 9.780 to 9.832
(WGS 84)."""
LEAST_MASS = 1e-7
"""Minimum mass of a weight [kg]: its weight is a micronewton."""
Temperature = Annotated[float, Field(ge=-50, le=100)]
"""Temperature of a hall [degC]; in kelvin or degrees Fahrenheit most halls exceed the bound."""
Mass = Annotated[float, Field(gt=0, le=1e6), _visible(LEAST_MASS)]
"""Mass of a weight or payload [kg]; the bound is a thousand tonnes."""
MassUncertainty = Annotated[float, Field(ge=0, le=1e6)]
"""Standard uncertainty of a mass [kg]; the bound is the largest mass."""


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
"""A name typed by a person: one printable line."""
Prose = Annotated[str, Field(max_length=10_000), AfterValidator(_prose)]
"""Sentences by a person, possibly of several lines."""
FileName = Annotated[Name, AfterValidator(_inside)]
"""A path relative to the campaign's folder that does not leave it."""
Glob = Annotated[FileName, AfterValidator(_glob)]
"""The same with *, ?, [...] and, for any folders, **."""


def with_parts(*names: str) -> AfterValidator:
    """Validator of a regular expression that must have some named groups."""
    needed = ", ".join(f"(?P<{name}>...)" for name in names)

    def check(pattern: str) -> str:
        if not {*names} <= patterns.named(pattern):
            raise ValueError(f"needs the named parts {needed}")
        return pattern

    return AfterValidator(check)


class Numbers(BaseModel):
    """A table whose numbers must not be booleans, which Python would accept as integers."""

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth(cls, value: object, info: ValidationInfo) -> object:
        kinds = _kinds(cls, str(info.field_name))
        values = list(value.values()) if dict in kinds and isinstance(value, dict) else value
        if bool not in kinds and kinds & {int, float} and _holds_truth(values):
            raise ValueError("true and false are no numbers; write the number")
        return value


@functools.cache
def _kinds(record: type[BaseModel], field: str) -> frozenset[type]:
    """Plain types that values of a field may have."""
    return frozenset(_plain_kinds(record.model_fields[field].annotation))


def _plain_kinds(annotation: object) -> Iterator[type]:
    if get_origin(annotation) is Literal:
        yield from map(type, get_args(annotation))
        return
    if annotation in (bool, int, float):
        yield annotation
    if get_origin(annotation) is dict:
        yield dict
    for one in get_args(annotation):
        yield from _plain_kinds(one)


def _holds_truth(value: object) -> bool:
    """Whether a value, or one in nested lists, is a boolean; tables check themselves."""
    if isinstance(value, list | tuple):
        return any(map(_holds_truth, value))
    return isinstance(value, bool)


class Strict(Numbers):
    """A table that rejects unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Misplaced(ValueError):
    """Error in one entry that is found when the whole file is checked.

    Attributes:
        key: Its path in the file.
        way_out: How to correct it; empty for the usual way in that file.
    """

    def __init__(self, sentence: str, key: Sequence[str | int], way_out: str = "") -> None:
        """Keep the path."""
        self.key, self.way_out = key, way_out
        super().__init__(sentence)


_MEANT = "pipeline.intake.meant:key"
"""Door of the intake: what an unknown key may have been meant to be."""

_Record = TypeVar("_Record", bound=BaseModel)
_Part = TypeVar("_Part", str, str | int)


def checked(
    kind: type[_Record],
    content: Mapping[str, Any],
    file: str,
    whole: str,
    way_out: str,
    text: str = "",
) -> _Record:
    """Validate the content of a file as a record.

    Args:
        kind: Class of the record.
        content: Content of the file.
        file: Its name, for the message.
        whole: Subject of the message if no single key is wrong; empty for none.
        way_out: How to correct it.
        text: Text of the file, to find the line; empty if there is none.

    Raises:
        InputError: An unknown key, a missing table or a value of the wrong kind.
    """
    try:
        return kind.model_validate(content)
    except ValidationError as problem:
        words, message = first_wrong(problem)
        first = decisive(problem)
        words, key = _without_unions(kind, words), _path(kind, first["loc"])
        cause = first.get("ctx", {}).get("error")
        if isinstance(cause, Misplaced):
            key, way_out = list(cause.key), cause.way_out or way_out
        line = toml.line_of(text, key)
        if first["type"] == "extra_forbidden":
            way_out = _meant(kind, key) or way_out
        if first["type"] == "too_long":  # a decimal comma splits a number in two
            way_out = toml.remedy(text, line, way_out)
        if first["type"] == "value_error":
            message, way_out = _parted(message, way_out)
        where = ".".join(words) or whole
        sentence = f"{where}: {message}" if where else message
        raise InputError(sentence, way_out, file=file, line=line) from problem


def _meant(kind: type[BaseModel], key: Sequence[str | int]) -> str | None:
    """Suggestion for an unknown key; None without the intake."""
    found = doors.found(_MEANT)
    return found(kind, key) if found else None


def _parted(message: str, usual: str) -> tuple[str, str]:
    """What is wrong, and the way out, which only sentences of our own have in them."""
    wrong, own, stated = message.partition("; ")
    return wrong, stated if own else usual


def _without_unions(kind: type[BaseModel], words: Sequence[_Part]) -> list[_Part]:
    """A path without the members of a union, which are not keys."""
    called = {record.__name__ for record, _ in _nested(kind)}
    return [one for one in words if one not in called]


def _path(kind: type[BaseModel], location: Sequence[str | int]) -> list[str | int]:
    """Keys of a file that lead to a wrong entry."""
    return [part for one in _without_unions(kind, location) for part in apart(one)]


def apart(word: str | int) -> list[str | int]:
    """Split the key `tool.capsules`, a table within another one."""
    inner = isinstance(word, str) and word.startswith("tool.")
    return [*str(word).split(".", 1)] if inner else [word]


def _nested(kind: type[BaseModel]) -> Iterator[tuple[type[BaseModel], bool]]:
    """Records within a record, at any depth."""
    for info in kind.model_fields.values():
        for inner in records(info.annotation):
            yield inner
            yield from _nested(inner[0])


def records(annotation: object, called: bool = False) -> Iterator[tuple[type[BaseModel], bool]]:
    """Records that a type contains, and whether each is named by the author of the file."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, called
    for one in get_args(annotation):
        yield from records(one, called or get_origin(annotation) is dict)
