"""What a tracker's reading is worth, against its own axes and against draws of its angles."""

import numpy as np
import pytest

from pipeline.base import covariance
from pipeline.machine import instrument
from pipeline.machine.instrument import InstrumentNoise, beam_covariance

NOISE = InstrumentNoise(range_m=8e-6, range_per_m=4e-7, transverse_m=1.5e-5, transverse_per_m=6e-6)


def test_along_and_across_the_beam_the_data_sheet_says():
    """Constant and part per metre add linearly, one along the beam, one in each other direction."""
    position = np.array([[3.0, -4.0, 12.0], [0.0, 0.0, -2.0], [20.0, 1.0, 0.3]])
    found = covariance.symmetric(beam_covariance(position, NOISE))

    for at, C in zip(position, found, strict=True):
        reach = np.linalg.norm(at)
        along, across = 8e-6 + 4e-7 * reach, 1.5e-5 + 6e-6 * reach
        beam = at / reach
        side = np.cross(beam, [0.3, 0.5, -0.7])
        side /= np.linalg.norm(side)
        for axis, sigma in ((beam, along), (side, across), (np.cross(beam, side), across)):
            assert C @ axis == pytest.approx(sigma**2 * axis, rel=1e-9, abs=1e-20)


def test_the_covariance_is_that_of_a_range_and_two_angles():
    """Draw the range and both angles of a theodolite; the points scatter as stated."""
    rng, reach = np.random.default_rng(6), 5.0
    azimuth, elevation = 0.7, -0.4

    def point(range_m, left, up):
        flat = range_m * np.cos(elevation + up)
        return np.stack(
            [
                flat * np.cos(azimuth + left),
                flat * np.sin(azimuth + left),
                range_m * np.sin(elevation + up),
            ],
            axis=-1,
        )

    angle = (1.5e-5 + 6e-6 * reach) / reach
    e = rng.standard_normal((3, 200_000))
    drawn = point(
        reach + (8e-6 + 4e-7 * reach) * e[0], angle / np.cos(elevation) * e[1], angle * e[2]
    )
    (C,) = covariance.symmetric(beam_covariance(point(reach, 0.0, 0.0)[None], NOISE))

    assert np.cov(drawn.T) == pytest.approx(C, rel=0.02, abs=0.01 * np.trace(C))


def test_at_the_origin_the_larger_part_counts_all_round():
    """A reading without a beam, whichever part of the instrument is the worse."""
    poor_range = InstrumentNoise(range_m=5e-5, transverse_m=1e-5, transverse_per_m=1e-3)

    for noise, sigma in ((NOISE, 1.5e-5), (poor_range, 5e-5)):
        found = covariance.symmetric(beam_covariance(np.zeros((2, 3)), noise))
        assert found == pytest.approx(np.stack([sigma**2 * np.eye(3)] * 2), abs=1e-24)


def test_the_papers_share_is_the_mean_over_its_angles():
    """E[u u'] of theta uniform on [0, pi/2] and phi uniform, by quadrature, Eq. (18)."""
    half = np.pi / 2
    theta, phi = np.meshgrid(
        (np.arange(200) + 0.5) / 200 * half, (np.arange(200) + 0.5) / 200 * 2 * np.pi
    )
    u = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    ).reshape(-1, 3)
    shares = covariance.symmetric(np.stack([instrument.PAPER_SHARE, instrument.ISOTROPIC]))

    assert shares[0] == pytest.approx(u.T @ u / len(u), abs=1e-6)
    assert shares[1] == pytest.approx(np.eye(3))
