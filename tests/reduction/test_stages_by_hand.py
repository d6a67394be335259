"""Stages from files to arrays, each number by its own arithmetic."""

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError
from scipy import stats

from pipeline.base import covariance
from pipeline.base.errors import InputError
from pipeline.machine.effect import HUNG, MOUNTED, PULLED, Pulls
from pipeline.machine.effects import joint_hardening, scale, table, tracker_drift
from pipeline.machine.instrument import InstrumentNoise
from pipeline.machine.robot import load
from pipeline.readers._log_table import Log
from pipeline.readers.pose_names import coded
from pipeline.reduction import (
    course,
    digits,
    expected,
    forces,
    ingest,
    measured,
    register,
    settings,
)
from pipeline.reduction._index import found, means, numbered, places, pull_number, run
from pipeline.reduction.idle import Idle
from pipeline.reduction.settings import AskedPose, Scale, Settings

RAIL = load("kr500_rail")
G = 9.80665


# --- digits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("readings", "poses", "h"),
    [
        ([100, 105, 110, 120, 135, 140], 1, 5.0),
        ([100, 105, 110, 120, 135], 1, 0.0),  # five different readings establish nothing
        ([100, 200, 300, 400, 500, 600], 1, 0.0),  # six steps that were aimed at
        ([0, 102, 104, 108, 110, 130, 200], 1, 2.0),
        (np.array([20, 21, 22, 24, 27, 31]) * G, 1, G),
        (np.array([20.5, 21, 22, 24, 27, 31]) * G, 1, 0.5 * G),
        ([1.0, 2.0, 3.0, 4.0, 5.0, np.nan, 100_001.0], 1, 0.0),
        ([100.0003, 105, 110, 120, 135, 140], 1, 5.0),
        ([100.006, 105, 110, 120, 135, 140], 1, 0.002),
    ],
)  # fmt: skip
def test_the_division_of_a_scale_is_the_widest_that_fits_all(readings, poses, h):
    """Of six different readings, at least twenty divisions; 1, 2 or 5 times a power of ten."""
    x = np.array(readings, float)
    assert digits.division(x, np.ones(len(x))) == pytest.approx(h)


def test_more_readings_than_load_steps_need_no_twenty_divisions():
    """Six poses with a reading each: no ladder has so many steps."""
    x = np.array([100.0, 200, 300, 400, 500, 600])
    assert digits.division(x, np.arange(6)) == 100.0
    assert digits.division(x, np.repeat([1, 2], 3)) == 0.0
    assert digits.division(np.zeros(9), np.arange(9)) == 0.0


@pytest.mark.parametrize(
    ("step", "h"), [(1e-3, 1e-3), (1e-5, 1e-5), (0.0254e-3, 0.0254e-3), (1.0, 1.0)]
)
def test_rounding_is_that_of_the_last_digit(step, h):
    """Uniform within it, in metres, millimetres or inches."""
    x = step * np.array([[1234.0, -777, 31], [5, 9, 11]])
    assert digits.rounding(x) == pytest.approx(h / np.sqrt(12))
    assert digits.rounding(np.zeros((0, 3))) == 0.0
    assert digits.rounding(np.pi * np.array([[1.0, 2, 3]])) == 0.0
    late = np.vstack([np.ones((300, 3)), np.full((1, 3), np.pi)])
    assert digits.rounding(late) == pytest.approx(1 / np.sqrt(12))


# --- tables as numbers ----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_rows_are_found_and_numbered_as_by_dictionaries(seed):
    """Sorted or not, in runs or single, empty or equal."""
    rng = np.random.default_rng(seed)
    for known, wanted in (
        (rng.integers(0, 9, 12), rng.integers(0, 12, 20)),
        (np.sort(rng.integers(0, 9, 12)), np.repeat(rng.integers(0, 12, 3), 7)),
        (np.arange(5), np.arange(5)),
        (np.zeros(0, int), rng.integers(0, 3, 4)),
        (np.array([1, 1, 2]), np.array([1, 1, 2])),
    ):
        last = {int(key): k for k, key in enumerate(known)}
        assert found(known, wanted).tolist() == [last.get(int(w), -1) for w in wanted]
        different, index = numbered(wanted)
        assert different.tolist() == sorted({*wanted.tolist()})
        assert different[index].tolist() == wanted.tolist()
    values, group = rng.normal(size=9), rng.integers(0, 3, 9)
    values[2] = np.nan
    told = means(values, group, 5)
    for k in range(5):
        mine = values[(group == k) & np.isfinite(values)]
        assert told[k] == pytest.approx(mine.mean() if len(mine) else np.nan, nan_ok=True)
    assert run(np.array([3, 4, 5])) == slice(3, 6)
    assert run(np.array([3, 5])).tolist() == [3, 5]
    assert run(np.array([], int)).tolist() == []
    assert pull_number(np.array([2, 1]), np.array([0, 9])).tolist() == [2 * 2**31, 2**31 + 9]
    words = pd.Series(["b", None, "a", "x"])
    for column in (words, words.astype("category")):
        assert places(column, ["a", "b"]).tolist() == [1, -1, 0, -1]


# --- the base frame from round to round -----------------------------------------------------------

BASE = np.array([[0.0, 0, 0], [6.0, 0, 0.5], [0, 2.0, 0], [6.0, 2.0, 0], [3.0, 1.0, 1.5]])
STD = 2e-5


def rounds(growth=(0.0, 3e-5, 8e-5), turn=0.0, off=None, along=None, noise=1.0):
    """Table REGISTRATION of five reflectors in three rounds that lie 1000 s apart."""
    rng = np.random.default_rng(17)
    lever = BASE - BASE.mean(axis=0)
    rows = []
    for r, g in enumerate(growth):
        strain = g * (np.eye(3) if along is None else np.outer(along, along))
        moved = lever @ strain + np.cross([0, 0, turn * r], lever) + r * np.array([1e-4, 0, 2e-4])
        for t in range(5):
            extra = off[2] if off and off[:2] == (r, t) else 0.0
            dx = moved[t] + [extra, 0, 0] + noise * STD * rng.normal(size=3)
            rows.append((f"G{r}", f"B{t}", 1000.0 * r + t, *dx, *(BASE[t] + dx)))
    table = pd.DataFrame(rows, columns=["group", "target", "time_s", "dx_m", "dy_m", "dz_m",
                                        "x_m", "y_m", "z_m"])  # fmt: skip
    six = dict(zip(covariance.columns(), (STD**2, 0, 0, STD**2, 0, STD**2), strict=True))
    return table.assign(**six)


def test_growth_is_that_of_a_dense_regression():
    """Free places, a shift and a strain of each later round, by least squares of numpy."""
    table = rounds()
    told = course.course(table, np.eye(3))
    lever = BASE - BASE.mean(axis=0)
    X, y = np.zeros((45, 15 + 8)), table[["dx_m", "dy_m", "dz_m"]].to_numpy().ravel()
    for k in range(15):
        r, t = divmod(k, 5)
        X[3 * k : 3 * k + 3, 3 * t : 3 * t + 3] = np.eye(3)
        if r:
            at = 15 + 4 * (r - 1)
            X[3 * k : 3 * k + 3, at : at + 3] = np.eye(3)
            X[3 * k : 3 * k + 3, at + 3] = lever[t]
    x = np.linalg.lstsq(X, y, rcond=None)[0]
    C = STD**2 * np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(told.growth, [0, x[18], x[22]], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(told.std, np.sqrt([0, C[18, 18], C[22, 22]]), rtol=1e-6)
    np.testing.assert_allclose(told.shift, [[0, 0, 0], x[15:18], x[19:22]], atol=1e-10)
    np.testing.assert_allclose(told.gradient, told.growth[:, None, None] * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(told.centre, BASE.mean(axis=0))
    assert (told.groups, told.unknowns) == (("G0", "G1", "G2"), 8)
    np.testing.assert_allclose(told.begun, [2.0, 1002.0, 2002.0])
    left, bare = y - X @ x, np.delete(X, [18, 22], axis=1)
    more = y - bare @ np.linalg.lstsq(bare, y, rcond=None)[0]
    drop = (more @ more - left @ left) / STD**2
    assert told.p_value == pytest.approx(stats.chi2.sf(drop, 2), rel=1e-5)
    rail = np.linalg.svd(lever)[2][0]
    assert told.length_m == pytest.approx(np.ptp(lever @ rail))
    spread = 0.0
    for at in (15, 19):
        block = C[at : at + 4, at : at + 4]
        for t in range(5):
            ways = np.column_stack([np.eye(3), lever[t]])
            spread += np.trace(ways @ block @ ways.T)
    assert told.std_m == pytest.approx(np.sqrt(spread / (3 * 2 * 5)), rel=1e-6)


def test_a_rail_grows_along_itself_and_a_tracker_may_turn_beside():
    """The better of both strains; turns where shifts leave more than chance."""
    lever = BASE - BASE.mean(axis=0)
    rail = np.linalg.svd(lever)[2][0]
    told = course.course(rounds(along=rail), np.eye(3))
    np.testing.assert_allclose(
        told.gradient, told.growth[:, None, None] * np.outer(rail, rail), atol=1e-12
    )
    assert told.growth[2] == pytest.approx(8e-5, abs=5 * told.std[2])
    turned = course.course(rounds(turn=3e-4), np.eye(3))
    assert turned.unknowns == 14
    skew = (turned.gradient[2] - turned.gradient[2].T) / 2
    assert skew[1, 0] == pytest.approx(6e-4, abs=5e-5)
    assert turned.growth[2] == pytest.approx(8e-5, abs=5 * turned.std[2])


@pytest.mark.parametrize(
    "table",
    [
        rounds(growth=(0.0, 0.0, 0.0)),
        rounds(growth=(0.0, 0.0, 0.0), turn=3e-4),
        rounds(growth=(0.0, 0.0, 0.0), off=(1, 3, 2e-3)),
        rounds(growth=(0.0,)),
        rounds().assign(time_s=np.nan),
    ],
    ids=["nothing", "a turn", "one reflector", "one round", "no time"],
)
def test_no_growth_is_seen_where_something_else_explains_the_rounds(table):
    """Chance, a motion of the tracker, one reflector; nor of one round, nor without times."""
    assert course.course(table, np.eye(3)) is None


def test_growth_is_seen_by_the_scatter_where_no_noise_is_stated():
    """Its variance is what the strain leaves."""
    table = rounds(noise=1.0).assign(**dict.fromkeys(covariance.columns(), np.nan))
    told = course.course(table, np.eye(3))
    known = course.course(rounds(noise=1.0), np.eye(3))
    assert told.growth[2] == pytest.approx(8e-5, abs=6 * known.std[2])
    assert told.std[2] == pytest.approx(known.std[2], rel=0.5)
    still = rounds(growth=(0, 0, 0)).assign(**dict.fromkeys(covariance.columns(), np.nan))
    assert course.course(still, np.eye(3)) is None


# --- what a log says ------------------------------------------------------------------------------


def log(file="l.csv", word=None, **number):
    """A log with these columns, lines from 2."""
    columns = {name: np.array(values, float) for name, values in number.items()}
    size = len(next(iter(number.values())))
    words = {name: np.array(values, object) for name, values in (word or {}).items()}
    return Log(file, columns, words, 2 + np.arange(size), ())


def test_forces_are_readings_less_the_zero_over_the_gain():
    """Without a force above nothing a row is left out; a payload has to be known."""
    of = log(force=[110.0, 8.0, np.nan, 210.0], word={"payload": ["", "", "gun", "box"]})
    stated = Scale(zero_n=10.0, gain=2.0)
    told = ingest._known_loads(
        Some(scale=stated, loads_log=stated, payload={"gun": 1}, loads_file="l.csv"), of
    )
    assert told.line.tolist() == [2, 4]
    np.testing.assert_allclose(told.number["force"], [50.0, np.nan])
    reasons = dict(one[1:] for one in told.rejected)
    assert reasons[3].startswith("the force is not above what [scale] zero_n says")
    assert "there is gun" in reasons[5]
    bare = Some(scale=None, loads_log=Scale(), payload={"gun": 1, "box": 1}, loads_file="l.csv")
    with pytest.raises(InputError, match="there are 3 readings of a scale") as wrong:
        ingest._known_loads(bare, of)
    assert wrong.value.line == 2
    hung = log(force=[np.nan, np.nan], word={"payload": ["gun", ""]})
    assert len(ingest._known_loads(bare, hung).line) == 2


def test_weights_without_an_uncertainty_have_the_one_of_all():
    """Chains have none."""
    of = log(
        pose=[1, 2, 3], repeat=[1, 1, 1], force=[5.0, np.nan, np.nan], unit=[1.0] * 3,
        mass=[np.nan, 20.0, 30.0], mass_sigma=[np.nan, np.nan, 0.5],
        word={"payload": ["", "", "gun"]},
    )  # fmt: skip
    table = ingest._loads(of, 0.25).to_pydict()
    assert table["mass_sigma_kg"] == [0.0, 0.25, 0.5]
    assert table["payload"] == [None, None, "gun"]
    assert table["branch"] == [None] * 3
    assert (table["line"], table["file"]) == ([2, 3, 4], ["l.csv"] * 3)
    q = {f"q{k}": [0.1 * k, 0.2] for k in range(7)}
    names = {joint.name: values for joint, values in zip(RAIL.joints, q.values(), strict=True)}
    joints = ingest._joints(log(pose=[4, 5], approach=[np.nan, -1.0], **names), RAIL).to_pydict()
    assert (joints["pose"], joints["approach"]) == ([4, 5], [0.0, -1.0])
    bare = ingest._joints(log(pose=[4, 5], **names), RAIL).to_pydict()
    assert bare["approach"] == [0.0, 0.0]


def test_torques_are_those_of_the_log_by_joint():
    """Unknown where it has none; none of a log without any."""
    told = ingest._torques(log(pose=[4, 5], tau2=[1.0, 2.0], repeat=[1, 1]), RAIL)
    assert list(told.columns) == ["pose", "repeat", *(f"tau{k}" for k in range(1, 8))]
    assert told["tau2"].tolist() == [1.0, 2.0]
    assert told["tau7"].isna().all()
    assert told["pose"].tolist() == [4, 5]
    assert ingest._torques(log(pose=[4], tau8=[1.0]), RAIL) is None


def test_joints_of_the_test_pose_are_recognised_as_a_pendant_shows_them():
    """To a hundredth of a millimetre and of a degree."""
    q = np.array([3.0, *np.deg2rad([10.0, -80, 70, 20, 30, 40])])
    asked = AskedPose(q=[3.0, 10, -80, 70, 20, 30, 40], force_n=(0, 0, 1.0))
    off = np.zeros((5, 7))
    off[1, 0], off[2, 0], off[3, 4], off[4, 4] = 0.9e-5, 1.1e-5, 0.9e-4, 1.1e-4
    columns = {joint.name: q[k] + off[:, k] for k, joint in enumerate(RAIL.joints)}
    rows = log(pose=np.arange(5), **columns)
    told = ingest._is_test_pose(Some(test_pose=asked), RAIL, rows)
    assert told.tolist() == [True, True, False, True, False]
    assert not ingest._is_test_pose(Some(test_pose=None), RAIL, rows).any()


def test_poses_with_letters_are_numbered_and_stand_where_the_first_did():
    """Joint values of 4 hold for 4bis, unless it has its own, or either is left out."""
    again, other = coded("4bis"), coded("5bis")
    own = {again: 101, other: 102}
    rows = log(pose=[4, 5, 102], repeat=[7, 8, 9])
    told, why = ingest._stood_again(rows, {}, own)
    assert told.number["pose"].tolist() == [4, 5, 102, 101]
    assert told.number["repeat"].tolist() == [7, 8, 9, 7]
    assert told.line.tolist() == [2, 3, 4, 2]
    assert why == {}
    told, why = ingest._stood_again(log(pose=[5, 102], repeat=[8, 9]), {4: "far"}, own)
    assert why == {4: "far", 101: "far"}
    assert told.number["pose"].tolist() == [5, 102]
    renamed = ingest._with_own_numbers(
        replace(log(pose=[4, again], repeat=[1, 1]), pose_of={9: float(other), 8: np.nan, 7: 3.0}),
        own,
    )
    assert renamed.number["pose"].tolist() == [4, 101]
    assert renamed.pose_of == {9: 102, 7: 3.0}
    left = ingest._leaving(rows, {5: "far"})
    assert left.line.tolist() == [2, 4]
    assert left.rejected == (("l.csv", 3, "far"),)


def test_rejected_rows_are_listed_once_in_order():
    """By file and line; the most frequent way out is that of the error."""
    rows = [("b", 3, "x; do y"), ("a", None, "w; do z"), ("b", 2, "v; do y"), ("b", 3, "x; do y")]
    table = ingest._rejected(rows).to_pydict()
    assert table["file"] == ["a", "b", "b"]
    assert table["line"] == [None, 2, 3]
    assert table["reason"] == ["w; do z", "v; do y", "x; do y"]
    assert len(ingest._rejected([])) == 0
    error = ingest._nothing_left([rows[1], *rows[2:]])
    assert "because 2 rows are like this one: v" in str(error)
    assert (error.file, error.line, error.way_out) == ("b", 2, "do y")
    assert "out of [set_aside]" in str(ingest._nothing_left([]))


class Shots(Some):
    """Readings, as many as positions."""

    def __len__(self):
        """Their number."""
        return len(self.position)


IRRATIONAL = np.sqrt([[2.0, 3, 5], [7, 11, 13], [17, 19, 23]])


def stated(sigma_m=None, noise=None, sheet=None):
    """Settings with a noise of readings."""
    return Some(reading_noise=noise, sheet=sheet, tracker=Some(sigma_m=sigma_m))


def test_the_noise_of_a_reading_is_its_own_or_the_stated_one():
    """Of the file before campaign.toml; beside it that of the last digit, where this counts."""
    six = np.full((3, 6), np.nan)
    six[1] = [1e-10, 1e-11, 0, 2e-10, 0, 3e-10]
    own = Shots(position=IRRATIONAL, covariance=six)
    columns, source = ingest._covariance(own, stated(sigma_m=2e-5))
    assert source.to_pylist() == ["stated", "file", "stated"]
    told = np.array(columns).T
    np.testing.assert_allclose(told[1], six[1])
    np.testing.assert_allclose(told[0], [4e-10, 0, 0, 4e-10, 0, 4e-10])
    bare = Shots(position=IRRATIONAL, covariance=None)
    columns, source = ingest._covariance(bare, stated())
    assert np.isnan(columns).all()
    assert set(source.to_pylist()) == {"none"}
    for sheet, name in ((None, "instrument"), ("leaflet", "sheet")):
        noise = InstrumentNoise(range_m=1e-5, transverse_m=2e-5)
        columns, source = ingest._covariance(bare, stated(noise=noise, sheet=sheet))
        assert set(source.to_pylist()) == {name}
        C = covariance.symmetric(np.array(columns).T)[0]
        at = IRRATIONAL[0] / np.linalg.norm(IRRATIONAL[0])
        assert at @ C @ at == pytest.approx(1e-10)
        assert np.trace(C) == pytest.approx(9e-10)
    columns, source = ingest._covariance(bare, stated(noise="paper"))
    assert set(source.to_pylist()) == {"paper"}
    np.testing.assert_allclose(
        [c[0] for c in columns], 9e-10 * np.array([0.25, 0, 0, 0.25, 0, 0.5])
    )
    coarse = Shots(position=1 + 0.0123 * np.arange(9.0).reshape(3, 3), covariance=None)
    for sigma, more in ((2e-5, 1e-8 / 12), (1e-3, 0.0)):
        columns, _ = ingest._covariance(coarse, stated(sigma_m=sigma))
        np.testing.assert_allclose(columns[0], sigma**2 + more)
        np.testing.assert_allclose(columns[1], 0.0)


# --- settings -------------------------------------------------------------------------------------

MINIMAL = {
    "format": 1,
    "name": "cell",
    "robot": "kr500_rail",
    "tracker": {"files": ["t.csv"]},
    "scale": {"sigma_n": 2.0},
    "tool": {"load_point": (0.0, 0, 0.3), "P1": (0.2, 0, 0.1), "P2": (0, 0.2, 0.1),
             "P3": (0, 0, 0.4)},
}  # fmt: skip


def of(**more):
    """A campaign.toml with other tables."""
    return Settings.model_validate(MINIMAL | more)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"tracker": None}, "needs the tables"),
        ({"displacements": {}}, "has \\[displacements\\] beside"),
        ({"tracker": None, "scale": None, "displacements": {}, "set_aside": {"g": "x"}},
         "has \\[set_aside\\] without"),
        ({"tracker": None, "positions": {}}, "has \\[scale\\] beside"),
        ({"tolerance": {"deflection_mm": 1.0}}, "no place to apply it"),
        ({"base_frame": {"P1": (1, 2, 3)}}, '"P1" is in naming.measured and in \\[base_frame\\]'),
        ({"naming": {"measured": ["P1", "P1", "P2"]}}, "has P1 twice"),
        ({"tool": MINIMAL["tool"] | {"P3": (0, 0.2, 0.1)}}, "has P2, P3 in one place"),
        ({"tool": MINIMAL["tool"] | {"P3": (0.1, 0.1, 0.1)}, "instrument": {"measures": "poses"}},
         "not on one line"),
        ({"tracker": {"files": ["t.csv"], "sigma_m": 1e-5, "noise": "paper"}}, "are both given"),
        ({"tracker": {"files": [f"{k}*.csv" for k in range(21)]}}, "more than 20 patterns"),
        ({"naming": {"states": {"Up": "loaded", "up": "unloaded"}}}, "for unloaded and for loaded"),
        ({"test_pose": {"force_n": (0, 0, 1)}}, "needs either axes"),
        ({"test_pose": {"q": [1], "axes": [1], "force_n": (0, 0, 1)}}, "not both"),
        ({"test_pose": {"q": [1], "force_n": (0, 0, 0)}}, "greater than zero"),
    ],
)  # fmt: skip
def test_contradictions_in_campaign_toml_are_refused(more, said):
    """Each in a sentence."""
    with pytest.raises(ValidationError, match=said):
        of(**more)


def test_what_is_left_out_of_campaign_toml_has_its_default():
    """A campaign that is whole is accepted, with or without a scale, beside positions."""
    assert of().measured == ["P1", "P2", "P3"]
    assert of().loads_file == "loads.csv"
    assert of(scale=None).loads_log == Scale()
    assert not of(positions={}).of_positions
    alone = {"tracker": None, "scale": None, "tool": {}}
    assert of(**alone, positions={}).of_positions
    with pytest.raises(ValidationError, match="has no forces"):
        of(**alone, positions={}, tolerance={"deflection_mm": 1.0, "path": "p.csv"})
    assert len(of(tracker={"files": [f"{k}*.csv" for k in range(20)]}).tracker.files) == 20
    reduced = {"tracker": None, "scale": None, "displacements": {}}
    tool = {"load_point": (0, 0, 1), "A": (1, 0, 0), "B": (0, 1, 0)}
    assert of(**reduced | {"tool": tool}).measured == ["A", "B"]
    named = of(**reduced | {"tool": tool, "naming": {"measured": ["B"]}})
    assert named.measured == ["B"]
    frame = {"B1": (0, 0, 0), "B2": (2, 0, 0)}
    assert [one.table for one in of(base_frame=frame).bodies] == ["[tool]", "[base_frame]"]
    assert len(of().bodies) == 1
    assert len(of(base_frame={"B1": (0, 0, 0)}).bodies) == 1


@pytest.mark.parametrize(
    ("frame", "sigma", "std"),
    [
        ({"A": (1.23456, 2.34567, 0.0), "B": (1.5, 2.1, 7.12345)}, None, 1e-5 / np.sqrt(12)),
        ({"A": (1.2345, 2.3456, 3.4567)}, None, 1e-4 / np.sqrt(12)),
        ({"A": (1.234, 2.345, 3.456)}, None, 0.0),
        ({"A": (1.234, 2.345, 3.456)}, 2e-4, 2e-4),
        ({}, None, 0.0),
    ],
)
def test_a_base_frame_is_as_certain_as_its_last_digit(frame, sigma, std):
    """The median of its digits, if finer than a millimetre; or as stated."""
    told = of(base_frame=frame, base_frame_uncertainty={"sigma_m": sigma})
    assert told.base_std == pytest.approx(std)


@pytest.mark.parametrize(
    ("places", "tells"),
    [
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], True), ([(0, 0, 0), (1, 0, 0)], False),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0)], False), ([(0, 0, 0), (1, 0, 0), (2, 4e-3, 0)], True),
        ([(0, 0, 0), (1, 0, 0), (2, 1e-3, 0)], False),
    ],
)  # fmt: skip
def test_three_targets_beside_a_line_tell_a_pose(places, tells):
    """Two, or three on one line, leave its turn open."""
    assert settings.tells_a_pose(np.array(places, float)) == tells


def test_a_test_pose_is_checked_against_the_robot():
    """Its number of joints and their limits, in the units in which it was written."""
    q = [3.0, 10, 80, 70, 20, 30, 40]
    fine = AskedPose(q=q, force_n=(0, 0, 1.0))
    np.testing.assert_allclose(fine.joint_values(RAIL), [3.0, *np.deg2rad(q[1:])])
    fine.within_limits(RAIL)
    axes = AskedPose(axes=[3000.0, *q[1:]], force_n=(0, 0, 1.0))
    np.testing.assert_allclose(
        axes.joint_values(RAIL), RAIL.from_controller(np.array([3000.0, *q[1:]]))
    )
    assert (fine.key, axes.key) == ("q", "axes")
    with pytest.raises(InputError, match=r"test_pose.q has 2 values, the robot 7 joints"):
        AskedPose(q=[1, 2], force_n=(0, 0, 1.0)).joint_values(RAIL)
    with pytest.raises(InputError, match=r"test_pose.axes has 2 values, the robot 7 axes"):
        AskedPose(axes=[1, 2], force_n=(0, 0, 1.0)).joint_values(RAIL)
    far = AskedPose(q=[30.0, *q[1:]], force_n=(0, 0, 1.0))
    name, upper = RAIL.joints[0].name, RAIL.upper[0]
    with pytest.raises(InputError, match=rf"{name} = 30 m, outside its limits .* to {upper:g} m"):
        far.within_limits(RAIL)
    turned = AskedPose(q=[3.0, 10, 80, 70, 20, 300, 40], force_n=(0, 0, 1.0))
    with pytest.raises(InputError, match=f"{RAIL.joints[5].name} = 300 deg"):
        turned.within_limits(RAIL)


def test_a_data_sheet_counts_where_no_noise_is_stated():
    """Of a tracker that measures points, relative to itself, whose place a base frame gives."""
    frame = {"base_frame": {f"B{k}": (k, k * k, 0.0) for k in range(3)}}
    model = {"instrument": {"model": "Leica AT402"}}
    assert of(**frame, **model).sheet is not None
    assert of(**frame, **model).reading_noise.range_m == pytest.approx(10e-6 / np.sqrt(3))
    for less in (
        {**model}, {**frame}, {**frame, "instrument": model["instrument"] | {"kind": "arm"}},
        {**frame, **model, "tracker": {"files": ["t.csv"], "sigma_m": 1e-5}},
        {**frame, **model, "tracker": {"files": ["t.csv"], "noise": "paper"}},
    ):  # fmt: skip
        assert of(**less).sheet is None
    paper = of(tracker={"files": ["t.csv"], "noise": "paper"})
    assert paper.reading_noise == "paper"


# --- arrays ---------------------------------------------------------------------------------------


def test_zeros_are_numbered_and_timed_pose_by_pose():
    """One per target and pose; all targets of a round share its time."""
    rows = pd.DataFrame({"pose": [4, 4, 4, 7], "target": ["P2", "P1", "P2", "P1"]})
    assert measured._zeros(rows).tolist() == [1, 0, 1, 2]
    placed = pd.DataFrame(
        {"state": ["unloaded"] * 5 + ["loaded"], "pose": [4, 4, 4, 9, 9, 4],
         "group": ["a", "a", "b", "c", "c", "x"],
         "time_s": [1.0, 3.0, 10.0, 20.0, np.nan, 99.0]}
    )  # fmt: skip
    times = measured._zero_times(placed, np.array([9, 4, 5]))
    np.testing.assert_array_equal(times, [[20.0, np.nan], [2.0, 10.0], [np.nan, np.nan]])
    assert np.isnan(measured._zero_times(None, np.array([1, 2]))).all()
    assert measured._zero_times(None, np.array([1, 2])).shape == (2, 1)


def test_pulls_are_those_of_the_tables():
    """Names of payloads; the fraction of zeros that were read later."""
    table = pd.DataFrame(
        {"pose": [4, 5, 6], "repeat": [1, 2, 1], "by": [MOUNTED, PULLED, HUNG],
         "body": [1, -1, 2], "time_s": [5.0, 6.0, np.nan], "branch": [1, -1, 0],
         "approach": [1, 0, -1], **{f"f{a}_n": [1.0, 2.0, 3.0] for a in "xyz"},
         **{f"at_{a}_m": [0.1, np.nan, np.nan] for a in "xyz"}}
    )  # fmt: skip
    columns = {f"{j.name}_{'m' if j.prismatic else 'rad'}": [0.1, 0.2, 0.3] for j in RAIL.joints}
    zero_times = np.array([[1.0, 9.0, 10.0], [1.0, 2.0, np.nan], [1.0, 2.0, 3.0]])
    told = measured._pulls(
        Some(payload={"box": 1, "gun": 1}),
        RAIL,
        table.assign(**columns),
        np.arange(3.0),
        zero_times,
    )
    assert told.body.tolist() == ["gun", "", ""]
    np.testing.assert_allclose(told.zeros_after, [2 / 3, 0.0, 0.0])
    assert told.branch.tolist() == [1, -1, 0]
    assert told.approach.tolist() == [1, 0, -1]
    assert told.time_zero.tolist() == [0, 1, 2]
    assert told.force.tolist() == [[1.0] * 3, [2.0] * 3, [3.0] * 3]
    assert told.q[1].tolist() == [0.2] * 7


def test_covariances_are_stated_or_those_of_a_mean():
    """Relative where any is unknown: one for a reading, one over their number for a zero."""
    names = [*covariance.columns("loaded_c"), *covariance.columns("zero_c")]
    six = [1.0, 0.1, 0.2, 2.0, 0.3, 3.0]
    rows = pd.DataFrame([six + [2 * x for x in six]] * 2, columns=names)
    loaded, zero, known = measured._covariances(rows.assign(zero_count=[2, 0]))
    assert known
    np.testing.assert_allclose(loaded[0], [[1, 0.1, 0.2], [0.1, 2, 0.3], [0.2, 0.3, 3]])
    np.testing.assert_allclose(zero, 2 * loaded)
    rows.loc[:, names] = np.nan
    loaded, zero, known = measured._covariances(rows.assign(zero_count=[2, 0]))
    assert not known
    np.testing.assert_allclose(loaded, [np.eye(3)] * 2)
    np.testing.assert_allclose(zero, [np.eye(3) / 2, np.zeros((3, 3))])


def test_positions_without_a_pull_are_scaled_and_joined_to_poses():
    """Rotations by themselves; only poses with all targets are one."""
    pulls = Pulls.at(np.zeros((5, 7)), np.zeros((5, 3)))
    pulls = replace(pulls, pose=np.array([4, 4, 7, 9, 9]))
    cov = (1 + np.arange(5.0))[:, None, None] * np.eye(3)
    one = Idle(pulls, np.array([0, 1, 0, 0, 1]), np.arange(15.0).reshape(5, 3), cov, 3 * cov[:2])
    assert (len(one), one.poses) == (5, 3)
    np.testing.assert_allclose(one.scaled(2.0).cov, 4 * cov)
    np.testing.assert_allclose(one.scaled(2.0).turned, 12 * cov[:2])
    np.testing.assert_allclose(one.with_rotation(3.0).turned, 27 * cov[:2])
    np.testing.assert_allclose(one.with_rotation(3.0).cov, cov)
    joined = one.in_poses(2, lambda position: 10 * position)
    assert joined.pulls.pose.tolist() == [4, 4, 9, 9]
    np.testing.assert_allclose(joined.cov[:, 0, 0], [1.5, 1.5, 4.5, 4.5])
    np.testing.assert_allclose(joined.turned[:, 0, 0], [15.0, 45.0])
    assert replace(one, turned=None).scaled(2.0).turned is None


# --- the catalogue --------------------------------------------------------------------------------


def case_of(**more):
    """A campaign with two rounds of base reflectors at known times."""
    rows = pd.DataFrame(
        {"target": ["B1", "B1", "Pl1"], "group": ["a", "b", "c"], "file": ["t", "t", "t"],
         "time": pd.to_datetime(["2025-01-01", "2025-01-02", "2025-01-03"])}
    )  # fmt: skip
    asked = Some(naming=Some(chain=["Pl1", "Pl2"]), base_frame={"B1": 1}, tool={"P1": 1}, priors={})
    of_ = {"readings": rows, "settings": asked, "robot": RAIL}
    return Some(**of_ | {"loads": pd.DataFrame({"file": ["l"]})} | more)


def data_of(pulls=2, known=True):
    """Pulls of one pose, unloaded positions known or not."""
    q, force = np.zeros((pulls, 7)), np.ones((pulls, 3))
    one = replace(Pulls.at(q, force), pose=np.ones(pulls, int))
    return Some(pulls=one, unloaded=np.full((pulls, 3), 1.0 if known else np.nan))


def needs(case, data, name):
    """What a cause asks for."""
    return next(one.needs for one in expected.expected(case, data) if one.name == name)


def test_advice_that_was_followed_is_replaced_by_the_next():
    """Rounds of the base, unloaded positions, three levels of the force."""
    rows = case_of().readings
    one_round = case_of(readings=rows.assign(group="a"))
    untimed = case_of(readings=rows.assign(time=pd.NaT))
    for of_, module, name in (
        ((case_of(), data_of()), tracker_drift, "tracker_drift"),
        ((case_of(), data_of()), table, "joint_offset"),
        ((case_of(), data_of(3)), scale, "scale_zero"),
        ((case_of(), data_of(3)), joint_hardening, "joint_hardening"),
    ):
        assert needs(*of_, name) == module.FURTHER
    for of_, module, name in (
        ((one_round, data_of()), tracker_drift, "tracker_drift"),
        ((untimed, data_of()), tracker_drift, "tracker_drift"),
        ((case_of(), data_of(known=False)), table, "joint_offset"),
        ((case_of(), data_of(2)), scale, "scale_zero"),
        ((case_of(), data_of(2)), joint_hardening, "joint_hardening"),
    ):
        assert needs(*of_, name) == module.NEEDS


def test_priors_are_those_of_other_campaigns():
    """By the name of the cause; a name that no cause has is refused."""
    case = case_of()
    case.settings.priors = {"rail_roll": Some(odds=3.0, size=2.0)}
    every = expected.expected(case, data_of())
    assert {(one.odds, one.size) for one in every if one.name == "rail_roll"} == {(3.0, 2.0)}
    assert {one.odds for one in every if one.name != "rail_roll"} == {1.0}
    case.settings.priors = {"rail_rol": 1}
    with pytest.raises(InputError, match=r"which no cause here is called.*did you mean rail_roll"):
        expected.expected(case, data_of())
    anchored = case_of(readings=case.readings.assign(file="l"))
    for of_, there in ((case_of(), True), (anchored, False)):
        names = {one.name for one in expected.expected(of_, data_of())}
        assert ("chain_offset" in names) == there


@pytest.mark.parametrize(("sigma", "std"), [(2.0, np.sqrt(4 + 100 / 12)), (1000.0, 1000.0)])
def test_the_division_of_a_scale_counts_where_it_is_not_negligible(sigma, std):
    """Six readings to ten newtons; beside a kilonewton nobody sees that."""
    reading = np.array([2000.0, 2010, 2030, 2060, 2100, 2150])
    ends = [(pose, end, x) for pose in range(6) for end, x in (("Pl1", 0.0), ("Pl2", 3.0))]
    placed = pd.DataFrame(ends, columns=["pose", "target", "x_m"]).assign(
        repeat=1, state="loaded", y_m=0.0, z_m=1.0, time_s=5.0,
        **dict.fromkeys(covariance.columns(), 0.0),
    )  # fmt: skip
    for name in ("cxx_m2", "cyy_m2", "czz_m2"):
        placed[name] = 1e-10
    loads = pd.DataFrame({"pose": range(6), "repeat": 1, "force_n": reading, "branch": "up"})
    loads = loads.assign(payload=None, mass_kg=np.nan, mass_sigma_kg=0.0)
    told = forces.forces(of(scale={"sigma_n": sigma}), placed, loads)
    np.testing.assert_allclose(told["reading_std_n"], std)
    np.testing.assert_allclose(told["fx_n"], reading)


@pytest.mark.parametrize(
    ("instrument", "fine"),
    [
        ({"measures": "poses", "sigma_rad": 1e-5}, True), ({"measures": "poses"}, True),
        ({"measures": "points", "sigma_rad": 1e-5}, False), ({}, True),
    ],
)  # fmt: skip
def test_a_rotation_has_an_uncertainty_where_poses_are_measured(instrument, fine):
    """Points have none."""
    tool = MINIMAL["tool"] | {"P3": (0.1, 0.3, 0.4)}
    if fine:
        assert of(tool=tool, instrument=instrument).instrument.sigma_rad == instrument.get(
            "sigma_rad"
        )
        return
    with pytest.raises(ValidationError, match="sigma_rad is that of a pose"):
        of(tool=tool, instrument=instrument)


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ([(0, 0, 0), (4, 0, 0), (0, 3, 0)], None),
        ([(0, 0, 0), (4, 0, 0), (8, 4e-3, 0)], "lie on one line"),
        ([(0, 0, 0), (4, 0, 0), (8, 4e-2, 0)], None),
        ([(0, 0, 0), (4e-3, 0, 0), (0, 3e-3, 0)], "are all in one place"),
        ([(0, 0, 0), (4, 0, 0)], "only 2 base reflectors were measured"),
    ],
)
def test_base_reflectors_are_three_beside_a_line(places, said):
    """By a thousandth of their extent at least."""
    base = pd.DataFrame({"target": [f"B{k}" for k in range(len(places))]})
    if said is None:
        return register._enough(base, np.array(places, float))
    with pytest.raises(InputError, match=said):
        register._enough(base, np.array(places, float))
    return None
