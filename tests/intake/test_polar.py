"""Evidence that three numbers without titles are two angles and a distance."""

import numpy as np
import pytest

from pipeline.intake._polar import Polar, beams, in_two_faces

RANGE, AZIMUTH = 3.0, 12.3456789


def tilted(cosine):
    """Two readings of a target, range azimuth elevation; it moves at this cosine to the beam."""
    step = 0.02
    along, across = step * cosine, step * np.sqrt(1 - cosine**2)
    first = [RANGE, AZIMUTH, 0.0]
    x, z = RANGE + along, across
    return [first, [np.hypot(x, z), AZIMUTH, np.degrees(np.arctan2(z, x))]]


def test_two_movements_nearly_along_the_beam_may_be_chance():
    """Both within 2 % and 1 % of the beam: P(product of two uniforms < x) = x (1 - ln x) > 1e-3."""
    numbers = np.array([*tilted(0.98), *tilted(0.99)])
    names = ["P1", "P1", "P2", "P2"]
    x = 0.02 * 0.01
    assert x < 1e-3 < x * (1 - np.log(x))

    assert Polar((0, 1, 2), "deg", "elevation") in beams(numbers, names, "m")


@pytest.mark.parametrize("vertical", ["elevation", "zenith"])
def test_both_faces_are_seen_from_wherever_the_vertical_angle_counts(vertical):
    """The plunged telescope reads 180 deg - elevation, or 360 deg - zenith angle."""
    up = np.array([12.3, -4.7, 31.0])
    angle = up if vertical == "elevation" else 90 - up
    other = 180 - angle if vertical == "elevation" else 360 - angle
    azimuth, length = np.array([20.0, 75.0, 160.0]), np.array([3.1, 4.2, 5.3])
    one = np.column_stack([length, azimuth, angle])
    two = np.column_stack([length, azimuth + 180, other])
    names = ["P1", "P2", "P3"] * 2

    found = in_two_faces(np.vstack([one, two]), names, ["1"] * 3 + ["2"] * 3)

    assert Polar((0, 1, 2), "deg", vertical) in found
    assert {way.vertical for way in found} == {vertical}
