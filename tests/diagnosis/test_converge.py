"""Mistakes, noise and causes together: where the iteration ends, and that it is a fixed point."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from small_case import moved, small, where
from world_files import written

from pipeline.diagnosis import converge as module
from pipeline.diagnosis.converge import converge
from pipeline.diagnosis.verdict import verdict
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring, inline
from pipeline.run import ingested
from pipeline.store.campaign import in_memory
from pipeline.system.fit import fit

KEPT = Path(__file__).parents[2] / "data" / "raw"


def settled(case):
    """Final state of a campaign."""
    reduced = bring(case)
    return converge(case, reduced, fit(case, reduced), inline)


def spoilt(case, count, size_m, seed):
    """A campaign with some bad loaded readings, and where they are."""
    rows, rng = case.readings, np.random.default_rng(seed)
    own = (rows["state"] == "loaded") & rows["target"].isin(case.settings.measured)
    chosen = rng.choice(rows.index[own], count, replace=False)
    for k in chosen:
        way = rng.standard_normal(3)
        case = moved(case, case.readings.index == k, size_m * way / np.linalg.norm(way))
    return case, {f"{rows.loc[k, 'group']}/{rows.loc[k, 'target']}" for k in chosen}


@pytest.fixture(scope="module")
def mistaken():
    """Six poses with a bad reading in half of them, and the findings."""
    case, true = spoilt(small(4), 3, 2e-3, 1)
    return case, true, settled(case)


@pytest.mark.whole
def test_what_is_wrong_is_found_beside_all_that_is_held(mistaken):
    """Three of 36 loaded readings off by 2 mm: exactly these, and the model is adequate."""
    _, true, end = mistaken

    assert {one.where for one in end.screened.findings} == true
    assert str(verdict(end.diagnosis.facts)) == "adequate"
    assert not end.diagnosis.causes


@pytest.mark.whole
def test_an_end_settles_where_it_is(mistaken):
    """With the accused readings deleted, there is no new accusation, and the same springs."""
    case, _, end = mistaken

    again = settled(end.screened.case)

    assert again.screened.findings == ()
    assert again.right.estimate.value == pytest.approx(end.right.estimate.value, rel=1e-12)
    assert again.diagnosis.modelled == end.diagnosis.modelled
    assert len(end.screened.case.readings) == len(case.readings) - 3


def mixed(case):
    """The case with its rows in another order."""
    rng = np.random.default_rng(5)
    tables = {name: getattr(case, name) for name in ("readings", "loads", "joints")}
    other = {
        name: rows.iloc[rng.permutation(len(rows))].reset_index(drop=True)
        for name, rows in tables.items()
    }
    return replace(case, **other)


@pytest.mark.whole
def test_the_order_of_rows_is_no_information_for_the_springs(mistaken):
    """If pose, repeat and time are stated, rows may come in any order."""
    case, other = mistaken[0], mixed(mistaken[0])

    before, after = fit(case, bring(case)).estimate, fit(other, bring(other)).estimate

    assert after.value == pytest.approx(before.value, rel=1e-6)
    assert after.chi2 == pytest.approx(before.chi2, rel=1e-6)


@pytest.mark.whole
def test_the_order_of_rows_is_no_information_for_what_is_wrong(mistaken):
    """The same readings are named, and the springs without them are the same."""
    case, true, end = mistaken

    again = settled(mixed(case))

    assert {one.where for one in again.screened.findings} == true
    assert again.right.estimate.value == pytest.approx(end.right.estimate.value, rel=1e-6)


@pytest.mark.whole
def test_readings_that_tails_explain_are_told_where_they_are_far_off(mistaken):
    """Of two that stay in use, the one beyond ten standard uncertainties, with its line."""
    end = mistaken[2]
    far, near = (
        replace(one, before=off)
        for one, off in zip(end.screened.findings[:2], (11.7, 7.0), strict=True)
    )

    told = module._bounded(replace(end, screened=replace(end.screened, doubted=(far, near))))

    assert told.diagnosis.facts.bounds.doubted == far.at
    assert len(far.at) == 1
    assert end.diagnosis.facts.bounds.doubted == ()


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("count", "size_m"), [(4, 2e-2), (1, 1e-3), (10, 1e-3), (10, 2e-2), (14, 4e-3)]
)
def test_contamination_is_a_slope_and_no_cliff(count, size_m):
    """From one of 54 loaded readings to a quarter of them: named, and never green."""
    case, true = spoilt(small(6, poses={"count": 9}), count, size_m, count)

    end = settled(case)

    named = {one.where for one in end.screened.findings}
    word = str(verdict(replace(end.diagnosis.facts, mistakes=end.screened.findings)))
    assert word in ("bad_data", "unexplained")
    assert len(named & true) >= 0.95 * count
    assert len(named - true) <= 1


@pytest.mark.whole
def test_a_bad_reading_beside_a_cause_is_neither_of_both():
    """A rolling carriage, and one reading off by 1 mm: the cause, and the reading."""
    case = small(8, poses={"count": 9}, hidden={"effects": ["rail_roll=3x"]})
    case = moved(case, where(case, "pose04_rep1_loaded", "P2"), [1e-3, 0, 0])

    end = settled(case)

    assert [one.where for one in end.screened.findings] == ["pose04_rep1_loaded/P2"]
    assert [effect.label for effect in end.diagnosis.modelled] == ["rail_roll"]


@pytest.mark.whole
def test_where_nobody_states_a_noise_the_others_say_which_readings_are_off():
    """Two of 54 loaded readings off by 2 mm, with scatter from the rest: exactly these."""
    case = small(7, poses={"count": 9}, tracker={"sigma_m": 3e-5, "stated": False})
    case, true = spoilt(case, 2, 2e-3, 3)

    end = settled(case)

    assert {one.where for one in end.screened.findings} == true
    assert str(verdict(end.diagnosis.facts)) == "adequate"
    assert end.diagnosis.facts.bounds.tracker < 1


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("spoilt_pull", [True, False])
def test_a_pose_that_is_read_as_one_settles(spoilt_pull):
    """Nine 6D poses, one rotated by 10 mrad under load: it is named, with all its lines."""
    six = {"kind": "camera", "measures": "poses", "sigma_m": 5e-5, "sigma_rad": 2e-4}
    case = small(9, poses={"count": 9}, tracker=six)
    rows = case.readings
    here = (rows["pose"] == 4) & (rows["repeat"] == 2) & (rows["state"] == "loaded")
    here &= rows["target"].isin(case.settings.measured)
    xyz = rows.loc[here, ["x_m", "y_m", "z_m"]].to_numpy(float)
    if spoilt_pull:
        off = np.cross([0.0, 0.01, 0.0], xyz - xyz.mean(axis=0))
        case = moved(case, here.to_numpy(), off)

    end = settled(case)

    assert [one.where for one in end.screened.findings] == ["pose04_rep2_loaded"] * spoilt_pull
    assert all(len(one.at) == 3 for one in end.screened.findings)
    assert str(verdict(end.diagnosis.facts)) == "adequate"
    again = settled(end.screened.case)
    assert again.right.estimate.value == pytest.approx(end.right.estimate.value, rel=1e-12)


@pytest.mark.whole
def test_a_campaign_that_arrives_reduced_settles():
    """Displacements of the campaign that ships, one force tripled: neither green nor an error."""
    raw = {path.name: path.read_bytes() for path in (KEPT / "fanuc_r2000ic").iterdir()}
    given = ingested(in_memory(raw), plausible=False)
    clean = settled(given)

    three, table = np.where(np.arange(len(given.forces)) == 2, 3.0, 1.0), given.forces
    for name in ("fx_n", "fy_n", "fz_n"):
        at = table.schema.get_field_index(name)
        wrong = pa.array(table[name].to_numpy() * three)
        table = table.set_column(at, table.schema.field(at), wrong)
    end = settled(replace(given, forces=table))

    assert clean.screened.findings == ()
    assert clean.diagnosis.facts.bounds.predicts
    assert end.diagnosis.facts.bounds.left > clean.diagnosis.facts.bounds.left
    assert str(verdict(end.diagnosis.facts)) not in ("adequate", "explained")


@pytest.mark.whole
def test_noise_of_twenty_times_the_stated_is_no_noise():
    """No reading is accused and no cause found, and yet it is not adequate."""
    end = settled(small(5, poses={"count": 9}, tracker={"sigma_m": 3e-5, "noise_scale": 20.0}))

    assert end.screened.findings == ()
    assert str(verdict(end.diagnosis.facts)) == "unexplained"
    assert end.diagnosis.facts.bounds.faulty


@pytest.mark.whole
@pytest.mark.sampled(1)
def test_a_reading_far_out_in_the_tails_is_no_scatter():
    """Student's noise (nu = 3) with one reading at more than fifty widths of the core.

    It spoils the predictions of its neighbours, until it has its own weight.
    """
    end = settled(ingested(in_memory(written("at960_student3", 180587621)[3])))

    far = end.diagnosis.facts.bounds.far
    assert far.count > 1
    assert not end.diagnosis.facts.bounds.scattered
    assert str(verdict(end.diagnosis.facts)) == "adequate"


def test_ends_that_follow_each_other_for_ever_are_as_good(monkeypatch):
    """Of a cycle the state with the fewest mistakes is used, and none from before it."""
    follows = {0: 5, 5: 6, 6: 5}
    made = [SimpleNamespace(key=n, findings=range(n)) for n in range(7)]
    monkeypatch.setattr(module, "files_of", lambda *_: made[0])
    monkeypatch.setattr(module, "singles_of", lambda *_: made[0])
    monkeypatch.setattr(
        module, "_noise_and_causes", lambda held, *_: SimpleNamespace(screened=held)
    )
    monkeypatch.setattr(module, "_screened", lambda *of: made[follows[of[-1].screened.key]])
    monkeypatch.setattr(module, "_bounded", lambda end: end)
    monkeypatch.setattr(module, "_supposed", lambda *_: ())

    assert converge(None, None, None, inline).screened.key == 5


def test_a_mistake_is_stated_by_the_last_model(monkeypatch):
    """Where the same is found again with the causes in the model, its numbers are those of then."""
    alone, beside = (SimpleNamespace(key=1, findings=(model,)) for model in ("springs", "causes"))
    monkeypatch.setattr(module, "files_of", lambda *_: alone)
    monkeypatch.setattr(module, "singles_of", lambda *_: alone)
    monkeypatch.setattr(
        module, "_noise_and_causes", lambda held, *_: module._Converged(held, None, None, None)
    )
    monkeypatch.setattr(module, "_screened", lambda *_: beside)
    monkeypatch.setattr(module, "_bounded", lambda end: end)
    monkeypatch.setattr(module, "_supposed", lambda *_: ())

    assert converge(None, None, None, inline).screened.findings == ("causes",)


@pytest.mark.parametrize(
    ("wrong", "pulls", "scatter", "laws", "named"),
    [
        (2, 40, 20.0, 0, True),  # hardly any instrument
        (10, 40, 2.5, 0, False),  # a scale is worse than stated more often than that
        (3, 40, 1.2, 0, False),  # a scatter that is usual
        (2, 40, 1.0, 0, False),  # nothing in their place
        (1, 40, 1.0, 1, True),  # a law that nobody listed
        (4, 40, 1.0, 1, False),  # many mistakes are no better
    ],
)
def test_few_wrong_forces_are_likelier_than_a_scale_out_of_order(
    monkeypatch, wrong, pulls, scatter, laws, named
):
    """They are named where they explain the readings by themselves, and only if likelier."""
    off = SimpleNamespace(before=6.0, axes=1)
    strange = SimpleNamespace(
        effect=SimpleNamespace(law="any"),
        height=SimpleNamespace(value=6.0, std=1.0),
        amplitudes=(None,),
    )
    ends = [
        SimpleNamespace(
            screened=SimpleNamespace(key=count, findings=(off,) * count),
            diagnosis=SimpleNamespace(
                settled=True,
                scatter=SimpleNamespace(scale=scale),
                causes=(strange,) * (laws if count == 0 else 0),
            ),
            right=SimpleNamespace(data=SimpleNamespace(pulls=range(pulls - count))),
        )
        for count, scale in ((0, scatter), (wrong, 1.0))
    ]
    files = SimpleNamespace(findings=())
    monkeypatch.setattr(module, "files_of", lambda *_: files)
    monkeypatch.setattr(module, "singles_of", lambda *_: ends[0].screened)
    monkeypatch.setattr(module, "_ended", lambda _, __, held, *_rest: ends[held.key > 0])
    monkeypatch.setattr(module, "_supposed", lambda *_: (ends[1].screened,))
    monkeypatch.setattr(module, "_bounded", lambda end: end)

    assert (converge(None, None, None, inline) is ends[1]) == named


def test_mistakes_are_asked_without_a_strange_law_and_beside_the_listed_causes(monkeypatch):
    """A typed force may look like a law of the scale, and is told once the tilt is in the model."""
    case = small(4)
    tilt = next(e for e in catalogue(case.robot, bring(case).data.pulls) if e.name == "joint_tilt")
    strange = replace(tilt, law="any")
    said = SimpleNamespace(
        as_stated=None,
        modelled=(strange, tilt),
        causes=tuple(SimpleNamespace(effect=one) for one in (strange, tilt)),
        seen=SimpleNamespace(suspects=()),
    )
    end = SimpleNamespace(diagnosis=said, screened=SimpleNamespace(key=()))
    asked = []
    monkeypatch.setattr(module, "_tails", lambda *_: None)
    monkeypatch.setattr(module, "files_beside", lambda _, files, base: base)
    monkeypatch.setattr(
        module,
        "singles_of",
        lambda base, *_: asked.append(base) or SimpleNamespace(key=len(asked)),
    )

    module._supposed(case, SimpleNamespace(case=case), end)

    assert [one.cell.effects for one in asked] == [case.cell.effects, (*case.cell.effects, tilt)]
    assert [len(one.start) for one in asked] == [len(one.cell.parameters) for one in asked]
