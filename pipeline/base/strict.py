"""Settings as typed records that know every word they allow."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

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
