"""Nominal positions of base reflectors are known as well as a surveyor measured them."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from pipeline.base.covariance import columns
from pipeline.faults.base_reading import base_outlier
from pipeline.reduction.register import register
from pipeline.reduction.settings import parse
from tests.reduction.test_ingest import TOML

SURVEYED = np.array(
    [[-0.4461, 1.198, 0.0284], [1.901, -1.2491, 0.0339], [4.197, 1.2213, 0.0314],
     [6.5983, -1.1997, 0.4125], [9.2022, 1.2513, 0.0267]]
)  # fmt: skip
NOISE, ROUNDS = 1e-5, 3


def settings(places, stated=None):
    """The campaign with these places, and the stated uncertainty [m] if any."""
    head, _, rest = TOML.partition("[base_frame]")
    rows = "".join(f"B{k} = {list(at)}\n" for k, at in enumerate(places.tolist(), 1))
    more = "" if stated is None else f"[base_frame_uncertainty]\nsigma_m = {stated}\n"
    return parse(f"{head}[base_frame]\n{rows}{more}[scale]{rest.partition('[scale]')[2]}")


def readings(rng, off):
    """Three rounds by a tracker somewhere, of reflectors that are `off` from the survey [m]."""
    turn = Rotation.from_euler("z", 30, degrees=True)
    at = np.tile(turn.apply(SURVEYED + off - [3, -4, 1]), (ROUNDS, 1))
    at = at + rng.normal(0, NOISE, at.shape)
    table = pd.DataFrame(at, columns=["x_m", "y_m", "z_m"])
    table[columns()] = np.array([1, 0, 0, 1, 0, 1]) * NOISE**2
    table["target"] = [f"B{k}" for k in range(1, 6)] * ROUNDS
    table["group"] = np.repeat([f"base{k}" for k in range(ROUNDS)], 5)
    return table.assign(pose=np.nan, time=pd.NaT, file="tracker.csv", line=1)


@pytest.mark.whole
@pytest.mark.parametrize("stated", [6e-5, None], ids=["stated", "from its digits"])
def test_the_frame_is_as_uncertain_as_the_survey(stated):
    """The rotation scatters from survey to survey by what is stated of them."""
    rng = np.random.default_rng(8)
    true, campaign = stated or 1e-4 / np.sqrt(12), settings(SURVEYED, stated)
    found = [register(campaign, readings(rng, rng.normal(0, true, (5, 3)))) for _ in range(150)]
    turned = [
        (Rotation.from_matrix(one.R) * Rotation.from_euler("z", 30, degrees=True)).as_rotvec()
        for one in found
    ]
    std = np.sqrt([np.diag(one.cov)[:3] for one in found]).mean(axis=0)

    assert np.std(turned, axis=0) == pytest.approx(std, rel=0.2)
    assert np.mean([one.from_scatter for one in found]) == 0
    assert not any(base_outlier(one, 1.0) for one in found[:20])


def test_digits_of_a_drawing_are_exact():
    """Whole millimetres or more: a reflector 0.1 mm from there contradicts the others."""
    rng = np.random.default_rng(9)
    assert settings(np.round(SURVEYED, 3)).base_std == 0.0
    assert settings(SURVEYED).base_std == pytest.approx(28.9e-6, rel=1e-2)
    assert settings(np.round(SURVEYED, 3), 5e-5).base_std == 5e-5
    drawn = np.round(SURVEYED, 2) + np.outer(np.arange(5) == 1, [0, 4e-4, 0])
    assert settings(drawn).base_std == 0.0  # one place that was corrected is no survey

    off = np.zeros((5, 3))
    off[2, 2] = 1e-4
    for stated, contradicted in ((0.0, True), (1e-4, False)):
        one = register(settings(SURVEYED, stated), readings(rng, off))
        assert (chi2.sf(one.chi2, one.dof) < 1e-4) == contradicted
