"""Parsing of the words of the command line, `NAME[:where][=size]`."""

from __future__ import annotations

import re

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.base.errors import UsageError


def parts(text: str) -> tuple[str, str]:
    """Name (with its place), and size as typed."""
    named, _, size = text.partition("=")
    return named.strip(), size.strip()


def amounts(size: str, parameters: tuple[Parameter, ...], text: str) -> Array:
    """A size in SI, shape (k,).

    Args:
        size: Empty for the typical size, `2x` for twice that, or one number per parameter in SI.
        parameters: Parameters that have the size.
        text: The whole input, for the message.

    Raises:
        UsageError: It is none of these.
    """
    typical = np.array([parameter.typical for parameter in parameters])
    times = re.fullmatch(r"(.+?)\s*x", size)
    try:
        if not size:
            return typical
        if times:
            return float(times[1]) * typical
        values = np.array([float(number) for number in size.split(",")])
    except ValueError as problem:
        raise UsageError(
            f'"{text}": {size} is no size; write a number in SI, or 2x for twice the typical size.'
        ) from problem
    if len(values) != len(typical) or not np.isfinite(values).all():
        wanted = ", ".join(f"{p.name} [{p.unit}]" for p in parameters) or "no size"
        raise UsageError(f'"{text}": it has {wanted}; give one number for each.')
    return values
