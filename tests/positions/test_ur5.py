"""The UR5 that ships with the project: real positions, predicted for left-out poses."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.library.kinematic_model import kinematic_model
from pipeline.library.target_model import predict
from pipeline.positions.positioned import as_read, usable
from pipeline.positions.study import study
from pipeline.store.campaign import find

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_every_fifth_pose_of_the_grid_is_predicted_to_six_hundredths_of_a_millimetre():
    raw = find(ROOT, "ur5_tsinghua").read()
    read = usable(raw.settings, raw.robot, *as_read(raw.settings, raw.robot, raw.files))
    out = np.arange(len(read.readings)) % 5 == 0
    rows = np.flatnonzero(~out)
    found = study(
        raw.robot, read.readings.part(rows), read.weights.part(rows), {}, None, (np.nan, np.nan),
        np.random.default_rng(1),
    )  # fmt: skip
    there = read.readings.part(out)
    told = predict(
        kinematic_model("ur5", found.final), there.q, np.zeros((len(there), 3)), there.payload,
        there.temperature,
    )  # fmt: skip
    final = found.final.readings  # series as split: that of the previous pose
    before = np.clip(np.searchsorted(final.line, there.line) - 1, 0, None)
    frames = found.final.mechanism.frames[final.series[before]]
    seen = np.einsum("mji,mtj->mti", frames[:, :3, :3], there.at - frames[:, None, :3, 3])
    off = told.at - seen
    noise = found.final.scatter.position

    assert np.linalg.norm(off, axis=2).mean() < 0.065e-3
    inside = np.abs(off) < 1.96 * np.hypot(told.std[..., :3], noise)
    assert 0.90 < inside.mean() < 0.985
