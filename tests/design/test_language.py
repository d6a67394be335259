"""The measurement sheet in German and French: nothing of it stays English, nothing is lost."""

import dataclasses
import re

import numpy as np
import pytest
from english import ENGLISH

from pipeline.base.language import Language, spoken, translated
from pipeline.design import spec as specs
from pipeline.design.control import controls
from pipeline.design.library import problem_of
from pipeline.design.plan_files import plan_files
from pipeline.design.plan_sheet import SheetExtras, sheet
from pipeline.design.propose import BoundedPlan
from pipeline.design.search import evaluate
from pipeline.design.trade import feasible_poses
from pipeline.design.unpulled import Unpulled

OTHERS = [Language.DE, Language.FR]


def drawn(name, changes):
    """A proposal of poses that keep the limits; not the best ones."""
    made = problem_of(name, changes)
    anchor = (made.anchor_lower + made.anchor_upper) / 2
    q = feasible_poses(made, anchor, np.random.default_rng(3), made.poses)
    plan = evaluate(made, q[None], anchor[None])[0]
    more = Unpulled(q[:1], 0.4, 0.9, 0.3, 600)
    return BoundedPlan(made, plan, None, "by chance", unpulled=more)


@pytest.fixture(scope="module", params=[("paper_reference", {}), ("paper_cell", {}),
                                        ("paper_reference", {"robot": "ur10e"})])  # fmt: skip
def report(request):
    """A sheet in English."""
    made = drawn(*request.param)
    return sheet(
        made, SheetExtras(made.sights(), controls=controls(made.problem, made.measurement)), 1.0
    )


def words(record, code=False):
    """Every text of a report that somebody reads."""
    if isinstance(record, str):
        yield record
    elif isinstance(record, tuple):
        for one in record:
            yield from words(one)
    elif dataclasses.is_dataclass(record):
        for one in dataclasses.fields(record):
            if one.name not in ("kind", "name", "key", "tone", "sort", "link", "language"):
                yield from words(getattr(record, one.name))


def prose(report):
    """What of it is ours to say: all but the assumptions, which are the user's and the robot's."""
    kept = tuple(one for one in report.sections if one.key != "assumptions")
    return words(dataclasses.replace(report, sections=kept))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("language", OTHERS)
def test_nothing_stays_english(report, language):
    """But names, and the sources that a robot file states."""
    say = spoken(language)
    source = problem_of("paper_cell", {}).robot.capsules.source
    left = {
        one for one in prose(translated(report, say)) if ENGLISH.search(one.replace(source, ""))
    }

    assert left == set()


@pytest.mark.parametrize("language", OTHERS)
def test_no_number_is_lost(report, language):
    """Every number of a text stands in its translation, and no other."""
    say = spoken(language)
    fixed = re.compile(r"4\.6|4,6|0\.1 %|0,1 %")
    for one in prose(report):
        there = re.sub(r"(?<=\d),(?=\d)", ".", fixed.sub("", say(one)))
        numbers = [re.findall(r"\d+(?:\.\d+)?", text) for text in (fixed.sub("", one), there)]
        assert sorted(numbers[0]) == sorted(numbers[1]), one


def test_names_and_what_people_wrote_stay():
    """A reflector called `chain` in a sentence is a name; an unknown sentence is nobody's."""
    say = spoken(Language.DE)

    assert say("Hall 7, south wall") == "Hall 7, south wall"
    assert say("pose01_rep1_loaded") == "pose01_rep1_loaded"
    assert say("Reflector P1, flange frame [m]") == "Reflektor P1, Flanschsystem [m]"
    assert spoken(Language.EN)("Set up") == "Set up"


@pytest.mark.whole
def test_every_file_of_a_sheet_is_in_its_language():
    """Page and paper say so, pictures and workbook too."""
    changes = {"plan": {"poses": 2, "readings": 4}, "anchor": {"x_m": 2.5}}
    made = drawn("paper_reference", changes)
    files = plan_files(dataclasses.replace(made, unpulled=None), 1.0, 1, Language.DE)
    page = files["sheet.html"].decode()

    assert '<html lang="de">' in page
    assert "Vor der nächsten Stellung die Kette lösen" in page
    assert files["sheet.pdf"].startswith(b"%PDF")
    assert b"Anker" in files["figures/pose-1.svg"] or b"Boden" in files["figures/pose-1.svg"]
    assert specs.SHIPPED
