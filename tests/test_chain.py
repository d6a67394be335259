"""The two reflectors on the chain: which reading is bad, and which chain is only a chain."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from pipeline.faults.chain import chain_outlier
from pipeline.reduction.bring import conformed, plain
from pipeline.reduction.register import XYZ
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

SIGMA_M = 3e-5
STEPS = (1000.0, 1600.0, 2300.0, 3000.0)


@cache
def case():
    """A campaign, for all but what is read on the chain."""
    plan = Plan(poses={"count": 8}, pulls={"steps_n": [1500.0, 3000.0]})
    files = simulate(plan, np.random.default_rng(4)).files
    return ingested(in_memory(files), conformed, plain, plausible=False)


def read(rng, poses=10, steps=STEPS, sag_n=0.0, stretch_m=0.0, hung_m=0.0, back_m=0.0):
    """A campaign of chains in a room: anchor, load point that gives way, links between them.

    Args:
        rng: Draws the room and the scatter.
        poses: Number of poses.
        steps: Force of each pull [N].
        sag_n: Weight of the chain; it droops by a quarter of that over the force.
        stretch_m: How much nearer its ends stand under no force than under 3 kN.
        hung_m: How much the distance differs from pose to pose, standard deviation.
        back_m: How much less the load point gives way in the last pull of a pose.
    """
    rows, loads = [], []
    hung = 0.6 + hung_m * rng.standard_normal(poses)
    for pose in range(poses):
        load = rng.uniform([6.0, -2, -2], [10.0, 2, 2])
        anchor = load + rng.uniform(1.5, 6) * _unit(rng.standard_normal(3))
        give = rng.uniform(1e-3, 5e-3) * rng.standard_normal(3)
        for k, force in enumerate(steps):
            late = back_m * (k == len(steps) - 1) * _unit(give)
            at = load + give * force / 3000 - late
            u = _unit(anchor - at)
            droop = sag_n / (4 * force) * np.cross(u, [0.6, 0.8, 0.0])
            length = hung[pose] + stretch_m * force / 3000
            ends = np.array([at + 0.15 * (u + droop), at + (0.15 + length) * _unit(u + droop)])
            ends += SIGMA_M * rng.standard_normal((2, 3))
            group = f"pose{pose + 1:02d}_rep{k + 1}_loaded"
            loads.append((pose + 1, k + 1, force + 2 * rng.standard_normal()))
            for name, end in zip(("Pl1", "Pl2"), ends, strict=True):
                rows.append((group, name, pose + 1, k + 1, "loaded", *end))
    readings = pd.DataFrame(rows, columns=["group", "target", "pose", "repeat", "state", *XYZ])
    for name in (c for c in case().readings.columns if c not in readings):
        readings[name] = SIGMA_M**2 if name in ("cxx_m2", "cyy_m2", "czz_m2") else 0.0
    return replace(
        case(),
        readings=readings,
        loads=pd.DataFrame(loads, columns=["pose", "repeat", "force_n"]),
    )


def _unit(v):
    return v / np.linalg.norm(v)


def spoiled(given, group, target, off):
    """The same with one reading off by a vector [m]."""
    readings = given.readings.copy()
    row = (readings["group"] == group) & (readings["target"] == target)
    readings.loc[row, XYZ] = readings.loc[row, XYZ].to_numpy(float) + off
    return replace(given, readings=readings)


CHAINS = [
    {},
    {"sag_n": 60.0},
    {"stretch_m": 4e-4},
    {"hung_m": 5e-2},
    {"hung_m": 5e-2, "stretch_m": 4e-4, "back_m": 5e-4},
    {"steps": (1500.0, 3000.0), "hung_m": 5e-2},
    {"steps": (3000.0,), "poses": 30},
    {"back_m": 5e-4, "sag_n": 30.0},
]


@pytest.mark.parametrize("chain", CHAINS)
def test_a_good_chain_is_not_accused(chain):
    """Chains sag, stretch, are hung otherwise in every pose, and load points come back late."""
    for seed in range(12):
        assert not chain_outlier(read(np.random.default_rng([seed, 9]), **chain))


@pytest.mark.parametrize("end", ["Pl1", "Pl2"])
@pytest.mark.parametrize("chain", [{}, {"hung_m": 5e-2, "stretch_m": 4e-4}])
@pytest.mark.parametrize("along", [0.0, 1.0])
def test_a_bad_reading_of_the_chain_is_named(end, chain, along):
    """One end is 1 mm off, along the chain or across it."""
    given = read(np.random.default_rng(5), **chain)
    rows = given.readings.set_index(["group", "target"])[XYZ]
    at = [rows.loc[("pose04_rep2_loaded", name)].to_numpy(float) for name in ("Pl1", "Pl2")]
    u = _unit(at[1] - at[0])
    across = _unit(np.cross(u, [0.1, 0.2, 0.9]))

    found = chain_outlier(
        spoiled(given, "pose04_rep2_loaded", end, 1e-3 * (u if along else across))
    )

    assert [f.where for f in found] == [f"pose04_rep2_loaded/{end}"]
    assert found[0].size == pytest.approx(1e-3, rel=0.25)
    assert found[0].p_value < 1e-3


def test_two_pulls_of_a_pose_tell_it_by_all_others():
    """With two pulls in a pose the distance tells which pull it is, but not which end."""
    given = read(np.random.default_rng(6), steps=(1500.0, 3000.0))
    rows = given.readings.set_index(["group", "target"])[XYZ]
    at = [rows.loc[("pose03_rep1_loaded", name)].to_numpy(float) for name in ("Pl1", "Pl2")]

    found = chain_outlier(spoiled(given, "pose03_rep1_loaded", "Pl2", 8e-4 * _unit(at[1] - at[0])))

    assert [f.where for f in found] == ["pose03_rep1_loaded/Pl1-Pl2"]
