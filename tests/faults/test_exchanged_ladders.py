"""All forces of one pose logged for another: single rows fit, all together do not."""

from dataclasses import replace

import numpy as np
import pytest
from small_case import asked, small

from pipeline.faults.exchanged_ladders import ladders
from pipeline.reduction.bring import bring

FACTORS = [1.0, 0.8, 0.92, 1.12, 0.86, 1.06, 0.96, 1.2]
STEPS = [[round(700.0 * f, 1), round(1400.0 * f, 1), round(2100.0 * f, 1)] for f in FACTORS]


def made(seed):
    """Eight poses, each pulled in three steps that are its own."""
    return small(seed, poses={"count": 8}, pulls={"pose_steps_n": STEPS})


def logged(case, source):
    """The forces of one pose logged in the rows of another, by pose numbers."""
    loads = case.loads.copy()
    for pose, other in source.items():
        theirs = case.loads.loc[case.loads["pose"] == other, "force_n"].to_numpy()
        loads.loc[loads["pose"] == pose, "force_n"] = theirs
    return replace(case, loads=loads)


@pytest.mark.parametrize(("seed", "pair"), [(3, (3, 6)), (4, (3, 7)), (5, (2, 5))])
def test_the_forces_of_two_poses_are_put_back(seed, pair):
    """Forces wrong by a tenth, which springs from other poses predict to 0.3 %."""
    given = made(seed)
    spoilt = logged(given, {pair[0]: pair[1], pair[1]: pair[0]})

    found = ladders(asked(spoilt))

    rows = given.loads[given.loads["pose"].isin(pair)]
    at = {f"{file}:{line}" for file, line in zip(rows["file"], rows["line"], strict=True)}
    assert {one.name for one in found} == {"exchanged"}
    assert {line for one in found for line in one.at} == at
    right = spoilt
    for one in found:
        right = one.correct(right)
    keys = ["pose", "repeat"]
    np.testing.assert_allclose(
        right.loads.sort_values(keys)["force_n"], given.loads.sort_values(keys)["force_n"]
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(3, 9))
def test_forces_in_their_rows_are_left_there(seed):
    """Also if readings scatter by a fifth more than stated."""
    given = made(seed)
    assert ladders(asked(given)) == []
    rng = np.random.default_rng(seed)
    rows = given.readings.copy()
    rows.loc[rows["pose"].notna(), ["x_m", "y_m", "z_m"]] += 2e-5 * rng.standard_normal(
        (int(rows["pose"].notna().sum()), 3)
    )
    assert ladders(asked(replace(given, readings=rows))) == []


def test_three_poses_in_a_ring_are_no_pair():
    """No exchange of two of them makes all pulls consistent, and nothing is reported."""
    spoilt = logged(made(3), {2: 4, 4: 8, 8: 2})

    assert ladders(asked(spoilt)) == []
    assert bring(spoilt).data.noise_stated
