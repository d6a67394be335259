"""A certificate in German and French: all of its first page, numbers as they are read there."""

import dataclasses
import re
from functools import partial

import pytest
import report_sample
from conftest import without_drawings
from english import ENGLISH
from pdf_text import pages_of

from pipeline.answer.words import DO
from pipeline.base.appearance import Appearance
from pipeline.base.language import spoken
from pipeline.diagnosis.finding import Verdict
from pipeline.report.certificate import certificate, digest
from pipeline.report.model import compose
from pipeline.report.render import render

pytestmark = pytest.mark.xdist_group("report")  # the sample is drawn once for all

OTHERS = ("de", "fr")


def words(record):
    """Every text of a record that somebody reads."""
    if isinstance(record, str):
        yield record
    elif isinstance(record, tuple):
        for one in record:
            yield from words(one)
    elif dataclasses.is_dataclass(record):
        for one in dataclasses.fields(record):
            if one.name not in ("kind", "name", "digest", "language", "tone"):
                yield from words(getattr(record, one.name))


def state(content, verdict, reason, decision):
    """Another verdict, reason and decision."""
    content["diagnosis"]["verdict"] = str(verdict)
    content["recommended"]["reason"] = str(reason)
    content["tolerance"]["test_pose"] = decision


DECISIONS = ("pass", "fail", "undecided")
CASES = [
    (verdict, reason, DECISIONS[(i + j) % 3])
    for i, verdict in enumerate(Verdict)
    for j, reason in enumerate(DO)
]
"""Every two of verdict, reason and decision together."""


@pytest.mark.whole
@pytest.mark.parametrize("language", OTHERS)
def test_nothing_of_it_stays_english(language):
    """Whatever is found, decided and to be done, but for the name of the campaign."""
    answer, say = report_sample.answer(), spoken(language)
    tables = {"posture": report_sample.tables()["posture"]}
    left = set()
    for verdict, reason, decision in CASES:
        asked = partial(state, verdict=verdict, reason=reason, decision=decision)
        content = certificate(report_sample.revised(answer, asked), tables, say)
        left |= {one for one in words(content) if ENGLISH.search(one)}

    assert left == {answer.name}


@pytest.mark.parametrize("language", OTHERS)
def test_headings_are_said_too(language):
    """Title, verdicts and the words of the page."""
    report = compose(report_sample.answer(), {}, look=Appearance(language))
    shown = (report.kicker, report.title, report.verdict, report.judged, report.frame)

    assert [one for one in words(shown) if ENGLISH.search(one)] == []


@pytest.fixture(scope="module")
def made():
    """A report in each language."""
    answer, tables = report_sample.answer(), report_sample.tables()
    german = render(answer, tables, look=Appearance("de"))
    with without_drawings():  # those of German are compared
        french = render(answer, tables, look=Appearance("fr"))
    return {"en": report_sample.rendered(), "de": german, "fr": french}


@pytest.mark.whole
@pytest.mark.parametrize("language", OTHERS)
def test_page_and_paper_are_in_that_language(made, language):
    """Both say so to who has them read aloud; the annexes say that they are in English."""
    page, first = (
        made[language]["index.html"].decode(),
        pages_of(made[language]["report.pdf"])[0],
    )
    english = pages_of(made["en"]["report.pdf"])[0]
    heading = {"de": "Steifigkeit ± U", "fr": "Rigidité ± U"}[language]

    assert f'<html lang="{language}">' in page
    assert '<main id="content" lang="en">' in page
    assert heading in " ".join(first.split())
    assert digest(report_sample.answer()) in first  # of the same answer
    numbers = [re.sub(r"(?<=\d),(?=\d)", ".", one) for one in re.findall(r"\d[\d.,]*\d", first)]
    assert sorted(numbers) == sorted(re.findall(r"\d[\d.,]*\d", english))
    assert not re.search(r"\d\.\d+ ± ", first)


@pytest.mark.whole
def test_only_the_figures_of_the_certificate_are_said(made):
    """Its words, also those that a pointer shows; the annexes' stay as they are."""
    german, english = ({n: f for n, f in made[one].items() if "/" in n} for one in ("de", "en"))
    other = {name for name in english if english[name] != german[name]}
    said = re.findall(r'data-tip="([^"]*)"', german["figures/certificate.svg"].decode())

    assert other == {"figures/certificate.svg", "figures/gauge.svg"}
    assert said
    assert [one for one in said if ENGLISH.search(one)] == []
