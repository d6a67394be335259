"""Parts of the answer that are put together from others, each by what it takes from which."""

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest
from test_records_by_hand import RAIL, TILT, fitted, springs

from pipeline.answer import answer as whole
from pipeline.answer import (
    archive,
    diagnosis,
    inputs,
    pose_budget,
    recommended,
    results,
    stiffness,
    values,
)
from pipeline.answer import tables as kept
from pipeline.answer.contract import (
    Answer,
    Data,
    Drawn,
    Odd,
    Reason,
    TargetDeflection,
    Which,
)
from pipeline.answer.words import BECAUSE
from pipeline.diagnosis.average import Dependence
from pipeline.reduction.settings import Instrument, UnitSettings


def test_what_stands_in_every_answer_is_of_its_campaign(monkeypatch):
    """Names of the campaign, of its settings and of the robot; files by name with hash and size."""
    monkeypatch.setattr(inputs, "versions", lambda: {"pipeline": "9"})
    stated = Some(name="a cell", simulated=True)
    raw = Some(settings=stated, robot=Some(name="kr"), files={"b.csv": b"abc", "a.csv": b""})
    used = Some(instrument=Instrument(), sheet=None, robot_unit=UnitSettings(serial="s"))
    lines = (Some(text="one"), Some(text="two"))
    told = inputs.of_campaign("c", raw, used, lines)
    one, two = told.pop("inputs")
    assert (one.file, one.bytes, two.file, two.bytes) == ("a.csv", 0, "b.csv", 3)
    assert two.sha256 == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert told.pop("robot_unit").serial == "s"
    assert told == {
        "format": 1, "campaign": "c", "name": "a cell", "robot": "kr", "simulated": True,
        "verdict_sentence": ("one", "two"), "first_screen": lines, "instrument": None,
        "versions": {"pipeline": "9"},
    }  # fmt: skip


def test_which_values_hold_is_recorded_with_their_hypotheses():
    """Which table they rest on; which causes with which weight, and whether these are listed."""
    odd = Some(name="ghost", where=5, axis="A4", law=None, form="f", label="ghost:5")
    hypotheses = (Some(weight=0.7, effects=(TILT, odd)), Some(weight=0.3, effects=()))
    of = Some(fitted=Some(case=Some(robot=RAIL)), hypotheses=hypotheses)
    for corrects, table in ((True, "estimated"), (False, "as_delivered")):
        found = Some(
            diagnosis=Some(facts=Some(unloaded=Some(corrects=corrects))),
            row=Some(model=Which.AVERAGED, data=Data.CORRECTED, reason=Reason.RIVALS),
            told=Some(values=of),
        )
        entry = whole._recommended(found)
        assert (entry.model, entry.data, entry.table) == ("averaged", "corrected", table)
        assert (entry.reason, entry.why) == ("rivals", BECAUSE[Reason.RIVALS])
    both, none = entry.hypotheses
    assert (both.weight, none.weight, none.causes) == (0.7, 0.3, ())
    assert [(c.name, c.where, c.axis, c.form, c.in_catalogue) for c in both.causes] == [
        ("joint_tilt", 2, "A1", TILT.form or None, True), ("ghost", 5, "A4", "f", False)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("idle", "loads", "alone"),
    [(None, [1.0], 0), ([7, 8, 8], [1.0, np.nan], 2), ([7, 1, 5], [5.0], 1), ([2], [3.0], 0)],
)
def test_poses_without_any_pull_are_counted(monkeypatch, idle, loads, alone):
    """Neither a displacement nor a row of loads."""
    monkeypatch.setattr(whole, "identity_entry", lambda *of: of)
    data = Some(
        idle=idle and Some(pulls=Some(pose=np.array(idle))),
        pulls=Some(pose=np.array([1, 2]), force="force"),
    )
    found = Some(
        raw=Some(settings="settings"),
        right=Some(data=data),
        given=Some(
            reduced=Some(shown={"readings": {"time": "time"}}),
            case=Some(loads=pd.DataFrame({"pose": loads})),
        ),
    )
    settings, time, pose, force, count = whole._identity(found)
    assert (settings, time, force, count) == ("settings", "time", "force", alone)
    assert pose.tolist() == [1, 2]


def test_values_beside_the_answer_are_there_where_they_say_something(monkeypatch):
    """Repeated days, effective springs beside mistakes, the fit of identified causes."""
    seen = Some(poses=3, relative=0.02, p_value=0.4)
    monkeypatch.setattr(whole, "days", lambda plain: plain and seen)
    day = whole._day_to_day(Some(right=Some(plain=True)))
    assert (day.poses, day.relative_std, day.p_value) == (3, 0.02, 0.4)
    assert whole._day_to_day(Some(right=Some(plain=None))) is None
    monkeypatch.setattr(whole, "stiffness_entries", lambda cell, hypotheses: (cell, hypotheses))
    right = Some(case=Some(cell="cell"))
    found = Some(mistakes=(1,), right=right, effective=Some(hypotheses="h"), extended=None)
    assert whole._effective(found) == ("cell", "h")
    assert whole._extended_entry(found) is None
    found.mistakes = ()
    assert whole._effective(found) == ()
    monkeypatch.setattr(whole, "stated", lambda *of: {"of": of})
    monkeypatch.setattr(whole.contract, "Extended", dict)
    own = Some(model=lambda *of: of)
    found = Some(extended=own, campaign="c", verdict="v", row="r", where="w")
    assert whole._extended_entry(found) == {"of": (own, ("c", "v", "r"), "w")}


def test_one_model_is_a_hypothesis_of_weight_one(monkeypatch):
    """Joint springs by themselves; identified causes without their rivals; on which robot."""
    monkeypatch.setattr(recommended, "left_out", lambda system: system)
    fit = Some(case=Some(cell="cell"), system="system", estimate="estimate")
    alone = recommended.joint_springs(fit)
    (one,) = alone.hypotheses
    assert (one.weight, one.effects, one.cell) == (1.0, (), "cell")
    assert (one.system, one.estimate, alone.left_out_m) == ("system", "estimate", "system")
    assert alone.found == "estimate"
    first = replace(one, weight=0.6, system="first")
    found = Some(hypotheses=(first, replace(one, weight=0.4)), causes=(), left_out_after_m=None)
    own = recommended.identified(fit, found, "where")
    assert len(own.hypotheses) == 1
    assert (own.first.weight, own.first.system) == (1.0, "first")
    assert (own.left_out_m, own.where) == ("first", "where")
    assert recommended.identified(fit, Some(hypotheses=()), "where") is None

    table = Some(robot="true robot")
    monkeypatch.setattr(recommended, "corrected", lambda cell, data, stood: (table, data))
    stand = Some(**vars(fit) | {"data": "all"}, standing=lambda robot, data: (robot, data("some")))
    for corrects, said in ((True, ("true robot", "some")), (False, stand)):
        facts = Some(unloaded=Some(corrects=corrects))
        assert recommended.springs_of_extended(stand, Some(facts=facts)) == said


def test_effective_springs_are_those_of_the_corrected_data(monkeypatch):
    """Where there is a mistake; else the joint springs of the answer."""
    monkeypatch.setattr(results, "joint_springs", lambda fit: f"springs of {fit}")
    blank = dict.fromkeys(results.CampaignResults.__dataclass_fields__)
    told = {"right": "right", "springs": Some(values="own")}
    for mistakes, said in (((1,), "springs of right"), ((), "own")):
        found = results.CampaignResults(**blank | told | {"facts": Some(mistakes=mistakes)})
        assert found.effective == said


@pytest.mark.parametrize(("where", "way"), [(None, False), (1, False), (None, True), (1, True)])
def test_which_joints_are_determined_is_that_at_the_test_pose(monkeypatch, where, way):
    """Where a joint has a stiffness for each sign, and a test pose has one of them."""
    monkeypatch.setattr(recommended, "two_sided", lambda one: one.both)
    monkeypatch.setattr(recommended, "at_pose", lambda hypotheses, q, force: (q, force))
    monkeypatch.setattr(recommended, "springs", lambda of: Some(identifiable=of))
    own = Some(
        where=where and Some(q="q", force="f"),
        hypotheses=(Some(both={}), Some(both={2: 3} if way else {})),
        found=Some(identifiable=np.array([True, False, True])),
        fitted=Some(case=Some(robot=Some(n=2))),
    )
    told = recommended.ModelValues._stated.fget(own)
    assert list(told) == (["q", "f"] if where and way else [True, False])


def first_joints(n):
    """The rail and the first joints of a robot, as far as names are concerned."""
    return Some(n=n, joints=RAIL.joints[:n])


def test_stiffnesses_are_recorded_joint_by_joint(monkeypatch):
    """Each with its own budget, remarks, partners and signs; at the test pose, if there is one."""
    robot = first_joints(3)
    found = springs([4e-8, 5e-7, 6e-7], [1e-9, 2e-8, np.inf], (True, True, False))
    own = (Some(system=Some(B=np.array([[1.0, 0.0, 2.0]]), typical=np.ones(3))),)
    asked = []
    fakes = {
        "at_pose": lambda hypotheses, q, force: asked.append((q, force)) or own,
        "_by_sign": lambda *of: {2: "both"},
        "springs": lambda hypotheses: found,
        "_parts": lambda hypotheses, count: {"a": np.array([1e-18, 4e-16, 1.0])[:count]},
        "dependences": lambda hypotheses: [Dependence(2, "c", "r", True)],
        "_partners": lambda hypotheses, found: [[], [], [0]],
    }
    for name, fake in fakes.items():
        monkeypatch.setattr(stiffness, name, fake)
    monkeypatch.setattr(stiffness.axes, "alone", lambda robot: ["E1", "A1", "A2"])
    for where in (None, Some(q="q", force="f")):
        every = stiffness.stiffness_entries(Some(robot=robot), own, where)
        assert [x.joint for x in every] == [1, 2, 3]
        assert [x.value for x in every] == [pytest.approx(2.5e7), pytest.approx(2e6), None]
        assert [[part.share for part in x.budget] for x in every] == [
            [pytest.approx(1.0)], [pytest.approx(1.0)], []
        ]  # fmt: skip
        assert [[remark.odd for remark in x.remarks] for x in every] == [
            [], [Odd.NO_LEVER], [Odd.LOST]
        ]  # fmt: skip
        assert every[1].finding.startswith(f"{every[1].called} is not identifiable: no pull")
        assert every[0].finding is None
        assert [x.axis for x in every] == ["E1", "A1", "A2"]
        assert [x.by_sign for x in every] == [None, None, where and "both"]
    assert asked == [("q", "f")]
    monkeypatch.setattr(stiffness, "dependences", lambda hypotheses: [])
    *_, three = stiffness.stiffness_entries(Some(robot=robot), own)
    (remark,) = three.remarks
    assert (remark.odd, remark.others) == (Odd.TOGETHER, (f"k_{robot.joints[0].name}",))


@pytest.mark.parametrize(("known", "count"), [((0, 0), 2), ((0, 1), 0), ((1, 1), 0)])
def test_combinations_are_of_two_joints_that_are_not_determined(monkeypatch, known, count):
    """By their names, with value, uncertainty and interval in the unit of the first."""
    mix = Some(
        of=np.array([1, 0]), weights=np.array([1.0, 0.5]), value=3.0, std=0.2, low=2.5, high=3.6
    )
    monkeypatch.setattr(stiffness, "information", lambda hypotheses: "N")
    monkeypatch.setattr(stiffness, "together", lambda hypotheses, N, alone: [mix, mix])
    fit = Some(case=Some(robot=first_joints(2)))
    sure = np.array([*known, False], bool)
    of = Some(fitted=fit, hypotheses=(), found=Some(identifiable=sure))
    for door, needs in ((None, ""), (lambda fit, N, pair: f"{N} {pair.tolist()}", "N [1, 0]")):
        monkeypatch.setattr(stiffness.doors, "found", lambda name, door=door: door)
        every = stiffness.combination_entries(of)
        assert len(every) == count
        for one in every:
            assert one.of == (f"k_{RAIL.joints[1].name}", f"k_{RAIL.joints[0].name}")
            assert (one.weights, one.value, one.std) == ((1.0, 0.5), 3.0, 0.2)
            assert (one.ci95, one.unit, one.needs) == ((2.5, 3.6), "rad/(N m)", needs)


@pytest.mark.parametrize(
    ("identifiable", "door"), [((True, False), True), ((True, True), False), ((False, False), True)]
)
def test_validation_is_there_where_anything_is_determined(monkeypatch, identifiable, door):
    """With what the annex draws, or nothing drawn without it."""
    none = Drawn(test_pose={}, global_={})
    drawn = {"test_pose": {"P1": 1.0}, "global_": {}, "independent": none}
    means = (lambda checked, of: drawn | {"poses": checked}) if door else None
    monkeypatch.setattr(values.doors, "found", lambda name: means)
    found = Some(identifiable=np.array(identifiable))
    of = Some(found=found, left_out_m=np.array([3e-3, -4e-3]))
    told = values._validation_entry(Some(values=of, checked=17), Some(stated=True))
    if not any(identifiable):
        assert told is None
        return
    assert told.held_out_rms_mm == pytest.approx(np.sqrt(12.5))
    assert (told.test_pose_stated, told.poses) == (True, 17 if door else 0)
    assert told.test_pose == ({"P1": 1.0} if door else {})


def test_mistakes_come_first_and_scatter_that_no_cause_names_last(monkeypatch):
    """In the order of the report; what the next poses were checked for, if anybody knows."""
    right = fitted(plain=None)
    right.excess = right.noise
    right.case.robot, right.case.tool, right.case.readings = RAIL, "tool", "readings"
    own = Some(name="tracker_noise")
    entry = Some(causes=(own,), model_copy=lambda update: update)
    monkeypatch.setattr(diagnosis, "diagnosis_of_good_data", lambda *of: entry)
    monkeypatch.setattr(diagnosis, "_data_causes", lambda found: ("mistake",))
    monkeypatch.setattr(diagnosis, "timed", lambda readings: readings == "readings")
    found = Some(diagnosis=None, facts=None, right=right)
    kept = {"kept": ("a",), "not_checked": (), "capsules": None}
    for limits in (None, lambda robot, tool, settings: kept):
        monkeypatch.setattr(diagnosis.doors, "found", lambda name, limits=limits: limits)
        told = diagnosis.diagnosis_entry(found)
        mistake, cause, *noise = told["causes"]
        assert (mistake, cause, told["next_poses_in"]) == ("mistake", own, limits and kept)
        assert [one.name for one in noise] == ["force_noise", "heavy_tails", "tracker_wander"]
        assert noise[-1].parameters[1].value == 780.0
    right.excess = Some(**vars(right.noise) | {"larger": np.array([False, False])})
    assert len(diagnosis.diagnosis_entry(found)["causes"]) == 4


@pytest.mark.parametrize(
    ("steps", "springs_by", "of"), [((1,), None, True), ((1,), 1, False), ((), None, False)]
)
def test_an_answer_knows_its_kind_and_its_machine(steps, springs_by, of):
    """Positions alone; the serial number if stated; virtual robots apart from real ones."""
    one = Some(position_steps=steps, springs_by=springs_by)
    assert Answer.of_positions.fget(one) == of
    for simulated, kind in ((True, "kr (simulated)"), (False, "kr")):
        assert Answer.kind.fget(Some(robot="kr", simulated=simulated)) == kind
    for unit, more in (
        (None, ""),
        (Some(serial=None), ""),
        (Some(serial="7"), ", serial number 7"),
    ):
        assert Answer.machine.fget(Some(kind="X", robot_unit=unit)) == f"X{more}"
    joints = [
        Some(joint=1, axis="E1", name="k_r1", called="c1"),
        Some(joint=3, axis=None, name="k_3", called="c3"),
    ]
    assert Answer.axes.fget(Some(stiffness=joints)) == {1: "E1"}
    assert Answer.called(Some(stiffness=joints), "k_3") == "c3"


@pytest.mark.parametrize("missing", [None, "dx_mm", "dy_mm", "dz_mm"])
def test_a_deflection_has_a_length_if_all_of_it_is_known(missing):
    """2, 3 and 6 mm are 7 mm."""
    parts = {"dx_mm": 2.0, "dy_mm": -3.0, "dz_mm": 6.0}
    parts |= {missing: None} if missing else {}
    one = TargetDeflection(target="P", **parts, std_mm=(0.0, 0.0, 0.0))
    assert one.size_mm == (None if missing else pytest.approx(7.0))


def test_reasons_that_do_not_explain_the_readings_are_three():
    """And two hold what is too small to name."""
    assert {one for one in Reason if not one.holds_for_its_readings} == {
        "unexplained", "mistake_and_unexplained", "springs_disagree"
    }  # fmt: skip
    small = {"too_small_to_name", "mistake_and_too_small_to_name"}
    assert {one for one in Reason if one.unseen} == small


def test_an_answer_takes_each_part_from_where_it_is_made(monkeypatch):
    """Every key by the function that makes it, from the data as given or as corrected."""

    def made(name, *keep):
        def part(*of, **more):
            return (name, *(of[k] for k in keep), *more.values())

        return part

    class Parts(dict):
        def model_copy(self, update):
            return Parts(self | update)

    parts = {
        "combination_entries": ("together", 0), "diagnosis_entry": ("diagnosis",),
        "best_pose": ("best", 2), "joint_to_pull": ("joint", 2), "pose_budget": ("parts", 4),
        "tolerance_entry": ("tolerance", 0), "first_screen": ("lines", 1),
        "measured_on": ("day", 1), "budget_entries": ("budget", 0), "noise_entry": ("noise", 0),
        "registration_entry": ("registration", 0), "payload_entries": ("payloads", 0),
        "assumptions": ("assumptions", 2), "timed": ("timed", 0), "_recommended": ("recommended",),
        "_identity": ("identity",), "_day_to_day": ("days",), "_extended_entry": ("extended",),
        "rejected_entries": ("rejected", 0), "left_out_entries": ("lost", 0, 1, 2),
    }  # fmt: skip
    for name, of in parts.items():
        monkeypatch.setattr(whole, name, made(*of))
    monkeypatch.setattr(whole, "_effective", lambda found: found.asked)
    monkeypatch.setattr(whole, "diagnosis_entry", lambda found: Parts(of="diagnosis"))
    monkeypatch.setattr(whole, "pose_entry", lambda robot, where, judged: Parts(robot=robot))
    monkeypatch.setattr(whole, "of_campaign", lambda *of: {"head": of})
    monkeypatch.setattr(whole, "with_positions", lambda of, stood: of)
    monkeypatch.setattr(whole, "values_entry", lambda told, where: Values(told))
    monkeypatch.setattr(whole, "FirstScreen", lambda *of: of)
    monkeypatch.setattr(whole, "Answer", Parts)
    monkeypatch.setattr(whole.contract, "Forward", dict)
    monkeypatch.setattr(whole.contract, "Equilibrium", str)
    against = Some(sentences=("s",), overload="heavy", factor=1.02)
    doors = {
        whole._AGAINST: lambda found, stiffness: against,
        whole._FINDINGS: lambda found, answer, sentences: (*sentences, "odd"),
        whole._TABLE: lambda stood: ("letters", "mixed"),
    }
    case = Some(settings="used", rejected="rejected", aside=(), readings="given")
    shown = {"readings": "shown"}
    given = Some(case=case, reduced=Some(shown=shown))
    right = Some(case="right case", reduced=Some(registration="R"))
    first = Some(cell=Some(equilibrium="bent"))
    raw = Some(robot="robot", settings=Some(tolerance="T", priors={"b": 1, "a": 1}))
    found = Some(
        campaign="c", raw=raw, given=given, right=right, asked=(), mistakes="mistakes",
        where=Some(q="q", force="f"), control=None, judged=Some(at="at"),
        told=Some(values=Some(first=first), model="model"), springs="springs",
        diagnosis=Some(facts=Some(unloaded="stood")),
    )  # fmt: skip

    monkeypatch.setattr(whole.doors, "found", lambda name: None)
    bare = whole.answer(found)
    assert (bare["reliability"], bare["influence"], bare["findings"]) == ((), (), ())
    assert (bare["geometry"], bare["geometry_combinations"]) == ((), ())
    assert (bare["overload"], bare["common_factor"], bare["effective"]) == (None, None, ())
    screen, contradicted = bare["head"][3][1][:-1], bare["head"][3][1][-1]
    assert (screen[2], contradicted) == ("stiffness of springs", ())

    monkeypatch.setattr(whole.doors, "found", doors.__getitem__)
    found.asked, found.control = ("effective",), Some(least=("least",), most=("most",))
    told = whole.answer(found)
    assert (told["reliability"], told["influence"]) == (("least",), ("most",))
    assert told["findings"] == ("s", "odd")
    assert (told["geometry"], told["geometry_combinations"]) == ("letters", "mixed")
    assert (told["overload"], told["common_factor"]) == ("heavy", 1.02)
    assert told["effective"] == ("effective",)
    screen = told["head"][3][1]
    assert (screen[2], screen[-1]) == (("effective",), ("s",))
    assert told["head"][:3] == ("c", raw, "used")
    assert told["measured"] == ("day", "shown")
    stiff = f"stiffness of {found.told}"
    assert (told["stiffness"], told["joint_springs"].stiffness) == (stiff, "stiffness of springs")
    assert told["budget"] == ("budget", stiff)
    assert told["combinations"] == ("together", found.told.values)
    assert told["test_pose"] == {"robot": "robot", "budget": ("parts", "at")}
    assert told["diagnosis"] == {"of": "diagnosis", "best_pose": ("best", ("joint", stiff))}
    assert told["tolerance"] == ("tolerance", "T")
    assert told["noise"] == ("noise", right)
    assert told["rejected"] == ("rejected", "rejected", "lost", case, "right case", "mistakes")
    assert told["registration"] == ("registration", "R")
    assert told["payloads"] == ("payloads", case)
    assert told["model"] == {"equilibrium": "bent", "priors": ("a", "b")}
    assert told["assumptions"] == ("assumptions", ("timed", "given"))
    assert told["set_aside"] == ()


class Values(dict):
    """The values of one model."""

    def __init__(self, of):
        """Their stiffness says whose they are."""
        super().__init__(stiffness=f"stiffness of {of}")
        self.stiffness = self["stiffness"]


def test_tables_of_a_run_are_kept_under_their_names(monkeypatch):
    """What the answer rests on as usual; as given beside it, where a mistake was corrected."""
    for name in ("_system_table", "_errors_table", "_residuals_table", "covariance_table"):
        monkeypatch.setattr(kept, name, lambda *of, name=name: name)
    monkeypatch.setattr(kept, "_estimate_table", lambda names, of: f"estimate {of.of}")
    for name in ("system", "covariance"):
        monkeypatch.setattr(kept.tables, name, lambda of: None)
    monkeypatch.setattr(kept.doors, "found", lambda name: None)

    def values_of(name):
        first = Some(system=Some(of_pulls=Some(parameters=())), estimate=None)
        return Some(
            values=Some(first=first, parameters=(), found=Some(of=name, cov=None), left_out_m=None)
        )

    given = Some(reduced=Some(shown={"forces": "f", "displacements": "d"}))
    right = Some(reduced=Some(shown={"forces": "F", "displacements": "D"}))
    found = Some(
        told=values_of("told"), springs=values_of("springs"), given=given, right=right,
        mistakes=(1,), judged=Some(path="path"),
    )  # fmt: skip
    written = {}
    told = kept.kept(found, lambda name, table, promise: written.setdefault(name, table), None)
    usual = {
        "30_system": "_system_table", "31_errors": "_errors_table",
        "40_estimate": "estimate told", "41_covariance": "covariance_table",
        "40_estimate_joint_springs": "estimate springs",
        "41_covariance_joint_springs": "covariance_table", "42_residuals": "_residuals_table",
    }  # fmt: skip
    mended = {
        "22_forces_as_given": "f", "22_forces": "F",
        "23_displacements_as_given": "d", "23_displacements": "D",
    }  # fmt: skip
    assert written == usual | mended | {"63_path": "path"}
    assert told == {"residuals": "_residuals_table", "path": "path"}
    found.mistakes, found.judged.path = (), None
    written.clear()
    told = kept.kept(found, lambda name, table, promise: written.setdefault(name, table), None)
    assert (written, told) == (usual, {"residuals": "_residuals_table"})


@pytest.mark.parametrize(("known", "door"), [(True, True), (False, True), (True, False)])
def test_predictions_are_drawn_where_anything_is_determined(monkeypatch, known, door):
    """By the annex, if it is there."""
    draw = (lambda hypotheses, where: (hypotheses, where)) if door else None
    monkeypatch.setattr(kept.doors, "found", lambda name: draw)
    of = Some(found=Some(identifiable=np.array([known, False])), hypotheses="h")
    told = kept.predicted("model", of, "where", lambda stage: stage)
    assert (told.values, told.model) == (of, "model")
    assert told.checked == (("h", "where") if known and door else None)


def test_the_tables_of_a_report_are_those_that_a_run_kept(monkeypatch, tmp_path):
    """By their names in the report; what was not kept is left out."""
    monkeypatch.setattr(archive.parquet, "read", lambda path: path.read_text())
    monkeypatch.setattr(archive.tables, "frame", lambda text: text)
    for file in ("22_forces", "41_covariance"):
        (tmp_path / f"{file}.parquet").write_text(file)
    told = archive.kept_tables(Some(processed=tmp_path))
    assert told == {"forces": "22_forces", "covariance": "41_covariance"}


def test_other_campaigns_and_their_page_are_there_with_the_fleet(monkeypatch):
    """And nothing without it; an earlier answer only where it was made with the same key."""
    for door, among, page in (
        (None, archive.Among(), None),
        (lambda *of: of, ("campaign", "answer"), ("root",)),
    ):
        monkeypatch.setattr(archive, "found", lambda name, door=door: door)
        assert archive.among("campaign", "answer") == among
        assert archive.refresh("root") == page
    monkeypatch.setattr(archive, "read", lambda campaign: "answer")
    for done in (True, False):
        earlier = archive.done(Some(done=lambda key, done=done: done), "key")
        assert earlier == ("answer" if done else None)


@pytest.mark.parametrize("where", [None, Some(q="q", force="f")])
def test_a_model_is_handed_over_with_all_its_hypotheses(monkeypatch, where):
    """By weight, with the error that left-out poses show and the range of the forces."""
    monkeypatch.setattr(recommended.handover, "part", lambda *of: of)
    monkeypatch.setattr(recommended.handover, "IdentifiedModel", lambda *of: of)
    monkeypatch.setattr(recommended, "two_sided", lambda one: {})
    fit = Some(case=Some(robot=Some(n=2)), data=Some(pulls=Some(range_n=(1.0, 2.0))))
    estimate = Some(value=np.zeros(3), identifiable=np.array([True, False, True]))
    one = Some(weight=0.7, cell="c", estimate=estimate, system="s", ratio=1.5)
    of = recommended.ModelValues(fit, (one,), np.array([3e-3, np.nan, -4e-3]), where)
    row = Some(model="m", data="d", reason="r")
    campaign, said, basis, parts, known, left, force_n, at = of.model("c", "v", row)
    assert (campaign, said, basis) == ("c", "v", {"model": "m", "data": "d", "reason": "r"})
    assert parts == ((0.7, "c", estimate, "s", 1.5),)
    assert known.tolist() == [True, False]
    assert (left, force_n) == (pytest.approx(np.sqrt(12.5) * 1e-3), (1.0, 2.0))
    assert at == (None if where is None else ("q", "f"))


def test_the_values_of_the_answer_follow_the_decision(monkeypatch):
    """Springs alone, springs beside what is too small to name, or all hypotheses."""
    monkeypatch.setattr(recommended, "left_out", lambda system: system)
    monkeypatch.setattr(recommended, "weighed", tuple)
    monkeypatch.setattr(recommended, "beside_small", lambda own, small: (*own, *small))
    fit = Some(case=Some(cell="cell"), system="system", estimate="estimate")
    bare = Some(hypotheses=(), too_small=("small",), causes=())
    both = Some(hypotheses=(Some(system="h1"), Some(system="h2")), too_small=(), causes=())
    springs_, averaged = Some(model="joint_springs"), Some(model="averaged")

    alone = recommended.recommend(springs_, fit, both, "where")
    assert (len(alone.hypotheses), alone.where, alone.left_out_m) == (1, None, "system")
    beside = recommended.recommend(averaged, fit, bare, "where")
    assert (beside.hypotheses[1:], beside.where) == (("small",), "where")
    every = recommended.recommend(averaged, fit, both, "where")
    assert (every.hypotheses, every.left_out_m, every.where) == (both.hypotheses, "h1", "where")


def budgeted(monkeypatch, variances, moved, weights=(1.0,)):
    """The budget of a deflection (0, 0, 2) m, hypotheses with these deflections."""
    monkeypatch.setattr(pose_budget, "_moved", lambda handed, pull: moved[handed.k])
    monkeypatch.setattr(pose_budget, "_of_parameters", lambda one, *of: variances[one.k])
    every = [Some(k=k, weight=weight) for k, weight in enumerate(weights)]
    at = Some(
        std=np.array([0.5]), size=np.array([2.0]), moved=np.array([[0.0, 0.0, 2.0]])
    )  # fmt: skip
    return at, Some(hypotheses=every), Some(hypotheses=every)


def test_a_budget_of_a_deflection_adds_up_its_sources(monkeypatch):
    """Weighted by hypothesis, along the deflection; the largest first, in mm; the rest held out."""
    z = np.array([0.0, 0.0, 1.0])
    moved = [(1.9 * z + 0.7, 0.01 * z), (2.3 * z + 0.7, 0.02 * z)]
    moved = [(np.array([9.0, 9.0, one[2] - 0.7]), more) for one, more in moved]
    variances = [{"a": 0.01, "b": 1e-12}, {"a": 0.03}]
    at, values_, model = budgeted(monkeypatch, variances, moved, (0.75, 0.25))
    told = pose_budget.pose_budget(values_, model, np.zeros(7), np.ones(3), at)
    sizes = {
        "a": 0.75 * 0.01 + 0.25 * 0.03,
        "which_cause": 0.75 * 0.1**2 + 0.25 * 0.3**2,
        "second_order": 0.75 * 0.01**2 + 0.25 * 0.02**2,
    }
    sizes["held_out"] = 0.25 - sum(sizes.values())
    assert {part.source: part.std_mm for part in told} == pytest.approx(
        {name: 1e3 * np.sqrt(size) for name, size in sizes.items()}
    )
    assert [part.source for part in told] == sorted(sizes, key=lambda name: -sizes[name])
    for std, size in ((np.inf, 2.0), (0.5, 0.0), (np.inf, 0.0)):
        at.std, at.size = np.array([std]), np.array([size])
        assert pose_budget.pose_budget(values_, model, np.zeros(7), np.ones(3), at) == ()


def test_variances_of_parameters_are_those_of_their_sources(monkeypatch):
    """A' C_s a of the machine's parameters, scaled by the remainder; of laws beside them."""
    A = np.arange(12.0).reshape(3, 1, 4)
    mine = np.array([True, False, True])
    monkeypatch.setattr(pose_budget, "jacobian", lambda cell, pull, value: A)
    monkeypatch.setattr(pose_budget, "of_machine", lambda cell: mine)
    monkeypatch.setattr(pose_budget, "replace", lambda cell, equilibrium: equilibrium)
    rng = np.random.default_rng(2)
    cov = np.stack([X @ X.T for X in rng.standard_normal((2, 3, 3))])
    split = Some(source=np.array(["a", "law"]), cov=cov)
    monkeypatch.setattr(pose_budget, "budget", lambda system, estimate: split)
    beyond = np.diag([9.0, 9.0, 0.5, 0.25])
    handed = Some(at=lambda: None, value=None, cov=beyond)
    one = Some(cell=None, system=None, estimate=None, ratio=1.5)
    along = np.array([0.0, 0.6, -0.8])
    a = 0.6 * A[1, 0] - 0.8 * A[2, 0]
    own = [sum(a[i] * a[j] * C[p][q] for i, p in ((0, 0), (1, 2)) for j, q in ((0, 0), (1, 2)))
           for C in cov]  # fmt: skip
    told = pose_budget._of_parameters(one, handed, None, along)
    law = a[2] ** 2 * 0.5 + a[3] ** 2 * 0.25
    assert told == pytest.approx({"a": 2.25 * own[0], "law": 2.25 * own[1] + law})
    split.source = np.array(["a", "b"])
    told = pose_budget._of_parameters(one, handed, None, along)
    assert told["law"] == pytest.approx(law)
