"""Questions across campaigns: rows as the answers have them; nothing else is read or written."""

import csv
import errno
import io
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from conftest import without_pages
from openpyxl import load_workbook

from bench.bench_query import copies, queries
from pipeline.app import cli
from pipeline.base.errors import UsageError
from pipeline.fleet import tables as fleet
from pipeline.fleet.query import ask
from pipeline.run import run
from pipeline.store.campaign import CampaignFolder, find

pytestmark = pytest.mark.whole

pytest.importorskip("duckdb", reason="pip install 'rail-stiffness[query]'")
HERE = Path(__file__).parents[2]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
NAMES = ["first", "b", "=c"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """One campaign that was computed, and two with other numbers."""
    root = tmp_path_factory.mktemp("finished")
    shutil.copytree(KEPT, root / "data" / "raw" / "first")
    campaign = find(root, "first")
    with without_pages():
        run(campaign)
    copies(campaign, NAMES[1:], np.random.default_rng(3))
    return root


@pytest.fixture
def project(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "project")


def result(root, name):
    return json.loads((root / "reports" / name / "result.json").read_bytes())


def rewritten(root, name, **changes):
    """A campaign's answer with other words, as a new run would leave it."""
    path = root / "reports" / name / "result.json"
    path.write_text(json.dumps(result(root, name) | changes), "utf-8")
    manifest = root / "data" / "processed" / name / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"key": str(changes)}))


def test_rows_are_what_the_answers_say(project):
    """Each stiffness of each campaign, each cause and each row of its own tables."""
    found = ask(project, "SELECT campaign, name, value, std, robot FROM stiffness "
                         "WHERE model = 'recommended'")  # fmt: skip
    expected = {
        (name, one["name"], one["value"], one["std"], "fanuc_r2000ic")
        for name in NAMES
        for one in result(project, name)["stiffness"]
    }

    assert set(found.rows) == expected
    assert len(found.rows) == len(expected)
    causes = [c for c in result(project, "b")["diagnosis"]["causes"] for _ in c["parameters"]]
    said = ask(project, "SELECT name, probability FROM causes WHERE campaign = 'b' ORDER BY rank")
    assert said.rows == [(one["name"], one["probability"]) for one in causes]
    for table, file in (("residuals", "42_residuals"), ("reliability", "43_reliability")):
        own = pq.read_table(project / "data" / "processed" / "b" / f"{file}.parquet")
        ((rows,),) = ask(project, f"SELECT count(*) FROM {table} WHERE campaign = 'b'").rows
        assert rows == own.num_rows > 0


def told(root):
    return ask(root, "SELECT campaign, says, robot FROM campaigns ORDER BY campaign").rows


def parts(root):
    return {p: p.stat().st_mtime_ns for p in fleet.folder(root).rglob("*") if p.is_file()}


def test_tables_follow_the_answers(project):
    """A new answer takes the place of the old one, also of another robot; a removed one goes."""
    before = told(project)
    written = parts(project)
    assert told(project) == before
    assert parts(project) == written, "nothing has changed, and something was written"

    rewritten(project, "b", verdict_sentence=["Measured anew."], robot="kr500_rail")
    shutil.rmtree(project / "reports" / "=c")

    assert told(project) == [
        ("b", "Measured anew.", "kr500_rail"),
        next(row for row in before if row[0] == "first"),
    ]
    shutil.rmtree(project / "reports" / "first")
    assert [row[0] for row in told(project)] == ["b"]
    assert not list(fleet.folder(project).rglob("robot=fanuc_r2000ic/*"))
    shutil.rmtree(project / "reports")
    with pytest.raises(UsageError, match="no campaign is finished"):
        told(project)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("lost", ["index.json", "stiffness", "."])
def test_what_a_killed_run_or_somebody_took_away_is_made_again(lost, project):
    """With each row once."""
    question = "SELECT * FROM stiffness ORDER BY ALL"
    before = ask(project, question)
    path = fleet.folder(project) / lost
    shutil.rmtree(path) if path.is_dir() else path.unlink()

    assert ask(project, question) == before


@pytest.mark.sampled(1)
@pytest.mark.parametrize("damage", ["cut", "noise", "inside"])
@pytest.mark.parametrize("table", ["stiffness", "wear"])
def test_a_damaged_table_is_made_again(damage, table, project, capsys):
    """And said, where that shows only when it is asked; the others are answered as ever."""
    questions = [f"SELECT * FROM {name} ORDER BY ALL" for name in ("campaigns", "stiffness")]
    before = [ask(project, one) for one in questions]
    path = next((fleet.folder(project) / table).glob("*/*.parquet"))
    data = path.read_bytes()
    spoilt = {"cut": data[:-30], "noise": b"x" * 99, "inside": b"PAR1" + b"x" * 99 + b"PAR1"}
    path.write_bytes(spoilt[damage])

    assert [ask(project, one) for one in questions] == before
    if damage == "inside" and table == "stiffness":
        assert "could not be read and was made again" in capsys.readouterr().err


def test_a_damaged_table_that_cannot_be_made_again_costs_itself_alone(project, monkeypatch, capsys):
    """On a disk that is only read: a sentence for it, answers from the others."""
    told(project)
    path = next((fleet.folder(project) / "stiffness").glob("*/*.parquet"))
    path.write_bytes(b"PAR1" + b"x" * 99 + b"PAR1")

    def refuse(*_, **__):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "unlink", refuse)
    words = ["--root", str(project)]

    assert cli._exit_code(["query", "SELECT name FROM stiffness", *words]) == 3
    assert str(path) in capsys.readouterr().err
    assert cli._exit_code(["query", "SELECT campaign FROM campaigns", *words]) == 0


def worn(root):
    """The three campaigns half a year apart, the second joint's compliance growing by a third."""
    for k, name in enumerate(NAMES):
        stiffness = result(root, name)["stiffness"]
        stiffness[1]["compliance"] *= 1 + k / 3
        said = {"history": [{"date": "2026-06-01", "joints": [2], "what": "gearbox"}]}
        unit = {"serial": "17", "certificate": None, "calibrated": None} | (said if k > 2 else {})
        day = f"2026-0{1 + 3 * k}-05"
        rewritten(root, name, measured=day, stiffness=stiffness, robot_unit=unit)


def test_wear_is_made_of_the_answers(project):
    """Of dated campaigns of one machine, with the covariance that their runs kept."""
    worn(project)
    rows = ask(project, "SELECT robot_serial, name, campaigns, percent_a_year, std, scatter_stated "
                        "FROM wear ORDER BY joint").rows  # fmt: skip
    said = {name: {j["name"]: j for j in result(project, name)["stiffness"]} for name in NAMES}

    assert [row[:3] for row in rows] == [("17", f"k_theta{k}", 3) for k in range(1, 7)]
    relative = said["first"]["k_theta2"]["compliance_std"] / said["b"]["k_theta2"]["compliance"]
    assert rows[1][3] == pytest.approx(-101, abs=8)  # a third a quarter, over the mean of 4/3
    assert rows[1][4] > 100 * relative
    assert rows[5][3] is None, "joint 6 is not determined"
    (one,) = fleet.wear(project)
    assert (one.machine, one.campaign, one.followed) == (
        "fanuc_r2000ic, serial number 17", "=c", True)  # fmt: skip


@pytest.mark.slow
def test_a_run_writes_its_rows(tmp_path):
    """The command `run`, before anybody asks; a partition of the robot, for other programs."""
    shutil.copytree(KEPT, tmp_path / "data" / "raw" / "a")

    assert cli._exit_code(["run", "--engine", "local", "--root", str(tmp_path)]) == 0

    table = pq.read_table(fleet.folder(tmp_path) / "campaigns")
    assert table.column("campaign").to_pylist() == ["a"]
    assert table.column("robot").to_pylist() == ["fanuc_r2000ic"]


def test_tables_that_cannot_be_written_stop_no_run(project, capsys):
    """A file is in their place: `run` is done as ever, a query says what is in the way."""
    shutil.rmtree(fleet.folder(project), ignore_errors=True)
    fleet.folder(project).write_bytes(b"")

    code = cli._exit_code(["run", "first", "--engine", "local", "--root", str(project)])
    assert code == 0
    assert cli._exit_code(["query", "FROM campaigns", "--root", str(project)]) == 3
    assert "move it out of the way" in capsys.readouterr().err


def test_a_project_that_is_read_only_is_asked_all_the_same(project, monkeypatch):
    """Where nothing has changed nothing is locked; where it has, rows are those of the last run."""
    before = told(project)

    def refuse(*_, **__):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(fleet, "FileLock", refuse)
    assert told(project) == before
    rewritten(project, "b", verdict_sentence=["Measured anew."])
    assert told(project) == before


@pytest.mark.parametrize("query", queries(), ids=range(len(queries())))
def test_the_questions_of_the_guide_are_answered(query, finished):
    """Letter for letter as they stand there; those that this campaign can answer have rows."""
    found = ask(finished, query)

    asks_adequate = "'adequate'" in query or "nominal - value" in query
    asks_dated = "FROM wear" in query
    assert found.rows or asks_adequate or asks_dated


def test_the_guide_has_every_column():
    """With unit and meaning; ten questions at least."""
    text = (HERE / "docs" / "query.md").read_text("utf-8")

    assert len(queries()) >= 10
    for name, promise in fleet.VIEWS.items():
        section = re.search(rf"^### `{name}`.*?\n\n(.*?)(?=^###|\Z)", text, re.S | re.M)[1]
        _, _, *rows = section.strip().splitlines()
        assert rows == [
            f"| `{f.name}` | {f.metadata[b'unit'].decode()} | {f.metadata[b'meaning'].decode()} |"
            for f in promise
        ]


@pytest.mark.parametrize(
    "query",
    [
        "COPY campaigns TO '{}/x.csv'",
        "COPY campaigns TO '{}/data/processed/fleet/x.csv'",
        "ATTACH '{}/x.db'",
        "CREATE TABLE a AS SELECT 1",
        "SET enable_external_access = true",
        "SELECT 1; SELECT 2",
        "EXPLAIN ANALYZE COPY campaigns TO '{}/x.csv'",
        "SELECT * FROM read_text('{}/data/raw/first/campaign.toml')",
        "SELECT * FROM '{}/data/processed/first/42_residuals.parquet'",
        "SELECT * FROM read_text('{}/data/processed/fleet/../first/manifest.json')",
        "SELECT * FROM glob('/etc/*')",
        "SELECT * FROM fleet",
        "INSTALL httpfs",
        "SELECT no_such_column FROM campaigns",
        "SELEC 1",
        "",
    ],
)
def test_what_is_no_question_changes_nothing(query, project, capsys):
    """One sentence and exit code 2; no file is read or written beside the tables."""
    fleet.refresh(project)
    before = parts(project)

    code = cli._exit_code(["query", query.format(project), "--root", str(project)])

    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert "docs/query.md" in err
    assert parts(project) == before
    assert not list(project.glob("x.*"))


def test_formats_hold_the_same_values(finished, tmp_path, capsys):
    """All digits in CSV, JSON and a workbook; a name that begins with = is no formula there."""
    question = "SELECT campaign, joint, value, identifiable FROM stiffness ORDER BY ALL"
    rows = [list(row) for row in ask(finished, question).rows]
    files = {form: tmp_path / f"x.{form}" for form in ("csv", "json", "xlsx")}
    for path in files.values():
        words = ["query", question, "--output", str(path), "--root", str(finished)]
        assert cli._exit_code(words) == 0
    assert cli._exit_code(["query", question, "--root", str(finished)]) == 0

    printed = capsys.readouterr().out
    head, *lines = csv.reader(io.StringIO(files["csv"].read_text("utf-8")))
    assert head == ["campaign", "joint", "value", "identifiable"]
    texts = [[f"'{c}" if c.startswith("=") else c, *others] for c, *others in rows]
    assert [[c, int(j), float(v) if v else None, i == "True"] for c, j, v, i in lines] == texts
    assert texts != rows
    assert printed.endswith(files["csv"].read_text("utf-8"))
    assert [list(one.values()) for one in json.loads(files["json"].read_bytes())] == rows
    sheet = load_workbook(files["xlsx"]).active
    for ours, theirs in zip(rows, sheet.iter_rows(2, values_only=True), strict=True):
        assert theirs == pytest.approx(ours, rel=1e-14)  # a workbook has sixteen digits
    assert {cell.data_type for cell in sheet["A"]} == {"s"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--format", "yaml"], "use table, csv, json, xlsx"),
        (["--output", "x.yaml"], "use table, csv, json, xlsx"),
        (["--format", "xlsx"], "add --output FILE.xlsx"),
    ],
)
def test_a_format_that_is_none_is_told(words, said, finished, capsys):
    """Exit code 2, before anything is asked."""
    code = cli._exit_code(["query", "FROM campaigns", *words, "--root", str(finished)])

    assert code == 2
    assert said in capsys.readouterr().err


def test_a_table_is_for_people(finished, capsys):
    """Each row in a line, numbers in four digits, a name's odd signs escaped."""
    question = "SELECT chr(27) || campaign AS odd, 1234567e0 AS n FROM campaigns ORDER BY ALL"
    words = ["query", question, "--format", "table", "--root", str(finished)]

    assert cli._exit_code(words) == 0

    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines == [["odd", "n"], *([rf"\x1b{name}", "1.235e+06"] for name in sorted(NAMES))]


def test_a_campaign_has_another_name_than_our_folder(tmp_path):
    """`fleet` is where the tables are."""
    assert CampaignFolder(tmp_path, tmp_path / "data" / "raw" / "fleet")._unfit is not None


def test_nothing_is_put_aside_into_the_current_folder(project):
    """DuckDB would take `.tmp` there, which may be somebody's link to elsewhere."""
    assert ask(project, "SELECT current_setting('temp_directory')").rows == [("",)]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("damage", [b"", b"PAR1" + b"x" * 99 + b"PAR1"])
@pytest.mark.parametrize("table", ["41_covariance", "43_reliability"])
def test_a_damaged_table_of_a_campaign_costs_its_rows_alone(damage, table, project, capsys):
    """The rest of the campaign is answered, and a line says how to have it again."""
    name = NAMES[0]
    rewritten(project, name)
    before = ask(project, "SELECT * FROM stiffness ORDER BY ALL")
    rewritten(project, name, title="again")
    (project / "data" / "processed" / name / f"{table}.parquet").write_bytes(damage)
    capsys.readouterr()

    assert ask(project, "SELECT * FROM stiffness ORDER BY ALL") == before
    assert f"run 'pipeline run {name} --force'" in capsys.readouterr().err
