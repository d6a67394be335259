"""No number leaves as NaN: blunders by factors, too few poses, rows that say nothing.

Each ends in an answer that JSON can hold and a report, or in one sentence.
"""

import pytest

from pipeline.report.render import render
from pipeline.run import answered
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import dump, in_memory

STATED = Plan(name="kr", seed=3, poses={"count": 6}, pulls={"steps_n": [1500.0, 3000.0]})
UNSTATED = Plan(
    name="kr", seed=5, poses={"count": 8}, pulls={"steps_n": [1500.0]}, tracker={"stated": False}
)


@pytest.fixture(scope="module")
def files():
    """Raw files of each plan, made once."""
    return {id(plan): simulate(plan).files for plan in (STATED, UNSTATED)}


def scaled(content, factor, column, row=None):
    """Numbers of a column, or of one row of it, by a factor."""
    lines = content.decode().splitlines()
    at = lines[0].split(",").index(column)
    for k in range(1, len(lines)) if row is None else [row]:
        cells = lines[k].split(",")
        cells[at] = repr(float(cells[at]) * factor)
        lines[k] = ",".join(cells)
    return ("\n".join(lines) + "\n").encode()


def answer(raw):
    """The answer, through JSON and the report, as a run writes them."""
    found = answered("c", in_memory(raw))
    assert b"NaN" not in dump(found.answer.as_json())
    return found


@pytest.mark.parametrize(
    ("plan", "file", "column", "row", "cause"),
    [
        (UNSTATED, "tracker.csv", "x_mm", 21, "outlier"),
        (UNSTATED, "loads.csv", "force_n", 4, "outlier"),
        (UNSTATED, "loads.csv", "force_n", None, "unit_mixup"),
        (STATED, "loads.csv", "force_n", 3, "outlier"),
    ],
    ids=["reading", "force", "forces", "force beside stated noise"],
)
def test_a_number_by_a_thousand_is_found(files, plan, file, column, row, cause):
    """One reading, one force or all of them: named, and the values are the robot's again."""
    raw = files[id(plan)]
    found = answer({**raw, file: scaled(raw[file], 1e3, column, row)}).answer

    assert cause in [one.name for one in found.diagnosis.causes]
    known = [one for one in found.stiffness if one.value and one.identifiable]
    assert len(known) >= 5
    assert all(0.3 < one.value / one.nominal < 3 for one in known)


def test_millimetres_read_as_metres_end_in_a_report(files):
    """The commonest blunder of all: a finding, a verdict, page and PDF."""
    raw = files[id(UNSTATED)]
    metres = raw["tracker.csv"].replace(b"_mm", b"_m")
    found = answer({**raw, "tracker.csv": metres})
    pages = render(found.answer, found.shown, 1.0, None)

    assert found.answer.diagnosis.verdict == "bad_data"
    assert {"index.html", "report.pdf"} <= {*pages}
    assert b"nan" not in pages["index.html"].split(b"<svg")[0]
