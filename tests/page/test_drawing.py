"""The cell as drawn in Setup."""

import re
from itertools import combinations

from pipeline.page import drawing

TEXT = re.compile(r'<text x="([\d.]+)" y="([\d.]+)" dx="(-?\d+)"([^>]*)>([^<]*)</text>')


def test_names_of_points_never_overlap(tmp_path):
    """On a rail of 18 m the effector is a dot seen from above; every name stays readable."""
    tool = {"load_point": [0.15, 0, 0.25], "P1": [0.2, 0.05, 0.12], "P2": [-0.1, 0.2, 0.1]}
    base = {"B1": [0.6, -0.5, -0.3], "B2": [0.6, 18.5, -0.3], "B3": [-0.6, 18.5, -0.28]}
    views = drawing.cell("kr500_rail", tmp_path, None, tool, base).split("</svg>")[:2]

    assert len(views) == 2
    for view in views:
        boxes, shown = [], []
        for x, y, dx, more, words in TEXT.findall(view):
            long = 6.0 * len(words)
            left = float(x) + float(dx) - (long if "end" in more else 0.0)
            boxes.append((left, left + long, float(y)))
            shown += words.split(", ")
        assert sorted(shown) == sorted(["F_b", *tool, *base])
        for (a, b, y), (c, d, v) in combinations(boxes, 2):
            assert b <= c or d <= a or abs(y - v) >= 12.0
