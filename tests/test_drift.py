"""Base reflectors that share one rigid motion in time: the tracker drifts."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.diagnosis.drift import drift
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring, conformed, plain
from pipeline.reduction.register import XYZ, register
from pipeline.run import answered, ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

SHIFT_M = np.array([1.5e-4, -2.0e-4, 1.0e-4])
TURN = np.array([1.0, 2.0, -2.0]) / 3 * 2e-5


@cache
def files():
    """The raw files of a campaign in which nothing drifts, reflectors read first and last."""
    plan = Plan(poses={"count": 8}, pulls={"steps_n": [1500.0, 3000.0]})
    return simulate(plan, np.random.default_rng(4)).files


@cache
def case():
    """The same, as read."""
    return ingested(in_memory(files()), conformed, plain, plausible=False)


def asked(readings, unloaded=None):
    """What the base reflectors of some readings say."""
    nowhere = np.full((1, 3), np.nan)
    placed = register(case().settings, readings)
    return drift(placed, 1.0, nowhere if unloaded is None else unloaded, catalogue(case().robot))


def moved(points, part):
    """Where a tracker that turned and shifted by a part of TURN and SHIFT_M reads some points."""
    return Rotation.from_rotvec(part * TURN).apply(np.array(points)) + part * SHIFT_M


def drifted(parts):
    """The readings with each group of base reflectors moved by its part."""
    readings = case().readings.copy()
    for group, part in parts.items():
        rows = readings["group"] == group
        readings.loc[rows, XYZ] = moved(readings.loc[rows, XYZ].to_numpy(), part)
    return readings


def again(readings, group, hours, rng):
    """A further round of base readings some hours after the first, with its own scatter."""
    first = readings[readings["group"] == "base_start"]
    at = first[XYZ].to_numpy() + 3e-5 * rng.standard_normal((len(first), 3))
    more = first.assign(group=group, time=first["time"] + pd.Timedelta(hours=hours))
    more = more.assign(**dict(zip(XYZ, at.T, strict=True)))
    return pd.concat([readings, more], ignore_index=True)


def test_a_drift_is_named_with_its_size():
    """What the tracker reads of the effector moves by what a rigid motion says there."""
    readings = drifted({"base_end": 1.0})
    reduced = bring(replace(case(), readings=readings))
    found = asked(readings, reduced.data.unloaded)

    placed = reduced.registration
    amid = reduced.data.unloaded.mean(axis=0)
    read = placed.R.T @ (amid - placed.t)
    base = readings[readings["group"].str.startswith("base")].groupby("group")["time"].mean()
    true = placed.R @ (moved(read, 1.0) - read) / (base.max() - base.min()).total_seconds()
    assert found.named
    assert found.undecided
    assert found.effect.label == "tracker_drift"
    assert np.all(np.abs(found.velocity - true) < 4 * found.std)
    turned = placed.R @ TURN / (base.max() - base.min()).total_seconds()
    assert np.all(np.abs(found.turn - turned) < 4 * found.turn_std)
    assert "knocked" in found.effect.needs


def test_the_answer_names_it_and_blames_no_reflector():
    """In result.json it stands as a cause in the metrology, with its size."""
    lines = files()["tracker.csv"].decode().splitlines()
    for k, line in enumerate(lines):
        group, target, *xyz = line.split(",")
        if group == "base_end":
            x = 1e3 * moved(np.array(xyz[:3], float) / 1e3, 1.5)
            lines[k] = ",".join([group, target, *(f"{v:.4f}" for v in x), *xyz[3:]])
    said = answered("here", in_memory(files() | {"tracker.csv": "\n".join(lines).encode()})).answer

    (cause,) = said.diagnosis.causes
    assert (cause.name, cause.location) == ("tracker_drift", "metrology")
    assert said.diagnosis.verdict == "ambiguous"
    assert "knocked" in said.diagnosis.why
    assert "moved together" in said.diagnosis.why
    assert [p.name for p in cause.parameters] == ["v_x", "v_y", "v_z"]
    assert not any(spot.name == "tracker_drift" for spot in said.diagnosis.blind_spots)
    assert not any("is off by" in finding for finding in said.findings)


def test_chance_is_no_drift():
    """Forty campaigns whose base readings only scatter, as stated."""
    readings, rng = case().readings, np.random.default_rng(8)
    readings = readings[readings["pose"].isna()]
    first = readings[readings["group"] == "base_start"].set_index("target")[XYZ]
    p = []
    for _ in range(40):
        drawn = readings.copy()
        at = first.loc[drawn["target"]].to_numpy()
        drawn[XYZ] = at + 3e-5 * rng.standard_normal(at.shape)
        found = asked(drawn)
        assert not found.named
        p.append(found.p_value)
    assert np.mean(np.array(p) > 0.99) < 0.9  # it looks at the readings


def test_one_reading_off_is_no_drift():
    """A reflector of the last round is 0.5 mm off: the drift beside it is not accepted."""
    readings = drifted({"base_end": 6.0})
    row = readings.index[readings["group"] == "base_end"][0]
    assert asked(readings).named
    readings.loc[row, XYZ] = readings.loc[row, XYZ].to_numpy(float) + np.array([3e-4, 3e-4, -3e-4])

    off = asked(readings)
    assert not off.named
    assert off.visible == np.inf


def test_a_third_round_tells_a_drift_from_a_knock():
    """Half way at half time is a drift; nothing until then and all of it afterwards is none."""
    hours = asked(case().readings).hours
    rounds = again(case().readings, "base_mid", hours / 2, np.random.default_rng(3))
    base = {"base_mid": 3.0, "base_end": 6.0}

    def told(parts):
        readings = rounds.copy()
        for group, part in parts.items():
            rows = readings["group"] == group
            readings.loc[rows, XYZ] = moved(readings.loc[rows, XYZ].to_numpy(), part)
        return asked(readings)

    steady = told(base)
    assert steady.named
    assert not steady.undecided
    assert "knocked" not in steady.effect.needs
    assert not told({"base_end": 6.0}).named


def test_without_times_nobody_can_tell():
    """The same readings from an export that has no times."""
    assert asked(drifted({"base_end": 3.0}).assign(time=pd.NaT)) is None
