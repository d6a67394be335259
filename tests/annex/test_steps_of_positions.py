"""The figure of what each part of a model of positions contributes."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from pipeline.annex.figures.geometry import _draw_steps

STEPS = ("nominal table", "geometric parameters", "springs", "causes", "laws")


def test_each_step_has_a_curve_of_its_own_colour():
    """The last one, what the model reaches in the end, as well."""
    held = pd.concat(
        pd.DataFrame({
            "model": name, "parting": "every tenth pose",
            "distance_m": 1e-3 / (k + 1) * np.linspace(0.5, 1.5, 20),
        })
        for k, name in enumerate(STEPS)
    )  # fmt: skip
    canvas = Figure()

    tips = _draw_steps(canvas, None, {"held_out": held})

    (axes,) = canvas.axes
    assert [line.get_label() for line in axes.lines] == [*STEPS]
    assert len({line.get_color() for line in axes.lines}) == len(STEPS)
    middle = [float(np.median(line.get_xdata())) for line in axes.lines]
    assert middle == pytest.approx([1 / k for k in range(1, 6)])
    assert [words[0].split(":")[0] for words in tips.values()] == [*STEPS]
