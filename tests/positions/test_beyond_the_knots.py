"""Curves of a joint's error outside the range of its data, and of a rail's bed between stations."""

import numpy as np
import pytest

from pipeline.positions.random_curve import along_bed, over


def test_beyond_its_knots_a_curve_has_the_variance_of_its_prior():
    """S = 2e-4 rad: variance 4e-8 rad^2 far outside, none added between the knots."""
    curve = over(2, np.deg2rad([-30.0, 40.0]), False, np.deg2rad(10.0), 2e-4)

    assert curve.beyond(np.deg2rad([-90.0, 0.0, 90.0])) == pytest.approx([4e-8, 0.0, 4e-8])


def test_spectrum_of_a_bed_falls_with_the_square_of_the_frequency():
    """From waves of 12 m to waves of 1.2 m, by the cosine transform of the correlation."""
    curve = along_bed(np.array([0.0, 30.0]), 1e-4, 7)
    apart = curve.spacing * np.arange(curve.count)
    wave = np.geomspace(1 / 12, 1 / 1.2, 30)
    power = 2 * np.cos(2 * np.pi * wave[:, None] * apart) @ curve.shape()[0] - 1
    slope = np.polyfit(np.log(wave), np.log(power), 1)[0]

    assert slope == pytest.approx(-2.0, abs=0.3)
