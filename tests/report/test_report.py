from __future__ import annotations

import io
import re
import types
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import Union, get_args, get_origin, get_type_hints

import numpy as np
import pandas as pd
import pypdf
import pytest
import report_sample
from matplotlib import rc_context
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text as Label
from pdf_text import filled, pages_of
from pydantic import BaseModel
from pypdf.generic import DictionaryObject

from pipeline.annex.paper import printed
from pipeline.annex.sections.stiffness import stiffness
from pipeline.annex.summaries import courses
from pipeline.answer.contract import Answer, Odd, Remark, Stiffness
from pipeline.base import quantities as numbers
from pipeline.base.errors import Interrupted
from pipeline.report.certificate import digest
from pipeline.report.figures.catalogue import CATALOGUE, draw
from pipeline.report.model import compose
from pipeline.report.record import (
    Column,
    Figure,
    Paragraph,
    Report,
    ReportTable,
    Section,
    TableEntry,
)
from pipeline.report.render import pdf, render
from pipeline.report.summaries import has
from pipeline.report.svg import STYLE, by_hand, drawn
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

pytestmark = pytest.mark.xdist_group("report")  # the sample is drawn once for all

HOSTILE = (
    "<script>alert(1)</script> #panic(\"x\") $x$ *b* _i_ `c` @ref ]] \\u{41} 'q' &amp; {{ 7*7 }}"
)


@pytest.fixture(scope="module")
def sample():
    """A result and its tables."""
    return report_sample.answer(), report_sample.tables()


@pytest.fixture(scope="module")
def files():
    """All files of its report."""
    return report_sample.rendered()


def test_a_figure_that_cannot_be_drawn_costs_itself_alone(sample, monkeypatch):
    """A sentence stands in its place, in page and PDF; the others are there, and it is told."""
    broken, other = CATALOGUE[0], CATALOGUE[1]
    monkeypatch.setattr(
        "pipeline.report.figures.catalogue._drawn",
        lambda plot, *_: {}["gone"] if plot is broken else by_hand(_SQUARE),
    )

    with pytest.warns(UserWarning, match=f"figure {broken.name} could not be drawn .*KeyError"):
        lost = draw(broken.name, *sample)

    assert f"The figure {broken.name} could not be drawn" in lost.svg
    assert draw(other.name, *sample).svg == _SQUARE


@pytest.mark.parametrize("end", [MemoryError(), Interrupted("stopped")])
def test_what_ends_a_run_ends_it_in_a_figure_too(sample, monkeypatch, end):
    """Neither a limit of memory nor Ctrl-C is a figure that cannot be drawn."""

    def ended(*_):
        raise end

    monkeypatch.setattr("pipeline.report.figures.catalogue._drawn", ended)

    with pytest.raises(type(end)):
        draw(CATALOGUE[0].name, *sample)


_SQUARE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'


@pytest.fixture(scope="module")
def html(files):
    """Its page."""
    return files["index.html"].decode()


@pytest.fixture(scope="module")
def reader(files):
    """Its PDF."""
    return pypdf.PdfReader(io.BytesIO(files["report.pdf"]))


ORDER = [
    "validation",
    "diagnosis",
    "test-pose",
    "stiffness",
    "cell",
    "residuals",
    "budget",
    "enough",
    "registration",
    "rejected",
    "identity",
    "method",
]
AXIS = {
    "stiffness": "Stiffness [% of nominal]",
    "path": "Point of the path, in order",
    "prediction": "Relative error of the predicted deflection [%]",
    "measured": "Measured displacement [mm]",
    "pose-rms": "Pose",
    "residual-force": "Size of the pull [N]",
    "residual-course": "Torque about theta2 [N m]",
    "whitened": "Residual [standard deviations]",
    "arrows": "from the side",
    "workspace-joint-springs": "Reach from the shoulder axis [m]",
    "held-out": "Error at poses that took no part [mm]",
    "certificate": "as nominal",
    "gauge": "tolerance 0.5 mm",
    "motion": "1",
    "evidence": "Evidence, natural log of the odds",
    "separability": "roll of the carriage about the rail",
    "workspace": "Reach from the shoulder axis [m]",
    "registration": "Reading of a base reflector, in order",
    "models": "Measured minus predicted [mm]",
    "laws": "Torque about its axis [N m]",
    "enough": "Poses, in the order of measuring",
    "correlation": "c_theta3",
    "scene": "measured deflection, ",
}


def part(report, key):
    """A section of a report."""
    return next(one for one in report.sections if one.key == key)


def words(text: str) -> str:
    """Text without white space, soft breaks and hyphenation, which differ between renderings."""
    return re.sub(r"[\s\u200b\u00ad\u00a0-]", "", text)


def pdf_words(content: bytes) -> str:
    """All text of a PDF without the line at the foot of its pages, as `words` gives it."""
    foot = re.compile(r"Joint stiffness of [^\n]*?\d+ ?/ ?\d+")
    return words("".join(foot.sub("", text) for text in pages_of(content)))


def broken(pages: Iterable[pypdf.PdfPage]) -> list[str]:
    """Lines at whose end or beginning a number parts from its uncertainty, power or unit."""
    text = "\n".join(page.extract_text() for page in pages).replace("\u200b", "")
    parted = re.compile(r"\d\s?[±×]$|±\s?\d+\.$|^([±×]|mm\b)")
    return [line for line in map(str.strip, text.splitlines()) if parted.search(line)]


# --- digits --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (80.0123, 1.6449, "80.0 ± 1.6"),
        (3.80049, 0.0123, "3.800 ± 0.012"),
        (1.0, 0.0996, "1.00 ± 0.10"),
        (1.0, 0.0994, "1.000 ± 0.099"),
        (12345.6, 321.0, "12350 ± 320"),
        (-0.00001, 0.0012, "0.0000 ± 0.0012"),
        (2.1e-8, 1.04e-9, "(2.10 ± 0.10) × 10⁻⁸"),
        (-3.0e-9, 2.2e-8, "(-0.3 ± 2.2) × 10⁻⁸"),
        (5.0, None, "5.00"),
        (158.48931924611142, 3e-31, "158"),
        (0.0, 0.0, "0"),
        (None, 1.0, numbers.MISSING),
        (float("nan"), 1.0, numbers.MISSING),
    ],
)
def test_the_uncertainty_gets_two_digits_and_sets_those_of_the_value(value, std, shown):
    """Two significant digits of the standard uncertainty, the value rounded at the same place."""
    assert numbers.with_std(value, std) == shown


def test_an_interval_has_the_digits_of_a_double():
    """An uncertainty below rounding asks for more digits than there are."""
    assert numbers.interval((158.5, 1e5), 3e-31) == "158.50000000000000 to 100000.00000000000"


@pytest.mark.parametrize(
    ("bounds", "shown"),
    [
        ([76.93, 83.11], "76.9 to 83.1"),
        ([76.93, None], "above 76.9"),
        ([None, 83.11], "below 83.1"),
        ([None, None], numbers.MISSING),
        (None, numbers.MISSING),
    ],
)
def test_an_interval_may_be_open(bounds, shown):
    """A compliance that may be zero gives a stiffness without an upper limit, and it is said."""
    assert numbers.interval(bounds, 1.6) == shown


@pytest.mark.parametrize(
    ("p", "shown"),
    [(0.98, "98 %"), (0.99996, "over 99.9 %"), (0.0, "below 0.1 %"), (0.994, "99.4 %")],
)
def test_a_probability_is_never_shown_as_certainty(p, shown):
    """Rounding must not turn nearly certain into certain."""
    assert numbers.probability(p) == shown


@pytest.mark.parametrize("name", ["1e999", "12e5", "4711E2", "3e4", "12e-05", "1e-05"])
def test_a_serial_number_is_no_power_of_ten(name):
    """What somebody typed stays, alone or in a sentence: a quantity has a relation or a unit."""
    for text in (name, f"serial number {name}", f"target {name}, certificate {name} of {name}"):
        assert numbers.typeset(text) == text


def test_sentences_are_set_in_type():
    """Findings written for a terminal are printed with ± and powers of ten, names untouched."""
    said = numbers.typeset("its compliance is 8.2e-09 +- 4e-09 m/N in P1e-09, 30 mm away, p = 0.2")

    assert said.replace("\N{NBSP}", "_") == (
        "its compliance is 8.2_×_10⁻⁹_±_4_×_10⁻⁹_m/N in P1e-09, 30_mm away, p_=_0.2"
    )


# --- what is said --------------------------------------------------------------------------


def test_the_verdict_comes_first_and_the_method_last(sample):
    """The report is in the order in which an engineer needs it."""
    assert [section.key for section in compose(*sample).sections] == ORDER


def test_a_joint_that_is_not_determined_gets_no_number(sample):
    """No stiffness is stated for a joint that the poses do not determine, and the way out is."""
    report = compose(*sample)
    section = part(report, "stiffness")
    table = next(b for b in section.blocks if isinstance(b, ReportTable))
    row = [cell.text for cell in table.rows[6]]

    assert row[:3] == ["k_theta7", "not determined", numbers.MISSING]
    assert any("load the effector" in getattr(b, "text", "") for b in section.blocks)


def test_stiffness_is_shown_in_one_prefix_with_its_unit(sample):
    """All joints share a prefix, so that their numbers can be compared by eye."""
    section = part(compose(*sample), "stiffness")
    table = next(b for b in section.blocks if isinstance(b, ReportTable))
    shown = [(row[1].text, row[3].text) for row in table.rows[:2]]

    assert shown == [("77.92 ± 0.32", "MN/m"), ("3.751 ± 0.030", "MN·m/rad")]


def bared(value, model=Answer):
    """result.json with null wherever its types allow one, and with nothing in its lists."""
    if get_origin(model) is types.UnionType or get_origin(model) is Union:
        return None if type(None) in get_args(model) else value
    if get_origin(model) is tuple and get_args(model)[-1] is Ellipsis:
        return []
    if get_origin(model) is tuple:
        return [bared(v, kind) for v, kind in zip(value, get_args(model), strict=True)]
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        return value
    hints = get_type_hints(model)
    names = {field.serialization_alias or name: name for name, field in model.model_fields.items()}
    here = {key: name for key, name in names.items() if key in value}  # some are there for some
    return {key: bared(value[key], hints[name]) for key, name in here.items()}


@pytest.fixture(scope="module")
def whole(sample):
    """The parts of its report by their keys."""
    return {section.key: section for section in compose(*sample).sections}


def test_what_is_null_leaves_its_part_out_and_nothing_else(sample):
    """Whatever an answer may leave open is null, in every joint, too: there still is a report."""
    answer, tables = sample
    joints = [bared(joint.model_dump(mode="json"), Stiffness) for joint in answer.stiffness]

    said = report_sample.revised(answer, lambda a: a.update(bared(a), stiffness=joints))
    report = compose(said, tables)

    keys = [section.key for section in report.sections]
    assert keys == [key for key in ORDER if key not in ("validation", "budget")]
    table = next(b for b in part(report, "stiffness").blocks if isinstance(b, ReportTable))
    assert [row[1].text for row in table.rows] == [
        "not determined" if not joint.identifiable else numbers.MISSING
        for joint in answer.stiffness
    ]


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    "path",
    [
        ("validation",),
        ("extended",),
        ("registration",),
        ("measured",),
        ("fit", "p_value"),
        ("validation", "held_out_rms_mm"),
        ("registration", "chi2"),
        ("diagnosis", "causes", 0, "gain"),
        ("diagnosis", "causes", 0, "p_value"),
        ("diagnosis", "causes", 0, "gain", "ci95"),
        ("diagnosis", "causes", 0, "gain", "reduction"),
        ("diagnosis", "next_poses", 0, "approach"),
    ],
    ids=lambda path: ".".join(map(str, path)),
)
def test_a_fact_that_is_open_changes_its_own_part_only(sample, whole, path):
    """One null: every other part says what it said."""
    answer, tables = sample

    def forget(content):
        *way, last = path
        for key in way:
            content = content[key]
        content[last] = None

    said = compose(report_sample.revised(answer, forget), tables)

    changed = {s.key for s in said.sections if s != whole[s.key]}
    changed |= set(whole) - {s.key for s in said.sections}
    own = {"fit": "stiffness", "measured": None, "extended": None}.get(path[0], path[0])
    assert changed == ({own} if own else set())


def test_without_tables_there_are_both_renderings_and_no_figures(sample):
    """The answer is all that a report needs; figures of tables that are missing are left out."""
    made = render(report_sample.revised(sample[0], lambda a: a.update(rejected=[])), {})

    figures = {"figures/stiffness.svg", "figures/gauge.svg"}  # of the answer alone
    assert set(made) == {"index.html", "report.pdf", *figures}
    assert b"No row of the raw files was unreadable or incomplete" in made["index.html"]


def test_captions_carry_the_numbers_of_the_campaign(sample):
    """A caption names the worst pose and how bad it is, from the residuals themselves."""
    result, tables = sample
    spoilt = dict(tables, residuals=tables["residuals"].copy())
    spoilt["residuals"].loc[spoilt["residuals"]["pose"] == 5, "residual_m"] = 2.5e-4

    caption = next(f for f in compose(result, spoilt).figures if f.name == "pose-rms").caption

    assert caption.replace("\u00a0", " ").startswith("Pose 5 is the worst with 0.250 mm")


@pytest.mark.slow
def test_a_stiffness_without_upper_limit_is_drawn_and_said(sample):
    """An interval that is open above is no symmetric bar: table and figure both say so."""
    result, tables = sample
    endless = report_sample.revised(
        result, lambda a: a["stiffness"][0].update(ci95=[a["stiffness"][0]["ci95"][0], None])
    )

    html = render(endless, tables)["index.html"].decode()

    assert "above 77.31" in html
    assert 'data-tip="k_r1: 97.4 % of nominal, above 96.6 %"' in html


@pytest.mark.parametrize("upper", [40.0, None], ids=["wide", "endless"])
@pytest.mark.parametrize("which", [0, 3])
def test_one_wide_interval_leaves_the_others_readable(sample, upper, which):
    """It runs out of the plot with its numbers; the others keep a third of the width or more."""

    def widen(content):
        one = content["stiffness"][which]
        one["ci95"] = [0.01 * one["nominal"], upper and upper * one["nominal"]]

    result = report_sample.revised(sample[0], widen)
    canvas = Canvas()
    with rc_context(STYLE):
        CATALOGUE[[plot.name for plot in CATALOGUE].index("stiffness")].draw(
            canvas, result, sample[1]
        )
    first, last = canvas.axes[0].get_xlim()
    others = [joint for k, joint in enumerate(result.stiffness) if k != which and joint.ci95[1]]
    ends = [100 * end / joint.nominal for joint in others for end in joint.ci95]

    assert first < min(ends) < max(ends) < last
    assert max(ends) - min(ends) > (last - first) / 3 / 1.3  # the margins
    told = "1.00 % to 4000 %" if upper else "above 1.00 %"
    assert told in {label.get_text().partition("(")[2].strip(")") for label in canvas.axes[0].texts}


def test_a_sentence_of_the_answer_is_shown_to_the_letter(sample):
    """Sentences are made once, in words; the report neither parses nor rewords them."""
    why = "link_bending:upper_arm explains it; joint_tilted does not."

    def say(content):
        said = "With joint_tilt:3 in the model it fits."
        content["first_screen"] = [{"about": "verdict", "text": said}]
        content["diagnosis"]["why"] = why

    report = compose(report_sample.revised(sample[0], say), sample[1])
    texts = [b.text for s in report.sections for b in s.blocks if hasattr(b, "text")]

    assert [one.text for one in report.first] == ["With joint_tilt:3 in the model it fits."]
    assert why in texts


@pytest.mark.slow
def test_the_map_tells_which_causes_are_alike(sample, html):
    """The smaller of both directions counts; a cause that does not show has no row."""
    caption = next(f for f in compose(*sample).figures if f.name == "separability").caption

    assert caption.startswith("Of the 3 pairs of the 3 causes compared, 2 could not be dis")
    assert "tilt of the bearing in joint 2 and roll of the carriage about the rail, 0.80" in caption
    tips = re.findall(r'data-tip="([^"]* or [^"]* σ)"', html)
    assert sorted(tips) == [
        "tilt of the bearing in joint 2 or roll of the carriage about the rail: 0.80 σ",
        "wrong zero of the spring scale or roll of the carriage about the rail: 12 σ",
        "wrong zero of the spring scale or tilt of the bearing in joint 2: 3.1 σ",
    ]


def test_an_identified_cause_is_compared_as_large_as_it_was_found(sample):
    """Its pairs have the distances of the verdict, and say so; those of the others are typical."""
    answer, tables = sample
    cause = answer.diagnosis.causes[0].model_copy(update={"name": "scale_zero", "where": None})
    answer = answer.model_copy(
        update={"diagnosis": answer.diagnosis.model_copy(update={"causes": (cause,)})}
    )
    pairs = tables["separability"]
    own = (pairs["cause"] == "scale_zero") != (pairs["rival"] == "scale_zero")
    told = {**tables, "separability": pairs.assign(sigmas_found=np.where(own, 2.25, np.nan))}

    caption = next(f for f in compose(answer, told).figures if f.name == "separability").caption
    drawn = draw("separability", answer, told).inline

    assert "3 could not be" in caption
    assert "at the magnitude that these readings give" in caption
    tips = re.findall(r'data-tip="([^"]* or [^"]* σ[^"]*)"', drawn)
    assert sorted(tips) == [
        "tilt of the bearing in joint 2 or roll of the carriage about the rail: 0.80 σ",
        "wrong zero of the spring scale or roll of the carriage about the rail: 2.2 σ, "
        "magnitudes found",
        "wrong zero of the spring scale or tilt of the bearing in joint 2: 2.2 σ, magnitudes found",
    ]


def test_labels_of_plots_below_each_other_stand_below_each_other():
    """However wide the numbers between label and plot are."""

    def draw(canvas):
        first, second = canvas.subplots(2, 1)
        for axes, most in ((first, 1.0), (second, 1e6)):
            axes.ticklabel_format(style="plain")
            axes.plot([0, 1], [0, most])
            axes.set_ylabel("Height [m]")
        return {}

    found = ET.fromstring(drawn("two", draw).svg)
    texts = [one for one in found.iter() if one.tag.endswith("text") and one.text == "Height [m]"]
    one, other = (re.findall(r"[-\d.]+", text.get("transform"))[1] for text in texts)
    assert one == other


def test_a_residual_that_follows_the_rail_is_said_to(sample):
    """A slope along the rail is found there; torque is that of the best suspect."""
    _, tables = sample
    _, told = courses(tables, {})
    by_column = {one.column: one for one in told}

    assert list(by_column) == ["r1_m", "tau_theta2", "time_s"]
    assert by_column["r1_m"].explained > 0.6
    assert by_column["r1_m"].explained > 2 * by_column["tau_theta2"].explained
    assert by_column["r1_m"].by_chance == 18 / len(tables["examined"])
    tables = tables | {"examined": tables["examined"].drop(columns="r1_m").assign(time_s=np.nan)}
    assert [one.column for one in courses(tables, {})[1]] == ["tau_theta2"]


def test_suspects_are_ordered_by_their_evidence(sample):
    """The figure shows the best suspect first and leaves out what could not be judged."""
    caption = next(f for f in compose(*sample).figures if f.name == "evidence").caption

    assert caption.startswith("Tested alone, roll of the carriage about the rail has the strongest")
    assert "31; 2 of 4 suspects exceed 3" in caption


# --- page ----------------------------------------------------------------------------------


def test_every_stiffness_stands_in_page_and_pdf(sample, html, files):
    """Both renderings show every joint with the same digits."""
    section = part(compose(*sample), "stiffness")
    table = next(block for block in section.blocks if isinstance(block, ReportTable))
    spoken = pdf_words(files["report.pdf"])

    for row in table.rows:
        for cell in row:
            assert numbers.typeset(cell.text) in html
            assert words(cell.text) in spoken


def test_no_page_of_the_pdf_is_half_empty(files):
    """Words and pictures fill 60 % of every page but the last."""
    assert min(filled(files["report.pdf"])[:-1]) >= 0.6


@pytest.mark.slow
def test_a_number_and_its_uncertainty_stay_on_one_line(reader):
    """Also in a table of more columns than fit at the usual size, which is set smaller."""
    columns = tuple(Column(f"Value {k} [mm]", numeric=True) for k in range(9))
    rows = (tuple(TableEntry("123.7747 ± 0.0065", 123.7747) for _ in columns),) * 4
    wide = Section("wide", "Wide", (ReportTable("wide", "Wide", columns, rows),))
    report = Report("k", "h", "Joint stiffness of all", "Fits", "good", (), (wide,))
    pages = pypdf.PdfReader(io.BytesIO(pdf(report, {}))).pages
    right = [tm[4] for page in pages for tm in _places(page)]

    assert sum("±" in page.extract_text() for page in reader.pages) > 2
    assert broken([*reader.pages, *pages]) == []
    assert max(right) < float(pages[0].mediabox.width) - 2.5 * 28.35


def _places(page):
    """Where the texts of a page begin."""
    found = []
    page.extract_text(visitor_text=lambda said, cm, tm, *_: said.strip() and found.append(tm))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect",
    ["", "rail_roll=2x", "joint_tilt:6=2x", "joint_tilt:2=2x", "base_rotation=2x", "label_swap"],
)
def test_pages_are_full_whatever_the_verdict(effect):
    """An adequate, explained, ambiguous or bad-data campaign, or a tilted base, run and printed."""
    hidden = {"effects": [effect]} if effect else {}
    plan = Plan(name="paper", seed=4, poses={"count": 16}, hidden=hidden)
    found = campaign_answer("paper", in_memory(simulate(plan).files))
    content = render(found.answer, found.shown)["report.pdf"]
    first, *more = pages_of(content)

    assert min(filled(content)[:-1]) >= 0.6
    assert broken(pypdf.PdfReader(io.BytesIO(content)).pages) == []
    assert len(more) < 8
    assert digest(found.answer) in first
    assert "Released" in first


def told(report):
    """Every paragraph, caption and cell of a report."""
    for section in report.sections:
        yield section.title
        for block in section.blocks:
            if isinstance(block, ReportTable):
                yield from (block.title, block.note, *(c.text for row in block.rows for c in row))
            else:
                yield getattr(block, "text", None) or block.caption


def test_the_page_says_all_and_the_pdf_what_is_printed(sample, html, files):
    """Every paragraph, caption and cell is on the page; the PDF names what it lacks."""
    import html as escaping

    page, spoken = words(escaping.unescape(html)), pdf_words(files["report.pdf"])
    report = compose(*sample)
    on_paper, everywhere = list(told(printed(report))), list(told(report))
    titles = [b.title for s in report.sections for b in s.blocks if not isinstance(b, Paragraph)]
    lacking = [one for one in titles if one not in on_paper and words(one) not in spoken]

    assert len(everywhere) > len(on_paper) > 90
    assert [text for text in everywhere if words(text) not in page] == []
    assert [text for text in on_paper if words(text) not in spoken] == []
    assert [one for one in lacking if words(f"{one[0].lower()}{one[1:]}") not in spoken] == []


def test_the_page_asks_nobody_for_anything(html):
    """The page works from a file without a network: it names no address at all."""
    assert not re.search(r"(?:https?:)?//[a-z0-9]", html.partition("<script>")[0])
    assert not re.search(
        r"\b(?:(?:src|srcset|action)=|@import|url\([^#]|fetch\(|XMLHttp|import\()", html
    )
    assert all(x.startswith("#") or x == "data:," for x in re.findall(r'href="([^"]*)"', html))


def test_ids_are_unique_and_every_link_leads_somewhere(html):
    """Figures inlined side by side share no ids, and no reference is lost."""
    ids = re.findall(r'\bid="([^"]*)"', html)
    wanted = re.findall(r'href="#([^"]+)"', html) + re.findall(r"url\(#([^)]+)\)", html)
    wanted += re.findall(r'aria-labelledby="([^"]*)"', html)

    assert len(ids) == len(set(ids))
    assert set(wanted) <= set(ids)


def test_figures_follow_the_colours_of_the_page(html):
    """Inline figures hold no colour of their own, so that they can be light and dark."""
    pictures = "".join(re.findall(r"<svg.*?</svg>", html, flags=re.DOTALL))

    pictures = re.sub(r'(?:href|id|clip-path)="[^"]*"', "", pictures)
    of_positions = {"position_steps", "curves"}
    assert pictures.count("<svg") == len(CATALOGUE) - len(of_positions)
    assert "<image" not in pictures
    assert re.findall(r"#[0-9a-f]{3,6}\b|\brgb\(", pictures) == []


@pytest.mark.whole
def test_no_title_is_cut_by_the_edge_of_its_figure(sample):
    """The longest name of a model, of a cause and of its place, in the narrowest plots."""
    model = {"model": "averaged"}
    answer = report_sample.revised(sample[0], lambda a: a["recommended"].update(model))
    laws = sample[1]["laws"].assign(cause="joint_hardening:upper_arm and a longer name of a place")
    tables = dict(sample[1], laws=laws)
    seen = 0
    for plot in CATALOGUE:
        if not has(tables, *plot.needs) or plot.write(answer, tables) is None:
            continue
        with rc_context(STYLE):
            canvas = Canvas()
            plot.draw(canvas, answer, tables)
            canvas.draw_without_rendering()
            said = {view.get_title("left") for view in canvas.axes} - {""}
            titles = [one for one in canvas.findobj(Label) if one.get_text() in said]
            for text in titles:
                seen += 1
                assert text.get_window_extent().x1 <= canvas.bbox.x1, (plot.name, text.get_text())

    assert seen >= 7


def test_every_value_of_a_figure_can_be_read(html, sample):
    """As many values to hover as there are residual coordinates, each naming pose and target."""
    tips = re.findall(r'data-tip="(pose \d+, pull \d+, P\d [xyz]: [^"]* mm at [^"]* N)"', html)

    assert len(tips) == len(set(tips)) == len(sample[1]["residuals"])


@pytest.mark.parametrize("far", [1e-2, -1e-2])
def test_a_pull_far_off_its_law_keeps_its_mark(sample, far):
    """Marks beyond the sheet are drawn at its edge: each says its own value, none is lost."""
    laws = sample[1]["laws"].copy()
    laws.loc[3, "y"] = far

    drawn = draw("laws", sample[0], dict(sample[1], laws=laws)).inline

    tips = re.findall(r'data-tip="(pose \d+, pull \d+: [^"]*)"', drawn)
    assert len(tips) == len(laws)
    assert "10000" in tips[3]


@pytest.mark.whole
def test_hostile_names_stay_names(sample):
    """Names from raw files are shown as they are; they are neither HTML, nor Jinja, nor Typst."""
    tables = dict(sample[1])

    def spoil(content):
        content |= {"campaign": HOSTILE, "robot": HOSTILE, "findings": [HOSTILE]}
        content["diagnosis"]["causes"][0]["name"] = HOSTILE
        content["rejected"][0] |= {"file": HOSTILE, "reason": HOSTILE}
        content["inputs"][0]["file"] = HOSTILE
        content["stiffness"][1]["name"] = HOSTILE

    result = report_sample.revised(sample[0], spoil)
    for name in ("residuals", "displacements", "registration", "validation"):
        tables[name] = tables[name].assign(target="_" + HOSTILE)

    made = render(result, tables)
    html = made["index.html"].decode()
    spoken = pdf_words(made["report.pdf"])

    assert html.count("<script>") == 1
    assert html.count("&lt;script&gt;alert(1)") > 400
    assert html.count("{{ 7*7 }}") == html.count("&lt;script&gt;alert(1)")
    assert spoken.count(words("#panic")) > 10
    assert words("$x$ *b* _i_ `c` @ref ]] \\u{41}") in spoken


# --- PDF -----------------------------------------------------------------------------------


def structure(node: object) -> list[DictionaryObject]:
    """All elements of a structure tree below a node."""
    node = node.get_object() if hasattr(node, "get_object") else node
    if isinstance(node, list):
        return [found for child in node for found in structure(child)]
    if not isinstance(node, DictionaryObject):
        return []
    return [node, *(structure(node["/K"]) if "/K" in node else [])]


def test_the_pdf_is_tagged_and_says_title_and_language(reader, sample):
    """A screen reader gets a tagged document with its language and title."""
    root = reader.trailer["/Root"]

    assert root["/MarkInfo"]["/Marked"].value is True
    assert root["/Lang"] == "en"
    assert reader.metadata.title == compose(*sample).title
    assert root["/ViewerPreferences"]["/DisplayDocTitle"].value is True


def test_every_figure_of_the_pdf_has_its_alternative_text(reader, sample):
    """Each picture carries the alternative text of the model, in order."""
    elements = structure(reader.trailer["/Root"]["/StructTreeRoot"])
    spoken = [str(e["/Alt"]) for e in elements if e.get("/S") == "/Figure"]

    assert spoken == [figure.alt for figure in printed(compose(*sample)).figures]
    assert all(len(alt) > 60 for alt in spoken)


def test_tables_of_the_pdf_have_header_cells(reader, sample):
    """Every table is a table with headings to a screen reader, not a drawing of one."""
    kinds = [str(e.get("/S")) for e in structure(reader.trailer["/Root"]["/StructTreeRoot"])]
    report = printed(compose(*sample))
    tables = [b for s in report.sections for b in s.blocks if isinstance(b, ReportTable)]
    values = 4 + any(bar.enter for bar in report.certificate.bars)  # of the certificate

    assert kinds.count("/Table") == 1 + len(tables)
    assert kinds.count("/TH") == values + sum(len(table.columns) for table in tables)


@pytest.mark.whole
def test_nothing_short_is_cut_by_a_page(files, sample):
    """A figure stands with its caption, and a short table with its last row, on one page.

    Findings in growing number push everything down the pages, so that each edge is met somewhere.
    """
    result, tables = sample
    drawings = {n[8:-4]: c.decode() for n, c in files.items() if n.startswith("figures/")}
    for lines in range(0, 40, 8):
        more = tuple(f"finding {k}" for k in range(lines))
        report = compose(result.model_copy(update={"findings": more}), tables)
        pages = [words(page) for page in pages_of(pdf(report, drawings))]
        for block in (block for one in printed(report).sections for block in one.blocks):
            if isinstance(block, Figure):
                ends = words(AXIS[block.name]), words(block.caption)[-40:]
            elif isinstance(block, ReportTable) and len(block.rows) <= 14:
                ends = words(block.title), words("".join(c.text for c in block.rows[-1]))
            else:
                continue
            assert any(all(end in page for end in ends) for page in pages), (block.name, lines)


# --- bytes ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_two_runs_differ_in_the_stated_run_time_only(files, sample):
    """The same input gives the same bytes, except for the run time where it is stated."""
    again = render(*sample, run_time_s=9.876)
    page, other = files["index.html"].decode(), again["index.html"].decode()

    assert "1.2 s" in page
    assert page.replace(">1.2 s<", ">9.9 s<") == other
    assert {k: v for k, v in files.items() if k.startswith("figures/")} == {
        k: v for k, v in again.items() if k.startswith("figures/")
    }
    assert render(*sample, run_time_s=1.234)["report.pdf"] == files["report.pdf"]


@pytest.mark.slow
def test_a_long_campaign_still_makes_a_small_report(sample):
    """A report can be mailed whatever was measured: page below 3 MB, PDF below 2 MB."""
    result = sample[0].model_copy(update={"rejected": sample[0].rejected * 5000})
    tables = report_sample.tables(poses=600)
    tables["registration"] = pd.concat([tables["registration"]] * 200, ignore_index=True)
    tables["residuals"].loc[7777, "residual_m"] = 4.44e-3

    made = render(result, tables)

    assert len(made["index.html"]) < 3e6
    assert len(made["report.pdf"]) < 2e6
    assert b" 4.44 mm at " in made["index.html"]


def test_figures_on_disk_are_whole_svg_files(files):
    """Each figure is also a file of its own for slides, in light colours."""
    for name, content in files.items():
        if name.endswith(".svg"):
            assert ET.fromstring(content).tag == "{http://www.w3.org/2000/svg}svg"
            assert b"var(--" not in content


def test_what_is_true_of_several_stiffnesses_is_said_once(sample):
    """Two joints that depend on the same question share a sentence; others keep their own."""
    mine, other = (f"tilt of the bearing in joint {k}" for k in (5, 6))
    tilts = Remark(odd=Odd.DEPENDS, cause=mine, others=(other,))
    bends = Remark(odd=Odd.DEPENDS, cause=mine, others=("bending of the link in the forearm",))
    first, second, third, *others = sample[0].stiffness
    joints = (
        first.model_copy(update={"remarks": (tilts,)}),
        second.model_copy(update={"remarks": (Remark(odd=Odd.MAY_BE_ZERO), tilts)}),
        third.model_copy(update={"remarks": (bends,)}),
        *others,
    )

    section = stiffness(sample[0].model_copy(update={"stiffness": joints}), None)
    said = [block.text for block in section.blocks if isinstance(block, Paragraph)]

    rest = "which the data do not exclude; its interval covers each of them."
    tilt = "depends on whether the cause is tilt of the bearing in joint"
    assert f"Each of k_r1 and k_theta2 {tilt} 5 or tilt of the bearing in joint 6, {rest}" in said
    assert f"k_theta3 {tilt} 5 or bending of the link in the forearm, {rest}" in said
    assert any(line.startswith("k_theta2 has no upper limit") for line in said)


def test_a_finding_of_an_earlier_version_is_told_as_it_stands(sample):
    """It had the sentence and not what it rests on."""
    old = {"finding": "k_r1 is not what it was.", "remarks": ()}
    first, *others = sample[0].stiffness
    joints = (first.model_copy(update=old), *others)

    section = stiffness(sample[0].model_copy(update={"stiffness": joints}), None)

    assert "k_r1 is not what it was." in [getattr(b, "text", "") for b in section.blocks]
