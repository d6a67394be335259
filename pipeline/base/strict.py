"""Settings as typed records that know every word they allow."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from pipeline.base.errors import InputError, first_wrong

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


def with_parts(*names: str) -> AfterValidator:
    """For text that must be a regular expression with some named parts."""
    needed = ", ".join(f"(?P<{name}>...)" for name in names)

    def check(pattern: str) -> str:
        try:
            parts = re.compile(pattern).groupindex
        except re.error as problem:
            raise ValueError(f"not a regular expression ({problem})") from problem
        if not {*names} <= {*parts}:
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
