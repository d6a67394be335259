"""Laws of noise of readings, as errors in the tracker's frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array

SIGMA_M = 3e-5
"""Standard uncertainty per axis of one reading [m], as stated in campaign.toml."""

Noise = Callable[[Array, Array, np.random.Generator], Array]
"""Function of the hours of the readings, shape (r,), and their positions, tracker's frame, shape
(r, 3) [m]; returns errors, shape (r, 3) [m], tracker's frame."""


@dataclass(frozen=True)
class White:
    """Normal, e ~ N(0, sigma^2 I).

    Attributes:
        sigma_m: Per axis [m].
    """

    sigma_m: float = SIGMA_M

    def __call__(self, hours: Array, at: Array, rng: np.random.Generator) -> Array:
        """Errors [m]."""
        return rng.normal(0, self.sigma_m, (len(hours), 3))


@dataclass(frozen=True)
class Student:
    """Student's t with the stated variance, e = sigma sqrt((nu - 2) / nu) z / sqrt(chi2_nu / nu).

    Attributes:
        freedom: nu, above 2.
        per_axis: Whether each axis has its own scale; otherwise the three axes of a reading share
            one.
    """

    freedom: float
    per_axis: bool = False

    def __call__(self, hours: Array, at: Array, rng: np.random.Generator) -> Array:
        """Errors [m]."""
        normal = rng.normal(size=(len(hours), 3))
        width = rng.chisquare(self.freedom, (len(hours), 3 if self.per_axis else 1))
        return np.asarray(SIGMA_M * np.sqrt((self.freedom - 2) / width) * normal)


@dataclass(frozen=True)
class Bursts:
    """A fraction of the readings has larger noise.

    Attributes:
        share: Fraction of the readings, drawn individually.
        times: Factor of their noise.
    """

    share: float = 0.05
    times: float = 4.0

    def __call__(self, hours: Array, at: Array, rng: np.random.Generator) -> Array:
        """Errors [m]."""
        wide = np.where(rng.random(len(hours)) < self.share, self.times, 1.0)
        return np.asarray(SIGMA_M * wide[:, None] * rng.normal(size=(len(hours), 3)))


@dataclass(frozen=True)
class Spells:
    """Larger noise for some minutes, as of vibration, sun or a draught, at random times.

    Attributes:
        every: Mean time from one spell to the next [min].
        minutes: How long each lasts [min].
        times: Factor of the noise, drawn for each spell between these.
    """

    every: float = 60.0
    minutes: float = 8.0
    times: tuple[float, float] = (3.0, 6.0)

    def __call__(self, hours: Array, at: Array, rng: np.random.Generator) -> Array:
        """Errors [m]."""
        time = 60 * (hours - hours[0])
        begun = rng.uniform(0, time[-1], rng.poisson(time[-1] / self.every))
        since = time[:, None] - begun
        there = (since >= 0) & (since < self.minutes)
        wide = np.where(there, rng.uniform(*self.times, len(begun)), 1.0).max(axis=1, initial=1.0)
        return np.asarray(White()(hours, at, rng) * wide[:, None])


@dataclass(frozen=True)
class Polar:
    """A tracker by its data sheet: range and angles, e = d u + r (across, two axes); m and m/m.

    Attributes:
        range_m: Standard uncertainty along the beam.
        range_per_m: Added per metre of distance.
        across_m: Standard uncertainty across the beam, per axis.
        across_per_m: Added per metre of distance.
        freedom: Degrees of freedom of Student's t with that variance; normal if infinite.
        wide: Fraction of the readings with four times the noise.
    """

    range_m: float
    range_per_m: float
    across_m: float
    across_per_m: float
    freedom: float = np.inf
    wide: float = 0.0

    def __call__(self, hours: Array, at: Array, rng: np.random.Generator) -> Array:
        """Errors [m]."""
        far = np.linalg.norm(at, axis=1, keepdims=True)
        beam = at / far
        free = rng.normal(size=at.shape) * (self.across_m + self.across_per_m * far)
        across = free - beam * np.sum(beam * free, axis=1, keepdims=True)
        along = rng.normal(size=far.shape) * (self.range_m + self.range_per_m * far)
        times = np.where(rng.random(len(at)) < self.wide, 4.0, 1.0)
        if np.isfinite(self.freedom):
            times *= np.sqrt((self.freedom - 2) / rng.chisquare(self.freedom, len(at)))
        return np.asarray(times[:, None] * (across + along * beam))


@dataclass(frozen=True)
class Wander:
    """White noise plus a slow common error: a stationary Ornstein-Uhlenbeck process.

    d_0 ~ N(0, s^2), d_i = a d_{i-1} + s sqrt(1 - a^2) z_i with a = exp(-(t_i - t_{i-1}) / T),
    independently for each axis, whichever reflector is read.

    Attributes:
        times: s over sigma.
        minutes: T.
    """

    times: float
    minutes: float

    def __call__(self, hours: Array, at: Array, rng: np.random.Generator) -> Array:
        """Errors [m]."""
        white = White()(hours, at, rng)
        return np.asarray(white + self.times * SIGMA_M * _walk(hours, self.minutes, rng))


@dataclass(frozen=True)
class Turn:
    """White noise plus a slow rotation of the instrument: w x p, with w like d of `Wander`.

    Attributes:
        times: Displacement per axis at the mean range of all readings, over sigma.
        minutes: T.
    """

    times: float
    minutes: float

    def __call__(self, hours: Array, at: Array, rng: np.random.Generator) -> Array:
        """Errors [m]."""
        white = White()(hours, at, rng)
        turn = _walk(hours, self.minutes, rng) / np.linalg.norm(at, axis=1).mean()
        return np.asarray(white + self.times * SIGMA_M * np.cross(turn, at))


def _walk(hours: Array, minutes: float, rng: np.random.Generator) -> Array:
    """Stationary Ornstein-Uhlenbeck process of unit variance along three axes."""
    keeps = np.exp(-60 * np.diff(hours) / minutes)
    steps = rng.normal(size=(len(hours), 3))
    d = np.empty_like(steps)
    d[0] = steps[0]
    for i, a in enumerate(keeps, 1):
        d[i] = a * d[i - 1] + np.sqrt(1 - a * a) * steps[i]
    return d
