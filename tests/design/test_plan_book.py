"""The workbook of a plan, filled in by hand as people do, and read back as log and set-up."""

import io
import json
import tomllib

import numpy as np
import openpyxl
import pytest

from pipeline.app import cli
from pipeline.base import toml
from pipeline.base.language import Language, spoken
from pipeline.design import problem
from pipeline.design import spec as specs
from pipeline.design.plan_book import book
from pipeline.design.planfile import plan_content
from pipeline.design.propose import BoundedPlan
from pipeline.design.search import evaluate
from pipeline.design.trade import feasible_poses
from pipeline.machine.robot import load
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import parse, simulate
from pipeline.store.campaign import find
from pipeline.system.fit import fit

SEED = 20261125


@pytest.fixture(scope="module")
def proposal():
    """Six poses drawn at random, two load steps each."""
    changes = {
        "name": "six",
        "plan": {"poses": 6, "readings": 12},
        "pull": {"steps_n": [4000.0, 1500.0]},
        "diagnosis": None,
    }
    spec = specs.revised(specs.parse(specs.shipped("diagnosis_reference")), changes)
    made = problem.build(spec, load(spec.robot))
    anchor = np.array([2.5, 6.0, -0.891])
    q = feasible_poses(made, anchor, np.random.default_rng(SEED), 6)
    q = np.where(made.robot.prismatic, q.round(6), np.deg2rad(np.rad2deg(q).round(6)))
    return BoundedPlan(made, evaluate(made, q[None], anchor[None])[0], None, "by chance")


@pytest.fixture(scope="module")
def measured(proposal):
    """What a virtual cell brings home: files as CSV, and the entries of campaign.toml."""
    return dict(simulate(parse(toml.dumps(plan_content(proposal)))).files)


def rows(data):
    """A table of a CSV file as dictionaries."""
    head, *lines = data.decode().splitlines()
    return [dict(zip(head.split(","), line.split(","), strict=True)) for line in lines]


def cell(page, title, row):
    """The cell of a row below a title, which stand in line 3."""
    column = next(one.column for one in page[3] if one.value == title)
    return page.cell(3 + row, column)


def by_hand(data, measured, comma, away=0.0, say=str):
    """The workbook as somebody fills it in: forces as text with a decimal comma, some as numbers.

    The second pull is left empty and has a remark; A1 of the first pose is `away` [deg].
    """
    said = tomllib.loads(measured["campaign.toml"].decode())
    filled = openpyxl.load_workbook(io.BytesIO(data))
    pulls, axes, once = filled["pulls"], filled["axes"], filled["set-up"]
    for k, one in enumerate(rows(measured["loads.csv"]), 1):
        as_text = f"{float(one['force_n']):.1f}".replace(".", ",")
        force = cell(pulls, say("Force [N]"), k)
        force.value = as_text if comma and k % 3 else round(float(one["force_n"]), 1)
    cell(pulls, say("Force [N]"), 2).value = None
    cell(pulls, say("Remark"), 2).value = "Kette gerutscht, später wiederholen"
    cell(pulls, say("Clock"), 1).value = "10:15"
    a1 = cell(axes, "A1 [deg]", 1)
    a1.value = a1.value + away
    pulls.cell(pulls.max_row + 2, 1).value = None
    typed = {
        "operator": ["Jürgen"],
        "date": ["25.11.2026"],
        "temperature_c": ["21,5" if comma else 21.5],
        "scale.sigma_n": [said["scale"]["sigma_n"]],
        "scale.serial": [4711],
    }
    for table in ("tool", "base_frame"):
        for name, at in said[table].items():
            comma_text = "; ".join(f"{x}".replace(".", ",") for x in at)
            typed[f"{table}.{name}"] = [comma_text] if comma else list(at)
    for row in once.iter_rows(min_row=4):
        for column, value in enumerate(typed.get(row[0].value, [])):
            row[3 + column].value = value
        if row[1].value == say("Weight that hangs at the load point all the time"):
            row[3].value = 12
    out = io.BytesIO()
    filled.save(out)
    return out.getvalue()


def command(capsys, *words):
    """Exit code, stdout and stderr of a command."""
    with pytest.raises(SystemExit) as ended:
        cli.main([*map(str, words)])
    return ended.value.code, *capsys.readouterr()


@pytest.mark.whole
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("comma", "language"), [(True, "en"), (False, "en"), (True, "de"), (True, "fr")]
)
def test_a_filled_in_workbook_is_the_log_of_a_campaign(
    proposal, measured, comma, language, tmp_path, monkeypatch, capsys
):
    """`init` asks nothing, `check` says the remark, and what was typed is what is used."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data" / "raw" / "hall"
    folder.mkdir(parents=True)
    say = spoken(Language(language))
    sheet = by_hand(book(proposal, say), measured, comma, say=say)
    (folder / "sheet.xlsx").write_bytes(sheet)
    (folder / "tracker.csv").write_bytes(measured["tracker.csv"])
    code, _, told = command(capsys, "init", "hall")
    assert code == 0
    assert "Still open" not in told
    settings = tomllib.loads((folder / "campaign.toml").read_text("utf-8"))
    assert settings["scale"]["file"] == settings["joints"]["file"] == "sheet.xlsx"
    assert (settings["operator"], settings["temperature_c"]) == ("Jürgen", 21.5)
    assert settings["date"].isoformat() == "2026-11-25"
    assert "12 kg" in (folder / "campaign.toml").read_text("utf-8")

    code, out, told = command(capsys, "check", "hall", "--json")
    seen = json.loads(out)
    assert code == 5  # one pull has no force
    assert "sheet.xlsx:5" in told
    assert seen["pulls"] == 11
    assert [one for one in seen["remarks"] if "Kette gerutscht" in one and "pose 1" in one]
    forces = [float(one["force_n"]) for one in rows(measured["loads.csv"])]
    del forces[1]
    assert seen["force_range_n"] == pytest.approx([min(forces), max(forces)], abs=0.06)
    assert {one["pose"] for one in seen["each_pose"]} == {1, 2, 3, 4, 5, 6}


def test_what_was_driven_otherwise_is_what_is_used(proposal, measured, tmp_path, monkeypatch):
    """An axis that was overwritten is read as overwritten, all others as planned."""
    from pipeline.readers import logs

    robot = proposal.problem.robot
    log = logs.joints("sheet.xlsx", by_hand(book(proposal), measured, True, 0.5), robot)
    off = np.rad2deg(logs.joint_values(log, robot) - proposal.measurement.q)

    assert np.abs(off[1:]).max() < 1e-5
    assert np.count_nonzero(np.abs(off[0]) > 1e-5) == 1
    assert np.abs(off[0]).max() == pytest.approx(0.5, abs=1e-5)


@pytest.mark.whole
def test_the_workbook_gives_the_answer_of_the_csv_files(proposal, measured, tmp_path):
    """The same numbers, in cells or in CSV: the same stiffnesses, to the digits that were typed."""
    found = []
    for name in ("csv", "xlsx"):
        folder = tmp_path / "data" / "raw" / name
        folder.mkdir(parents=True)
        for file, content in measured.items():
            (folder / file).write_bytes(content)
        if name == "xlsx":
            filled = openpyxl.load_workbook(io.BytesIO(book(proposal)))
            for k, one in enumerate(rows(measured["loads.csv"]), 1):
                cell(filled["pulls"], "Force [N]", k).value = float(one["force_n"])
            filled.save(folder / "sheet.xlsx")
            text = (folder / "campaign.toml").read_text("utf-8")
            for log in ("loads.csv", "joints.csv"):
                text = text.replace(f'"{log}"', '"sheet.xlsx"')
            (folder / "campaign.toml").write_text(text, "utf-8")
        case = ingested(find(tmp_path, name).read())
        found.append(fit(case, bring(case)).estimate)
    csv, xlsx = found

    assert xlsx.value == pytest.approx(csv.value, rel=1e-9)
    assert xlsx.std == pytest.approx(csv.std, rel=1e-9)


@pytest.mark.parametrize(
    ("typed", "said"),
    [("765,3 mm", "number with its unit"), ("siebenhundert", "not a number")],
)
def test_what_is_no_number_is_named_by_its_line(proposal, measured, typed, said):
    """The row is left out, and the line is the one that Excel shows."""
    from pipeline.readers import logs

    filled = openpyxl.load_workbook(io.BytesIO(by_hand(book(proposal), measured, True)))
    cell(filled["pulls"], "Force [N]", 3).value = typed
    out = io.BytesIO()
    filled.save(out)
    log = logs.loads("sheet.xlsx", out.getvalue())
    wrong = {line: reason for _, line, reason in log.rejected}

    assert said in wrong[6]
    assert len(log.line) == 10


def test_a_place_in_millimetres_and_words_that_are_none(proposal, measured):
    """The unit column may be changed; what cannot be taken is said with its line and stays open."""
    from pipeline.intake.filled import filled_in

    filled = openpyxl.load_workbook(io.BytesIO(book(proposal)))
    page = filled["set-up"]
    for row in page.iter_rows(min_row=4):
        if row[0].value == "tool.load_point":
            row[2].value, row[3].value, row[4].value, row[5].value = "mm", "150,5", 0, 250
        if row[0].value == "temperature_c":
            row[3].value, line = "warm", row[0].row
    out = io.BytesIO()
    filled.save(out)
    known, wrong = filled_in({"sheet.xlsx": out.getvalue()})

    assert known.places == {"load_point": pytest.approx((0.1505, 0.0, 0.25))}
    assert known.temperature_c is None
    assert wrong == [
        f'sheet.xlsx, line {line}: temperature_c is "warm", not a number; it stays open.'
    ]
