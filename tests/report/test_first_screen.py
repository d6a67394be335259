"""Lines of the first screen and the block that a report is filed by, from records alone."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
import report_sample
from pdf_text import pages_of

from pipeline.annex.text import as_text
from pipeline.report.figures.catalogue import draw
from pipeline.report.model import compose
from pipeline.report.record import Figure
from pipeline.report.render import page, pdf
from pipeline.report.words import VERDICTS


def without_figures(report):
    """What a report says in words and tables."""
    parts = [
        replace(part, blocks=tuple(one for one in part.blocks if not isinstance(one, Figure)))
        for part in report.sections
    ]
    plain = replace(report.certificate, picture=None, gauge=None)
    return replace(report, sections=tuple(parts), certificate=plain)


@pytest.mark.parametrize(
    ("decision", "verdict", "word", "worst"),
    [
        ("pass", "adequate", "Deflection within tolerance", "good"),
        ("pass", "explained", "Deflection within tolerance", "attention"),
        ("pass", "unexplained", "Deflection within tolerance only if the model below holds", "bad"),
        ("undecided", "adequate", "Conformity with the tolerance undecided", "attention"),
        ("fail", "adequate", "Deflection out of tolerance", "bad"),
        (None, "adequate", None, "good"),
    ],
)
def test_whether_it_may_machine_is_said_first_and_no_colour_promises_more(
    decision, verdict, word, worst
):
    """A tolerance that is not kept stands above the verdict, under no green."""
    asked = decision and {"deflection_mm": 0.25, "test_pose": decision, "path": None}

    def state(content):
        content["tolerance"] = asked
        content["diagnosis"]["verdict"] = verdict
        about = ("tolerance", "At most 0.25 mm"), ("verdict", "The model."), ("to_do", "Do.")
        content["first_screen"] = [{"about": a, "text": t} for a, t in about]

    answer = report_sample.revised(report_sample.answer(), state)
    whole = compose(answer, {})
    report = replace(without_figures(whole), certificate=replace(whole.certificate, picture=None))
    html = page(report, {"gauge": draw("gauge", answer, {}).inline})
    text = as_text(report)
    box = re.search(r'<section class="verdict (\w+)".*?</section>', html, re.DOTALL)

    assert box is not None
    assert (report.judged and report.judged.word) == word
    assert box[1] == report.worst == worst
    said = re.findall(r'<p class="word">(.*?)</p>', box[0])
    assert said == [*([word] if word else []), VERDICTS[verdict][0]]
    assert decision is None or "tolerance 0.25 mm" in box[0]
    assert word is None or text.index(word) < text.index(VERDICTS[verdict][0])


def test_what_to_type_is_shown_as_such_and_a_name_as_it_is():
    """Page and PDF set it as code, the terminal quotes it; no mark of ours is left."""
    said = "Correct it with `pipeline compensate spring`, not with `rm` of part`s.csv."

    def state(content):
        content["first_screen"] = [{"about": "to_do", "text": said}]
        content["diagnosis"]["why"] = said

    answer = report_sample.revised(report_sample.answer(), state)
    report = without_figures(compose(answer, {}))
    html, text = page(report, {}), as_text(report)
    spoken = "".join(pages_of(pdf(report, {})))

    assert html.count("<code>pipeline compensate spring</code>, not with `rm`") == 2
    assert text.count("'pipeline compensate spring', not with `rm`") == 2
    assert "`pipeline" not in spoken
    assert spoken.count("pipeline compensate spring") == 2
    assert spoken.count("`rm`") == 2


def test_the_report_says_what_it_is_filed_by():
    """Dates, serial numbers and counts as stated; what nobody stated, in one row."""
    report = compose(report_sample.answer(), {})
    (of,) = [one for one in report.sections if one.key == "identity"]
    told = {row[0].text: row[1].text for row in of.blocks[0].rows}

    assert told["Measured"] == "2026-11-03 08:00 to 10:31"
    assert "Operator" not in told
    assert told["Scale"] == "serial number S-17, calibrated 2026-03-01"
    assert told["Not stated"].startswith("the operator; ")
    assert "certificate of the scale" in told["Not stated"]
    assert "date" not in told["Not stated"].split("; ")
    assert told["Poses and pulls"] == "16 poses, 48 pulls of 1000 N to 3000 N"
    assert told["Temperature of rail and base"] == "21.5 °C"
    assert told["Software"] == "pipeline 1.0.0"
