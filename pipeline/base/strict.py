"""Settings as typed records that know every word they allow."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Strict(BaseModel):
    """A table that reports unknown words instead of overlooking them."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
