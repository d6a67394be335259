"""Thermal growth of rail and base frame relative to campaign.toml, at the temperature of the hall.

Nominal coordinates hold at 20 degC (ISO 1:2022). At T the base reflectors are at n (1 + g), and g
is estimated from the thermometer, g = alpha (T - 20 degC), and from the reflectors. Readings are
divided by 1 + g, so that F_b is the base frame at 20 degC whatever the day: rail and arm grow with
it, and the controller's rail and joint values hold unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array

STEEL = 11.5e-6
"""Expansion of steel [1/K]: (11.5 +- 1.0) 1e-6, ISO 3650:1998, 6.2, for gauge blocks."""
_STEEL_STD = 1.0e-6 / 3**0.5
"""Its standard uncertainty [1/K]: a uniform distribution within the limits of ISO 3650
(GUM 4.3.7)."""
REFERENCE_C = 20.0
"""Temperature at which lengths hold [degC], ISO 1:2022."""
_THERMOMETER_K = 1.0
"""Standard uncertainty of a rail's mean temperature by one thermometer in the hall [K]."""
_HALL_K = 10.0
"""Standard uncertainty of the temperature if it is not stated [K]: two halls in three are within
this of 20 degC."""


_NONE = 1e-12
"""Probability below which it is rounding [1]."""


@dataclass(frozen=True)
class BaseGrowth:
    """Relative growth of the base frame [1].

    Attributes:
        value: As used.
        std: Its standard uncertainty.
        expected: Expected from the temperature; None where none is stated.
        expected_std: Its standard uncertainty, or the prior standard deviation where none is
            stated.
        seen: Estimated from the base reflectors alone; None where they cannot resolve it.
        seen_std: Its standard uncertainty.
        probability: That the base frame has grown at all: 1 where a temperature is stated.
    """

    value: float = 0.0
    std: float = 0.0
    expected: float | None = None
    expected_std: float = STEEL * _HALL_K
    seen: float | None = None
    seen_std: float = np.inf
    probability: float = 0.0

    @property
    def determined(self) -> float:
        """Fraction of the value that the reflectors determine, as opposed to the prior."""
        known = self.expected_std**2
        return self.probability * known / (known + self.seen_std**2)


def by_temperature(temperature_c: float | None) -> BaseGrowth:
    """Prior of the growth before any reflector is read: g = alpha (T - 20 degC)."""
    if temperature_c is None:
        return BaseGrowth()
    warmer = temperature_c - REFERENCE_C
    std = float(np.hypot(STEEL * _THERMOMETER_K, _STEEL_STD * warmer))
    value = STEEL * warmer
    return BaseGrowth(value, std, expected=value, expected_std=std, probability=1.0)


def with_reflectors(
    before: BaseGrowth, stated: bool, residual: Array, places: Array, rigid: Array
) -> BaseGrowth:
    """Update the growth with the readings of the base reflectors.

    r + g n - D x = e, e ~ N(0, 1): g from what no motion x of the tracker explains. Where no
    temperature is stated, g is the mean over two explanations of reflectors that disagree: they
    scatter more than stated, by any factor f >= 1, or they have grown together, with the stated
    scatter.

    Args:
        before: Prior from the temperature.
        stated: Whether the noise is stated; else it is estimated from the residuals.
        residual: Nominal minus placed, r, whitened, shape (3 m,).
        places: Nominal positions n [m], whitened, shape (3 m,).
        rigid: Columns D of a motion of the tracker, whitened, shape (3 m, 6).
    """
    U = linear.orthonormal(rigid)
    r, n = (one - U @ (U.T @ one) for one in (residual, places))
    weight, dof = float(n @ n), len(r) - 7
    if dof < 1 or weight <= 0:
        return before
    seen = -float(n @ r) / weight
    scatter, rest = float(r @ r), float(r @ r - (n @ r) ** 2 / weight)
    factor = rest / dof if not stated else max(1.0, rest / dof)
    if before.expected is None:
        return _untold(before, seen, weight**-0.5, scatter, rest, dof)
    std = (factor / weight) ** 0.5
    known, data = before.expected_std**-2, std**-2
    value = (known * before.expected + data * seen) / (known + data)
    return BaseGrowth(
        value=value,
        std=(known + data) ** -0.5,
        expected=before.expected,
        expected_std=before.expected_std,
        seen=seen,
        seen_std=std,
        probability=1.0,
    )


def _untold(
    before: BaseGrowth, seen: float, std: float, scatter: float, rest: float, dof: int
) -> BaseGrowth:
    """Mean over a base frame that has grown and one that has not, without a stated temperature."""
    wide = before.expected_std**2
    narrower = 0.5 * np.log1p(wide / std**2) + 0.5 * seen**2 / (wide + std**2)
    odds = -0.5 * rest - narrower - _any_scatter(scatter, dof + 1)
    p = float(1 / (1 + np.exp(np.clip(-odds, -700, 700))))
    if p < _NONE:
        return before
    value = p * seen * wide / (wide + std**2)
    spread = (p * std**2 + p * (1 - p) * seen**2) ** 0.5
    return BaseGrowth(value, spread, None, before.expected_std, seen, std, p)


def _any_scatter(square: float, dof: int) -> float:
    """Log likelihood of residuals with the best factor f >= 1 on their noise."""
    if square <= dof:
        return -0.5 * square
    return -0.5 * dof * (1 + float(np.log(square / dof)))
