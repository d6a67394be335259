"""The examples in the guides work, letter for letter, with the package."""

import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import get_args

import pytest
import report_sample
from pydantic import BaseModel

from pipeline import faults, readers
from pipeline.app.commands import COMMANDS
from pipeline.faults import screen
from pipeline.machine.robot import load
from pipeline.programs.languages import LANGUAGES
from pipeline.readers import ExportSettings
from pipeline.readers._layout import Field
from pipeline.reduction.settings import Settings
from pipeline.report import words
from pipeline.report.figures import catalogue
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, blunders, revised, simulate
from pipeline.store.campaign import in_memory

READERS = readers.catalogue()

ROOT = Path(__file__).parents[1]
GUIDES = ("CONTRIBUTING.md", "docs/add-an-effect.md", "docs/add-a-reader.md", "docs/add-a-robot.md")
NEW = {"late_pull.py", "loads.py", "station_scan.py"}  # examples of the guides
FOREIGN = {"runpy.py", "three.js"}
PLAN = revised(
    Plan(name="late", seed=11),
    {
        "poses": {"count": 8},
        "pulls": {"steps_n": [1500.0, 3000.0]},
        "hidden": {"effects": ["late_pull:pose05_rep2_loaded"]},
    },
)


def block(guide, start):
    """The example of a guide that starts with this text."""
    text = (ROOT / guide).read_text("utf-8")
    shown = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    (found,) = [code for code in shown if code.startswith(start)]
    return found


def module(code, **known):
    """The module made by this code, in addition to names known there."""
    made = ModuleType("shown")
    vars(made).update(known)
    exec(compile(code, "guide", "exec"), vars(made))
    return made


@pytest.fixture
def late_files(monkeypatch):
    """A campaign with the blunder of the guide, recorded where the guide says."""
    head = "from datetime import timedelta\n\n"
    made = module(head + block("CONTRIBUTING.md", "def _late_pull"), **vars(blunders))
    one = eval(block("CONTRIBUTING.md", "_Blunder("), vars(made))
    monkeypatch.setitem(blunders.BLUNDERS, one.name, one)
    return simulate(PLAN).files


def verdict_of(files):
    """Verdict of a campaign, and findings with their places."""
    said = campaign_answer("late", in_memory(files)).answer.diagnosis
    return said.verdict, [(cause.name, cause.where) for cause in said.causes]


@pytest.mark.slow
def test_the_mistake_of_the_guide_is_found_by_its_fault_alone(late_files, monkeypatch):
    """Without the new fault nothing is found; with it the data are bad, by name and place."""
    new = module(block("CONTRIBUTING.md", '"""A pull that was read')).FAULT
    others = tuple(fault for fault in faults.FAULTS if fault.name != new.name)
    monkeypatch.setattr(screen, "FAULTS", others)
    assert verdict_of(late_files) == ("adequate", [])

    monkeypatch.setattr(screen, "FAULTS", (new, *others))
    assert verdict_of(late_files) == ("bad_data", [("late_pull", "pose05_rep2_loaded")])


def test_the_figure_of_the_guide_is_drawn(monkeypatch):
    """Caption, alternative text and drawing of the example from a campaign's tables."""
    loads = module(block("CONTRIBUTING.md", '"""The forces of a campaign'))
    monkeypatch.setitem(catalogue._PLOTS, "loads", loads.LOADS)
    answer, tables = report_sample.answer(), report_sample.tables()

    (figure,) = catalogue.figures(["loads"], answer, tables)
    svg = catalogue.draw("loads", answer, tables).svg

    assert figure.name == "loads"
    assert figure.caption.startswith("The largest force is ")
    assert len(figure.alt) > 60
    assert "Pull, in the order of the campaign" in svg
    assert catalogue.figures(["loads"], answer, {}) == []


SCAN = "! station scan\npose01_rep0_unloaded;P1;4685.06;5282.14;-550.22\n"


def test_the_reader_of_the_guide_reads(monkeypatch):
    """In the catalogue it recognises its own file, and no other reader does."""
    scan = module(block("docs/add-a-reader.md", '"""Station scan'))
    monkeypatch.setitem(READERS, "station_scan", scan.READER)

    export = readers.read("scan.txt", SCAN.encode())

    assert export.dialect == "station scan"
    assert export.target.to_pylist() == ["P1"]
    assert export.position.tolist() == [[4.68506, 5.28214, -0.55022]]


def test_the_reader_of_the_guide_reads_times(monkeypatch):
    """With a column of times and the layout shown in the guide."""
    scan = module(block("docs/add-a-reader.md", '"""Station scan'))
    fields = (*scan._FIELDS, Field("time", "time", needed=False))
    monkeypatch.setattr(scan, "_FIELDS", fields)
    layout = eval(
        block("docs/add-a-reader.md", "Layout("), vars(scan) | {"hints": ExportSettings()}
    )
    text = readers.text("scan.txt", SCAN.replace("22\n", "22;03.11.2026 08:00:48\n").encode())

    rows = scan.rows(text, layout)

    assert str(rows.columns["time"][0]) == "2026-11-03 08:00:48"


def test_the_twins_of_the_guide_are_those_of_the_robot(capsys):
    """The question in the guide of effects is answered."""
    asked = module(block("docs/add-an-effect.md", "from pipeline.diagnosis.isolability"))

    assert capsys.readouterr().out == f"{asked.twins(load('kr500_rail'))}\n"


@pytest.mark.parametrize(
    ("guide", "start", "file"),
    [
        ("CONTRIBUTING.md", '"""A pull that was read', "pipeline/faults/late_pull.py"),
        ("CONTRIBUTING.md", '"""The forces of a campaign', "pipeline/annex/figures/loads.py"),
        ("docs/add-a-reader.md", '"""Station scan', "pipeline/dialects/station_scan.py"),
    ],
)
def test_a_file_of_the_guides_is_as_tidy_as_those_of_the_package(guide, start, file):
    """A copied file passes all checks unchanged."""
    for asked in (("check", "--quiet"), ("format", "--check", "--quiet")):
        command = [sys.executable, "-m", "ruff", *asked, "--no-cache", "--stdin-filename", file]
        said = subprocess.run(
            [*command, "-"], input=block(guide, start), cwd=ROOT, capture_output=True, text=True
        )
        assert said.returncode == 0, said.stdout + said.stderr


PAGES = ("CONTRIBUTING.md", "README.md", *sorted(
    page.relative_to(ROOT).as_posix() for page in (ROOT / "docs").rglob("*.md")
))  # fmt: skip


@pytest.fixture(scope="module")
def repository():
    """Every file of the repository, from its top."""
    folders = ("bench", "data", "docs", "pipeline", "tests")
    there = [*ROOT.glob("*.*"), *(path for one in folders for path in (ROOT / one).rglob("*.*"))]
    return [path.relative_to(ROOT).as_posix() for path in there]


@pytest.mark.parametrize("page", PAGES)
def test_every_source_file_that_a_page_names_exists(page, repository):
    """No page names a module or test that was moved."""
    text = (ROOT / page).read_text("utf-8")
    named = set(re.findall(r"[`(= ]((?:[a-z_]+/)*[a-z_0-9]+\.(?:py|js))\b", text))

    lost = {
        name for name in named if not any(f"/{path}".endswith(f"/{name}") for path in repository)
    }

    assert {name for name in lost if name.rpartition("/")[2] not in NEW | FOREIGN} == set()


OF_A_FILE = re.compile(r"(`\w+`(?:(?:, | and | or )`\w+`){0,6}) (?:of|in) `((?:\w+/)*\w+\.py)`")
"""Names that a page says to be in a file."""


@pytest.mark.parametrize(
    "page", ["CONTRIBUTING.md", "docs/add-a-reader.md", "docs/add-an-effect.md"]
)
def test_a_name_that_a_guide_looks_up_is_in_its_file(page, repository):
    """`FAULTS` of `faults/__init__.py` is where the guide says."""
    named = OF_A_FILE.findall((ROOT / page).read_text("utf-8"))
    lost = [
        (name, file)
        for names, file in named
        for name in re.findall(r"\w+", names)
        if not any(
            re.search(rf"\b{name}\b", (ROOT / path).read_text("utf-8"))
            for path in repository
            if f"/{path}".endswith(f"/{file}")
        )
    ]

    assert named
    assert lost == []


NAMING = [path.name for path in sorted((ROOT / "pipeline/faults").glob("*.py"))
          if re.search(r'\bname="', path.read_text("utf-8"))]  # fmt: skip
"""Files that name mistakes in the data."""


def keys_of(model, table=""):
    """Every key of campaign.toml with the last word of its table, as a person writes both."""
    for name, field in model.model_fields.items():
        alias = field.validation_alias
        written = alias if isinstance(alias, str) else name if alias is None else alias.choices[0]
        last = written.rpartition(".")[2]  # tool.acceptance is a table in [tool]
        yield table, last
        for inner in records_in(field.annotation):
            yield from keys_of(inner, last)


def records_in(annotation):
    """The tables that a field may hold, alone, in a list or by name."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from records_in(inner)


def test_every_key_of_a_campaign_is_on_the_page():
    """In a line of docs/campaign.md that has its table, too."""
    page = (ROOT / "docs/campaign.md").read_text("utf-8")
    code = [
        {*re.findall(r"\w+", "".join(re.findall(r"`[^`]+`", line)))} for line in page.split("\n")
    ]
    keys = [*keys_of(Settings)]

    assert len(keys) > 100
    assert [key for key in keys if not any({*key} - {""} <= line for line in code)] == []


LISTED = {
    "README.md": [f"pipeline {name}" for name in COMMANDS],
    "docs/causes.md": [f"`{name}`" for name in (*words.nouns(), *NAMING)],
    "docs/simulate.md": [f"`{name}[:" for name in blunders.BLUNDERS],
    "docs/hand-over.md": [f"`{suffix}`" for one in LANGUAGES for suffix in one.SUFFIXES],
}


@pytest.mark.parametrize("page", LISTED)
def test_a_page_lists_all_that_there_is(page):
    """No command, cause, blunder or language of programs is added without its line."""
    text = (ROOT / page).read_text("utf-8")

    assert [one for one in LISTED[page] if one not in text] == []
