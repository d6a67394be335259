"""Numbers for readers: digits justified by their uncertainty, units with prefixes."""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Iterable
from decimal import ROUND_HALF_EVEN, Context, Decimal
from typing import TypeGuard

MISSING = "–"

_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}

MM = 1e3
"""Millimetres per metre; millimetres are the unit of pages and result.json."""

_ROUNDING = 1e-15
"""Relative rounding of a double [1]; no smaller uncertainty is meaningful."""

_DIGITS = r"\d⁰¹²³⁴⁵⁶⁷⁸⁹"
_UNIT = r"%|°C|deg|σ|×|±|[pnµmkMG]?(?:N|m|rad|kg|g|s)(?:[·/][\w()·/]*)?"
_BINDS = re.compile(
    rf"(?<=[{_DIGITS})]) (?=(?:{_UNIT})(?:\W|$))|(?<=[×±=<]) (?=[\d(])|(?<=\b[pkU]) (?=[=<])"
    r"|(?<=\b[AEJS]\d) (?=-?\d)|(?<=\d,) (?=-?[\d.]+[,)])"
)
"""Spaces inside a quantity or a relation, at which no line may break."""

_POWER = re.compile(
    rf"(?:(?<=[=<>±×] )|(?<=\+- )|(?<=times )|(?=[\d.e+-]+ (?:\+-|times|{_UNIT})(?:\W|$)))"
    r"(?<![\w.])(\d(?:\.\d+)?)e([+-]\d\d\d?)(?![\w.])"
)
"""A quantity as Python writes it: related to another, or with a unit. Alone, 1e-05 is a name."""

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def known(value: object) -> TypeGuard[float]:
    """Whether this is a finite number."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value)


def _place_of(std: float, significant: int = 2) -> int:
    """Decimal exponent of the last digit that an uncertainty justifies.

    Two significant digits of the uncertainty after rounding: 0.0994 gives 0.001, 0.0996 becomes
    0.10
    and gives 0.01.
    """
    rounded = Context(significant, ROUND_HALF_EVEN).create_decimal(repr(float(std)))
    return rounded.adjusted() - significant + 1


def _at_place(value: float, place: int) -> str:
    """Number rounded at a decimal place, without an exponent: (1234.5, 1) -> 1230.

    A double has no more than seventeen digits, whatever its uncertainty would justify.
    """
    exact = Decimal(repr(float(value)))
    return f"{round(exact, -max(place, exact.adjusted() - 16)):zf}"


def with_std(value: float | None, std: float | None) -> str:
    """`80.0 ± 1.6`: two significant digits of the uncertainty determine those of the value."""
    if not known(value):
        return MISSING
    if not known(std) or std <= _ROUNDING * abs(value):
        return plain(value)
    if max(abs(value), std) < 1e-3 or max(abs(value), std) >= 1e6:
        return _scientific(value, std)
    place = _place_of(std)
    return f"{_at_place(value, place)} ± {_at_place(std, place)}"


def with_uncertainty(value: float, expanded: float) -> tuple[str, str]:
    """A value and its expanded uncertainty, each to the place of the latter's second digit."""
    if not known(expanded) or expanded <= _ROUNDING * abs(value):
        return plain(value), plain(expanded)
    place = _place_of(expanded)
    return _at_place(value, place), _at_place(expanded, place)


def bracketed(value: float | None, std: float | None) -> str:
    """`with_std` in brackets, so that a unit may follow."""
    text = with_std(value, std)
    return f"({text})" if "±" in text and not text.startswith("(") else text


def _scientific(value: float, std: float) -> str:
    power = Decimal(repr(float(max(abs(value), std)))).adjusted()
    scaled = [float(Decimal(repr(float(v))).scaleb(-power)) for v in (value, std)]
    place = _place_of(scaled[1])
    return f"({_at_place(scaled[0], place)} ± {_at_place(scaled[1], place)}) × {_ten_to(power)}"


def _ten_to(power: int) -> str:
    """Power of ten as text, such as 10⁻⁸."""
    return f"10{str(power).translate(_SUPERSCRIPT)}"


def interval(bounds: Iterable[float | None] | None, std: float | None) -> str:
    """`76.9 to 83.1` in the digits of the uncertainty, or `above 76.9` without an upper limit."""
    low, high = [*(bounds or []), None, None][:2]
    place = _place_of(std) if known(std) and std > 0 else None
    below, above = _limit(low, place), _limit(high, place)
    if below and above:
        return f"{below} to {above}"
    if above:
        return f"below {above}"
    return f"above {below}" if below else MISSING


def _limit(bound: float | None, place: int | None) -> str | None:
    if not known(bound):
        return None
    return plain(bound) if place is None else _at_place(bound, place)


def plain(value: float | None, significant: int = 3) -> str:
    """Number without a stated uncertainty, to some significant digits."""
    if not known(value):
        return MISSING
    if value == 0:
        return "0"
    if 1e-4 <= abs(value) < 1e6:
        return _at_place(value, _place_of(abs(value), significant))
    exact = Decimal(repr(float(value)))
    power = Decimal(f"{exact:.{significant - 1}e}").adjusted()  # 9.996 is 1.00 × 10
    return f"{_at_place(float(exact.scaleb(-power)), 1 - significant)} × {_ten_to(power)}"


def percent(ratio: float | None, significant: int = 2) -> str:
    """Ratio in per cent."""
    return MISSING if not known(ratio) else f"{plain(100 * ratio, significant)} %"


def probability(p: float | None) -> str:
    """Probability as text: never 100 % for what is only nearly certain."""
    if not known(p):
        return MISSING
    if p > 0.999:
        return "over 99.9 %"
    return "below 0.1 %" if p < 0.001 else f"{plain(100 * p, 3 if p > 0.99 else 2)} %"


def p_value(p: float | None) -> str:
    """`p = 0.33`, or `p < 10⁻⁶`: no distribution is known further out in its tail."""
    if not known(p):
        return "p unknown"
    return f"p = {plain(p, 2)}" if p >= 1e-6 else f"p < {_ten_to(-6)}"


def typeset(text: str) -> str:
    """Sentence for print: ± and powers of ten, no line break inside a quantity."""
    text = _POWER.sub(lambda found: f"{found[1]} × {_ten_to(int(found[2]))}", text)
    return _BINDS.sub("\N{NO-BREAK SPACE}", re.sub(r"\+-(?= ?\d)", "±", text))


def common_prefix(values: Iterable[float | None]) -> tuple[float, str]:
    """Factor and letter of one SI prefix for a whole column, from its median."""
    sizes = sorted(abs(v) for v in values if known(v) and v != 0)
    if not sizes:
        return 1.0, ""
    power = min(max(3 * math.floor(math.log10(sizes[len(sizes) // 2]) / 3), -9), 9)
    return 10.0**power, _PREFIXES[power]


def mix(weights: Iterable[float], names: Iterable[str]) -> str:
    """Linear combination of names: `c_theta2 + 0.58 c_theta4`."""
    text = ""
    for weight, name in zip(weights, names, strict=True):
        sign = "-" if weight < 0 else "+" if text else ""
        size = plain(abs(weight))
        size = "" if float(f"{weight:.3g}") in (1, -1) else f"{size} "
        text += f" {sign} {size}{name}" if text else f"{sign}{size}{name}"
    return text


def scaled(value: float | None, factor: float) -> float | None:
    """Value in a prefixed unit; None stays None."""
    return None if value is None else value / factor


def prefixed(unit: str, letter: str) -> str:
    """Unit with a prefix on its first factor, spaces as products: `MN·m/rad`."""
    return letter + unit.replace(" ", "·") if unit else ""
