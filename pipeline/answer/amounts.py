"""Parameters of causes with their sizes, in the units that people use for them."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.answer.contract import Amplitude, Cause
from pipeline.base.quantities import (
    MISSING,
    common_prefix,
    known,
    plain,
    prefixed,
    scaled,
    with_std,
)

_UNITS = {"m/s": (1e-6 / 3600, "µm/h"), "rad/s": (1e-6 / 3600, "µrad/h"), "1": (0.01, "%")}
"""Size in SI and name of the unit shown, for units that are not shown as computed."""

_BARE = ("degrees_of_freedom", "size")
"""Dimensionless parameters that are not shares, so that they are not printed in percent."""

_WHOLE = ("kg", "s")
"""Units that are shown without a prefix."""


def amount(one: Amplitude) -> str:
    """A parameter with its standard uncertainty, `51.5 ± 3.8 nrad/(N·m)`."""
    if not known(one.value):
        return MISSING
    factor, unit = _shown_in(one)
    return f"{with_std(one.value / factor, scaled(one.std, factor))} {unit}".rstrip()


def roughly(one: Amplitude) -> str:
    """A magnitude without an uncertainty, `52 nrad/(N·m)`."""
    factor, unit = _shown_in(one)
    return f"{plain(scaled(one.value, factor), 2)} {unit}".rstrip()


def _shown_in(one: Amplitude) -> tuple[float, str]:
    """Size in SI and name of the unit in which a parameter is shown."""
    if one.unit in _WHOLE or (one.unit == "1" and one.name in _BARE):
        return 1.0, one.unit.removeprefix("1")
    if one.unit in _UNITS:
        return _UNITS[one.unit]
    factor, letter = common_prefix([one.value, one.std])
    return factor, prefixed(one.unit, letter)


def sizes(cause: Cause) -> Iterator[str]:
    """Each parameter of a cause: `roll compliance of the carriage about the rail: 15 ± 1 ...`."""
    of = f" of the error in {cause.where}" if cause.evidence else ""
    for one in filter(lambda one: known(one.value), cause.parameters):
        yield f"{one.meaning}{of}: {amount(one)}"
