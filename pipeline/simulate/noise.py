"""Noise of readings: errors drawn in the tracker's frame and for the scale."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine import instrument
from pipeline.machine.instrument import PAPER_SIGMA_M, InstrumentNoise
from pipeline.reduction.settings import Scale


def tracker_errors(
    model: float | InstrumentNoise | Literal["paper"], at: Array, rng: np.random.Generator
) -> Array:
    """Random errors of readings, one draw per reading.

    Args:
        model: Standard uncertainty per axis [m]; `paper` for Eq. (18), a radius N(0, 0.03 mm) in a
            direction over the half sphere about z; or range and transverse parts along the beam.
        at: Readings in the tracker's frame [m], shape (..., 3).
        rng: Source of the draws.

    Returns:
        Errors in the tracker's frame [m], shape of `at`.
    """
    if isinstance(model, InstrumentNoise):
        return _beam_errors(model, at, rng)
    if model == "paper":
        return _paper_errors(at.shape[:-1], rng)
    return rng.normal(0.0, model, at.shape)


def stated_covariance(model: float | InstrumentNoise | Literal["paper"], at: Array) -> Array:
    """Covariances that the instrument's software states for readings (n, 3) [m^2], (n, 6)."""
    if isinstance(model, InstrumentNoise):
        return instrument.beam_covariance(at, model)
    if model == "paper":
        return np.tile(PAPER_SIGMA_M**2 * instrument.PAPER_SHARE, (len(at), 1))
    return np.tile(model**2 * instrument.ISOTROPIC, (len(at), 1))


def _paper_errors(shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    theta = rng.uniform(0.0, np.pi / 2, shape)
    phi = rng.uniform(-np.pi, np.pi, shape)
    radius = rng.normal(0.0, PAPER_SIGMA_M, shape)
    direction = [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]
    return radius[..., None] * np.stack(direction, axis=-1)


def _beam_errors(model: InstrumentNoise, at: Array, rng: np.random.Generator) -> Array:
    distance = np.linalg.norm(at, axis=-1, keepdims=True)
    beam = at / distance
    along = rng.standard_normal(distance.shape) * beam
    across = rng.standard_normal(at.shape)
    across = across - np.sum(across * beam, axis=-1, keepdims=True) * beam
    return (model.range_m + model.range_per_m * distance) * along + (
        model.transverse_m + model.transverse_per_m * distance
    ) * across


def scale_errors(scale: Scale, reading: Array, rng: np.random.Generator) -> Array:
    """Acting minus shown force, without the error of the gain [N], shape of `reading`."""
    constant, relative = rng.standard_normal((2, *reading.shape))
    return scale.sigma_n * constant + scale.sigma_rel * reading * relative
