"""The perspective view of the cell, and drawings in pixels."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pandas as pd
import pytest

from pipeline.annex.figures.sheet import FROM, TO, PixelSheet, View, outlines
from pipeline.report.svg import by_hand

VIEW = View(np.array([1.0, 2.0, 0.5]), 3.0, np.deg2rad(30))
EYE = np.array([np.cos(VIEW.yaw), np.sin(VIEW.yaw), 0.0])
"""Horizontal direction from the middle to the eye."""


def test_the_middle_is_where_it_is_and_z_stays_upright():
    """The middle in the middle at full size; a point above it straight above."""
    right, up, scale = VIEW(VIEW.middle + np.array([[0, 0, 0], [0, 0, 1]]))

    assert (right[0], up[0], scale[0]) == pytest.approx((0, 0, 1))
    assert right[1] == pytest.approx(0)
    assert up[1] > 0.5


def test_what_is_nearer_the_eye_is_larger_and_lower():
    """From an oblique direction above."""
    _, up, scale = VIEW(VIEW.middle + np.outer([-1, 0, 1], EYE))

    assert (np.diff(scale) > 0).all()
    assert (np.diff(up) < 0).all()


def test_right_of_the_eye_is_right():
    """Looking against x, y points to the right."""
    ahead = View(np.zeros(3), 1.0, 0.0)

    assert ahead(np.array([[0.0, 1.0, 0.0]]))[0] > 0


def test_the_outline_of_a_rod_keeps_its_radius_from_the_axis():
    """Two arcs with common tangents: no point is nearer to the segment, or farther, than r."""
    far = View(np.zeros(3), 1e6, 0.0)  # no perspective
    rows = pd.DataFrame([[0.0, -1.0, 0.0, 0.0, 1.0, 0.0]], columns=[*FROM, *TO])
    _, (outline,) = outlines(far, rows, np.array([0.2]))
    beyond = np.maximum(np.abs(outline[:, 0]) - 1, 0)

    assert np.hypot(beyond, outline[:, 1]) == pytest.approx(0.2, abs=1e-5)
    assert np.abs(outline[:, 0]).max() == pytest.approx(1.2, abs=1e-5)


def test_an_arrow_ends_in_its_point_and_texts_are_escaped():
    """And the sheet is XML of its size."""
    sheet = PixelSheet(100, 50, str.upper)
    sheet.arrow((10, 10), (10, 40), "red")
    sheet.text(5, 5, "a < b")
    root = ET.fromstring(sheet.svg)
    space = {"s": "http://www.w3.org/2000/svg"}

    assert root.get("viewBox") == "0 0 100 50"
    assert root.find("s:polygon", space).get("points").startswith("10.0,40.0 ")
    assert root.find("s:text", space).text == "A < B"


@pytest.mark.parametrize(("width", "height"), [(300, 900), (500, 100), (700, 300), (2000, 90)])
def test_a_figure_is_as_wide_on_the_page_as_it_was_drawn(width, height):
    """One by hand shrinks up to 560 px; all others keep a pixel for each point, or are scrolled."""
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"/>'

    inline = ET.fromstring(by_hand(svg).inline)

    least = int(re.fullmatch(r"min-width: (\d+)px", inline.attrib["style"])[1])
    assert (least == 0) == (width <= 560)
    assert least == 0 or width <= least <= 1.1 * width
    assert (inline.attrib.get("class") == "broad") == (least > 544)  # half a page
