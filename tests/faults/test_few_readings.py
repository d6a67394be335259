"""Small and corrupted campaigns that once ended in an internal error: each has an answer."""

import numpy as np
import pytest
from test_exchanged import LAYOUTS, case, table, written

from pipeline.reduction.register import agreed, register
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

ONE_TARGET = {"load_point": (0.15, 0.0, 0.25), "P1": (0.2, 0.05, 0.12)}


def verdict(made):
    return str(campaign_answer("few", in_memory(made)).answer.diagnosis.verdict)


def lost(made, pose):
    """The unloaded readings of a pose at the origin, as after a lost lock."""
    head, rows = table(made, "tracker.csv")
    new = [
        row[:2] + ["0.0000"] * 3 + row[5:]
        if row[0].startswith(f"pose{pose:02d}") and "unloaded" in row[0]
        else row
        for row in rows
    ]
    return written(made, "tracker.csv", head, new)


@pytest.mark.whole
def test_the_fullest_pose_has_no_displacement():
    """Its forces are known, its zeros are not: the next pose uses the load steps of another one."""
    steps = [[1000.0, 2000.0, 3000.0, 1500.0], [1200.0, 3000.0], [1200.0, 3000.0]]
    plan = Plan(
        name="few", seed=2, tool=ONE_TARGET, poses={"count": 3}, pulls={"pose_steps_n": steps}
    )
    assert verdict(lost(dict(simulate(plan).files), 1)) == "bad_data"


def test_base_reflectors_of_which_no_three_agree():
    """Which of them is wrong is undecidable: none is accused."""
    given = case(simulate(Plan(name="few", seed=3, poses={"count": 4})).files)
    rng = np.random.default_rng(1)
    base = {name: tuple(rng.uniform(-9, 9, 3).tolist()) for name in given.settings.base_frame}
    settings = given.settings.model_copy(update={"base_frame": base})
    seen, agree = agreed(register(settings, given.readings))
    assert agree.all()
    assert np.isfinite(seen.t).all()


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("layout", ["uneven", "three"])
@pytest.mark.parametrize("step", [1, 2])
def test_all_places_of_the_base_reflectors_are_off(layout, step):
    """Shifted by a row or two, no three of them agree with the nominal.

    Their names are corrected.
    """
    base = LAYOUTS[layout]
    plan = Plan(name="few", seed=3, base_frame=base, poses={"count": 4})
    made = dict(simulate(plan).files)
    text = made["campaign.toml"].decode()
    rows = [line for line in text.splitlines() if line[:1] == "B" and line[1:2].isdigit()]
    places = [row.split("=")[1] for row in rows]
    for row, place in zip(rows, places[step:] + places[:step], strict=True):
        text = text.replace(row, f"{row.split('=')[0]}={place}#", 1)
    assert verdict(made | {"campaign.toml": text.encode()}) == "bad_data"


def test_a_registration_without_gross_readings_is_told_by_the_others_alone():
    """Its sum of squares and degrees of freedom are those of a campaign that never had them."""
    made = simulate(Plan(name="few", seed=4, poses={"count": 4})).files
    given = case(made)
    rows = given.readings
    off = (rows["group"] == "base_end") & (rows["target"] == "B2")
    spoilt = rows.assign(x_m=rows["x_m"] + 2.0 * off)
    seen, agree = agreed(register(given.settings, spoilt))
    alone = register(given.settings, rows[~off])
    assert (~agree).sum() == off.sum() == 1
    assert (seen.dof, seen.from_scatter) == (alone.dof, alone.from_scatter)
    assert seen.chi2 == pytest.approx(alone.chi2, rel=1e-6)
    np.testing.assert_allclose(seen.cov, alone.cov, rtol=1e-4, atol=1e-18)
