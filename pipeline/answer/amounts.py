"""Parameters of causes with their sizes, in the units that people read them in."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.answer.contract import Amplitude, Cause
from pipeline.base.quantities import MISSING, common_prefix, known, prefixed, scaled, with_std

_UNITS = {"m/s": (1e-6 / 3600, "µm/h"), "rad/s": (1e-6 / 3600, "µrad/h"), "1": (0.01, "%")}
"""Units that people do not read as they are computed: size of the one shown, and its name."""

_BARE = ("degrees_of_freedom", "size")
"""Parameters that are no shares where they have no unit."""

_WHOLE = ("kg", "s")
"""Units that take no prefix."""


def amount(one: Amplitude) -> str:
    """`51.5 ± 3.8 nrad/(N·m)`."""
    if not known(one.value):
        return MISSING
    factor, unit = _shown_in(one)
    return f"{with_std(one.value / factor, scaled(one.std, factor))} {unit}".rstrip()


def _shown_in(one: Amplitude) -> tuple[float, str]:
    """The size of the unit shown, and its name."""
    if one.unit in _WHOLE or (one.unit == "1" and one.name in _BARE):
        return 1.0, one.unit.removeprefix("1")
    if one.unit in _UNITS:
        return _UNITS[one.unit]
    factor, letter = common_prefix([one.value])
    return factor, prefixed(one.unit, letter)


def sizes(cause: Cause) -> Iterator[str]:
    """Each parameter of a cause: `roll compliance of the carriage about the rail: 15 ± 1 ...`."""
    for one in cause.parameters:
        yield f"{one.meaning}: {amount(one)}"
