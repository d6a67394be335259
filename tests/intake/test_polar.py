"""Evidence that three numbers without titles are two angles and a distance."""

import numpy as np
import pytest

from pipeline.intake._polar import Polar, beams, in_two_faces
from pipeline.intake.proposal import propose
from pipeline.readers import ExportSettings
from pipeline.readers._text import text

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


@pytest.mark.parametrize(("remark", "page", "sense"), [
    ("水平角：俯视逆时针为正", "gb18030", "counter-clockwise"),
    ("水平角：顺时针为正", "gb18030", "clockwise"),
    ("angles counter-clockwise from above", "utf-8", "counter-clockwise"),
    ("angle horizontal dans le sens horaire", "utf-8", "clockwise"),
    ("Hz im Uhrzeigersinn", "utf-8", "clockwise"),
    ("방위각: 반시계 방향", "cp949", "counter-clockwise"),
])  # fmt: skip
def test_a_stated_sense_of_angles_is_taken_in_any_language(remark, page, sense):
    rows = "".join(
        f"{k};位姿1空;T{k % 3};{5 + k / 7};{40 + 9 * k};{80 + 7 * k}\n" for k in range(9)
    )
    titles = "序号;组;靶球;斜距(m);水平角(°);天顶角(°)"
    if page == "cp949":
        titles, rows = (
            "번호;그룹;점;사거리(m);방위각(°);천정각(°)",
            rows.replace("位姿1空", "자세1"),
        )
    found = propose(text("t.txt", f"{remark}\n{titles}\n{rows}".encode(page)), ExportSettings())

    assert not found.questions
    assert (found.hints.unit, found.hints.angle, found.hints.vertical) == ("m", "deg", "zenith")
    assert found.hints.horizontal == sense
