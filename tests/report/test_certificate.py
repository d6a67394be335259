"""The first page of a report: what it says, in how many words, and by what it is found again."""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ET
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import report_sample
from pdf_text import pages_of

from pipeline.annex.figures.certificate import arm_of
from pipeline.annex.figures.heldout import judged
from pipeline.answer.amounts import amount
from pipeline.answer.contract import About, Amplitude, Line, Reason
from pipeline.answer.words import DO
from pipeline.report.certificate import _acting, _bars, certificate, digest, found, to_do
from pipeline.report.figures.catalogue import draw
from pipeline.report.model import compose
from pipeline.report.render import page
from pipeline.store.campaign import dump

pytestmark = pytest.mark.xdist_group("report")  # the sample is drawn once for all


@pytest.fixture(scope="module")
def sample():
    """An answer and its tables."""
    return report_sample.answer(), report_sample.tables()


@pytest.fixture(scope="module")
def first_page():
    """The text of the first page of its PDF."""
    return pages_of(report_sample.rendered()["report.pdf"])[0]


def plainly(text):
    """Text with ordinary spaces."""
    return re.sub(r"\s+", " ", text)


def test_the_first_page_is_the_certificate(sample, first_page):
    """Verdict, what to do, each stiffness, machine, instruments and lines to sign, on one page."""
    told = plainly(first_page)
    content = certificate(*sample)

    for bar in content.bars:
        assert plainly(bar.value) in told, bar.name
    for text in ("What to do.", "S-17", "2026-11-03 08:00 to 10:31", "21.5 °C", "Measured: name"):
        assert text in told
    assert "The answer in words" not in told


def test_what_nobody_stated_is_not_there(sample, first_page):
    """Neither operator nor the scale's certificate is stated: no row, and no word for it."""
    labels = [one.label for one in certificate(*sample).filed]

    assert "Operator" not in labels
    assert "not stated" not in first_page
    assert "certificate" not in first_page


def test_the_digest_is_that_of_the_answer(sample, first_page):
    """`sha256sum result.json` begins with it; another answer has another one."""
    answer, _ = sample
    other = answer.model_copy(update={"campaign": "another"})

    assert hashlib.sha256(dump(answer.as_json())).hexdigest().startswith(digest(answer))
    assert digest(answer) in first_page
    assert digest(other) != digest(answer)


VERDICTS = ("adequate", "explained", "ambiguous", "unexplained")
TOGETHER = [
    (verdict, reason)
    for reason in DO
    for verdict in VERDICTS
    if verdict == "ambiguous" or reason is not Reason.RIVALS
]


@pytest.mark.sampled(40)
@pytest.mark.parametrize("decision", ["fail", "undecided"])
@pytest.mark.parametrize(("verdict", "reason"), TOGETHER)
def test_verdict_and_what_to_do_are_read_in_a_minute(sample, verdict, reason, decision):
    """At most 60 words, whatever is decided, also out of tolerance and with two rivals."""

    def state(content):
        content["diagnosis"]["verdict"] = verdict
        content["recommended"]["reason"] = str(reason)
        content["tolerance"]["test_pose"] = decision

    answer = report_sample.revised(sample[0], state)
    report = compose(answer, {})  # these words need no table
    of = report.certificate
    said = " ".join((report.judged.word, report.verdict, of.found, "What to do", of.to_do))

    assert len(said.split()) <= 60


def test_a_long_finding_ends_with_a_clause(sample):
    """What is wrong with the data is told up to a comma; the page below has all of it."""
    told = "in pose 4 P1 is off: " + " ".join(f"word{k}" for k in range(12)) + ", " + "more " * 20

    def spoil(content):
        evidence = {"sentence": told, "correction": "", "before": 1, "after": 0, "unit": "m"}
        content["diagnosis"]["causes"][0]["evidence"] = evidence

    said = found(report_sample.revised(sample[0], spoil))

    assert said == "In pose 4 P1 is off: " + " ".join(f"word{k}" for k in range(12)) + "."


def test_every_error_is_told_with_its_line(sample):
    """Two readings of the scale, each with what all others agree with; of many the first four."""

    def spoil(content, count):
        one = content["diagnosis"]["causes"][0]
        text = "the reading pose{0} (line {0}) says 201 lbf, and all others agree with 16{0} lbf"
        known = {"correction": "", "before": 1, "after": 0, "unit": "sigma"}
        content["diagnosis"]["causes"] = [
            one | {"evidence": {"sentence": text.format(k), **known}} for k in range(count)
        ]

    few, many = (
        found(report_sample.revised(sample[0], partial(spoil, count=count))) for count in (2, 7)
    )

    assert few.startswith("The reading pose0 (line 0) says 201 lbf")
    second = "the reading pose1 (line 1) says 201 lbf, and all others agree with 161 lbf."
    assert few.endswith(f"with 160 lbf; {second}")
    assert many.endswith("agree with 163 lbf (and 3 more).")


def test_a_cause_is_named_with_its_size_and_its_gain(sample):
    """The noun, the amount in a prefix that people read, and the error before and after."""

    def state(content):
        content["diagnosis"]["causes"][0]["rivals"] = []
        springs = content["validation"] | {"held_out_rms_mm": 0.19}
        content["joint_springs"]["validation"] = springs

    said = found(report_sample.revised(sample[0], state))

    assert said == (
        "Roll of the carriage about the rail, 21.0 ± 1.0 nrad/(N·m); error at poses held out: "
        "0.19 mm with joint springs, 0.033 mm with the cause."
    )


def test_a_controller_gets_effective_values_beside_a_cause(sample):
    """Those of the joint springs alone, with their units; else they are the values themselves."""
    answer, tables = sample
    springs = {one.name: one.value for one in answer.joint_springs.stiffness}
    alone = answer.model_copy(
        update={"recommended": answer.recommended.model_copy(update={"reason": Reason.ADEQUATE})}
    )

    bars = certificate(answer, tables).bars
    assert bars[1].enter == f"{springs['k_theta2'] / 1e6:.3f}\N{NO-BREAK SPACE}MN·m/rad"
    assert bars[6].enter == "leave as it is"
    assert certificate(alone, tables).bars[1].enter == re.sub(
        " ?± [^ ]+".replace(" ", "\N{NO-BREAK SPACE}"), "", bars[1].value
    )


def test_a_controller_gets_effective_values_of_the_corrected_data(sample):
    """Beside an error in the data those without it; an answer without such has none to enter."""

    def spoil(content, known):
        content["diagnosis"]["verdict"] = "bad_data"
        content["recommended"] |= {"reason": str(Reason.MISTAKE_AND_CAUSE), "data": "corrected"}
        if known:
            springs = content["joint_springs"]["stiffness"]
            content["effective"] = [
                one | {"value": one["value"] and 1.1 * one["value"]} for one in springs
            ]

    for known in (True, False):
        answer = report_sample.revised(sample[0], partial(spoil, known=known))
        made = certificate(answer, sample[1])
        right = f"{1.1 * answer.joint_springs.stiffness[1].value / 1e6:.3f} MN·m/rad"

        assert plainly(made.bars[1].enter) == (right if known else "do not enter")
        assert "effective values" in made.note


def test_springs_that_a_cause_leaves_undetermined_have_values_to_enter(sample):
    """Of no joint beside the cause, of all but the last without it: the table stays."""

    def spoil(content):
        blank = content["stiffness"][-1]
        names = ("value", "std", "ci95", "relative_std", "identifiable", "compliance")
        for one in content["stiffness"]:
            one |= {name: blank[name] for name in (*names, "compliance_std", "budget")}

    answer = report_sample.revised(sample[0], spoil)
    bars = _bars(answer)[0]

    assert [bar.value for bar in bars] == ["not determined"] * 7
    assert [bar.enter for bar in bars] == [bar.enter for bar in _bars(sample[0])[0]]
    assert "MN·m/rad" in bars[1].enter


@pytest.mark.parametrize("verdict", VERDICTS)
@pytest.mark.parametrize(
    ("reasons", "said"),
    [
        (["stands_unexplained"], "do not stand where the robot file places"),
        (["rough_table"], "deviates a little from its nominal geometry"),
        (["rough_table", "stands_unexplained"], "do not stand where"),
    ],
)
def test_what_the_unloaded_reflectors_show_is_on_the_first_page(sample, verdict, reasons, said):
    """Where it is worse than a rough table whatever the verdict, else where nothing is wrong."""

    def spoil(content):
        content["diagnosis"] |= {"verdict": verdict, "reasons": reasons, "causes": []}

    told = found(report_sample.revised(sample[0], spoil))

    if verdict == "adequate":
        said = "deviates a little" if reasons[0] == "rough_table" else said
    assert (said in told) == (verdict == "adequate" or "stands_unexplained" in reasons)


def test_a_cause_of_several_parameters_has_no_size_in_its_sentence(sample):
    """A single number stands for the cause; of two, neither does."""

    def state(content, count):
        one = content["diagnosis"]["causes"][0]
        one |= {"rivals": [], "parameters": one["parameters"] * count}

    told = [found(report_sample.revised(sample[0], partial(state, count=n))) for n in (1, 2, 0)]

    assert ["nrad" in one.partition(";")[0] for one in told] == [True, False, False]


def test_both_stiffnesses_of_a_joint_are_on_the_first_page(sample):
    """That at the test pose and that the other way, with U."""
    note = certificate(
        report_sample.revised(sample[0], report_sample.stiffer_one_way), sample[1]
    ).note

    assert "4: 2.400 ± 0.040 MN·m/rad; 1.500 ± 0.020 MN·m/rad the other way." in plainly(note)


@pytest.mark.parametrize("location", ["metrology", "force", "rail"])
def test_a_cause_of_the_instrument_is_no_reason_for_effective_values(sample, location):
    """Springs that were fitted to a tracker's drift would be wrong in the robot."""

    def place(content):
        for one in content["diagnosis"]["causes"]:
            one |= {"location": location, "rivals": []}
        names = {one["name"] for one in content["diagnosis"]["causes"]}
        for each in content["recommended"]["hypotheses"]:
            each["causes"] = [one for one in each["causes"] if one["name"] in names]

    answer = report_sample.revised(sample[0], place)
    taken = answer.joint_springs if location == "rail" else answer
    made = certificate(answer, sample[1])

    assert made.bars[1].enter == f"{taken.stiffness[1].value / 1e6:.3f}\N{NO-BREAK SPACE}MN·m/rad"
    assert ("effective" in made.note) == (location == "rail")
    assert ("they allow for what was identified" in to_do(answer)) == (location != "rail")


def test_what_to_measure_next_ends_with_a_sentence(sample):
    """The first page has its first sentences, and no pose that only begins."""
    answer, tables = sample
    first = "No question is open. Optional: pulls along the rail would improve E1 most."
    one_more = f"Its standard uncertainty is 43 %. One more pose: {', '.join(['A1 -77.63°'] * 9)}."
    both = (
        "Its standard uncertainty is 3.3 %. With the pose that the report proposes it is expected"
    )
    for rest in (one_more, f"{both} to be 2.9 %."):
        line = Line(about=About.NEXT, text=f"{first} {rest}")
        screen = (*answer.first_screen, line)
        said = certificate(answer.model_copy(update={"first_screen": screen}), tables).measure
        assert plainly(said) == first


def test_the_drawing_marks_where_the_cause_sits(sample):
    """A tilt of joint 4 is ringed at the disc of joint 4, and nowhere else; a rival has a ring."""

    def state(content, **more):
        content["diagnosis"]["causes"][0] |= {"name": "joint_tilt", "where": 4, "rivals": []} | more

    drawn = draw("certificate", report_sample.revised(sample[0], state), sample[1]).svg
    circles = [one.attrib for one in ET.fromstring(drawn).iter() if one.tag.endswith("circle")]
    rings = [one for one in circles if float(one["r"]) > 10]
    discs = {one["data-tip"].split(":")[0]: one for one in circles if "data-tip" in one}

    rival = {"name": "joint_tilt", "where": 5, "axis": None, "probability": 0.4}
    open_ = report_sample.revised(sample[0], partial(state, rivals=[rival]))

    assert len(rings) == 1
    assert draw("certificate", open_, sample[1]).svg.count('r="17"') == 2
    assert (rings[0]["cx"], rings[0]["cy"]) == (discs["k_theta4"]["cx"], discs["k_theta4"]["cy"])
    assert len(discs) == 7


def test_the_gauge_says_what_is_decided(sample):
    """Test pose and worst point of the path, each with its decision beside the tolerance."""
    told = " ".join(ET.fromstring(draw("gauge", *sample).svg).itertext())

    assert "Test pose: pass" in told
    assert "part.csv, pose 6: fail" in told
    assert "tolerance 0.5 mm" in told
    assert "By ISO 14253-1: 0.610 - 1.65 × 0.033 = 0.556 mm is above 0.5 mm." in plainly(
        certificate(*sample).gauge.caption
    )


def test_models_are_judged_at_poses_that_took_no_part(sample):
    """A dot is the rms of a pose left out, from the table's own numbers; the bar what is stated."""
    answer, tables = sample
    models = judged(answer, tables)
    rows = tables["examined"]
    mine = rows[rows["pose"] == 3]["left_out_m"].to_numpy()
    nominal = tables["models"]
    off = (nominal["measured_m"] - nominal["nominal_m"])[nominal["pose"] == 3].to_numpy()

    assert len(models) == 3
    (dot,) = models[1].poses.query("pose == 3")["mm"]
    assert dot == pytest.approx(1e3 * np.sqrt(np.mean(mine**2)))
    (dot,) = models[0].poses.query("pose == 3")["mm"]
    assert dot == pytest.approx(1e3 * np.sqrt(np.mean(off**2)))
    assert models[2].mm == answer.validation.held_out_rms_mm


@pytest.mark.parametrize(
    ("value", "std", "unit", "said"),
    [
        (5.15e-8, 0.38e-8, "rad/(N m)", "51.5 ± 3.8 nrad/(N·m)"),
        (2.1e-3, 1e-4, "1", "0.210 ± 0.010 %"),
        (-1e-9, 5.2e-8, "rad", "-1 ± 52 nrad"),
        (20.0, 1.0, "N", "20.0 ± 1.0 N"),
        (1e-8, None, "m/s", "36.0 µm/h"),
        (None, None, "m", "–"),
    ],
)
def test_a_size_is_told_in_the_unit_that_people_read(value, std, unit, said):
    """Prefixes, per cent, and drifts per hour."""
    assert amount(Amplitude(name="c", value=value, std=std, unit=unit)) == said


def test_the_bars_need_no_picture(sample):
    """On the page each stiffness has its bar, with the words beside it for who cannot see it."""
    answer, tables = sample
    report = compose(answer, tables)
    drawings = {one.name: "" for one in report.figures}
    html = page(report, drawings)

    table = html[html.index('id="values"') : html.index("</table>")]
    assert table.count('class="track"') == 6  # joint 7 is not determined
    assert table.count("<tr>") == 8
    assert "not determined" in table
    assert to_do(answer) in html


def test_an_axis_has_the_name_of_its_controller_only(sample):
    """Neither the number of its joint nor the name of a variable, also where a rival is named."""

    def state(content):
        for one in (*content["stiffness"], *content["joint_springs"]["stiffness"]):
            one["axis"] = f"A{one['joint'] - 1}" if one["joint"] > 1 else "E1"
        rival = {"name": "joint_tilt", "where": 5, "axis": "A4", "probability": 0.4}
        here = {"name": "joint_tilt", "where": 4, "axis": "A3", "rivals": [rival]}
        content["diagnosis"]["causes"][0] |= here
        text = "No question is open. Optional: pulls along the rail would improve E1 (k_r1) most."
        content["first_screen"] = [{"about": "next", "text": text}]

    content = certificate(report_sample.revised(sample[0], state), sample[1])

    assert content.found.startswith("Tilt of the bearing in axis A3 or axis A4.")
    assert content.measure.endswith("would improve E1 most.")
    assert "axis A3 and 2 = tilt of the bearing in axis A4" in content.picture.caption
    assert not re.search(r"joint \d|k_", content.found + content.measure + content.picture.caption)


@pytest.mark.parametrize("soft", [1.0, 0.7])
def test_the_mark_of_the_nominal_value_is_where_a_nominal_stiffness_stands(sample, soft):
    """Whatever the ends of the bar, which another joint may move."""
    answer, tables = sample
    first, second, *others = answer.stiffness
    nominal = second.model_copy(update={"value": second.nominal})
    other = first.model_copy(update={"value": soft * first.nominal})
    content = certificate(
        answer.model_copy(update={"stiffness": (other, nominal, *others)}), tables
    )

    assert content.bars[1].track[1] == pytest.approx(content.nominal)


def test_one_coverage_and_one_unit_for_each_kind_of_joint(sample):
    """What stands behind ± is twice the standard uncertainty; all axes that turn have one unit."""
    answer, tables = sample
    bars = certificate(answer, tables).bars
    shown = [re.fullmatch(r"[\d.]+\s±\s([\d.]+)\s(\S+)", one.value) for one in bars[1:6]]
    units = {one[2] for one in shown}
    u = float(shown[0][1])

    assert len(units) == 1
    assert u == pytest.approx(2 * answer.stiffness[1].std / 1e6, rel=0.05)


def test_data_that_must_not_be_used_say_so_and_show_no_table(sample):
    """No stiffness, and none to enter: the headline says it, and nothing is listed."""

    def state(content):
        content["diagnosis"]["verdict"] = "bad_data"
        content["recommended"]["reason"] = str(Reason.MISTAKE_AND_UNEXPLAINED)
        for one in (*content["stiffness"], *content["joint_springs"]["stiffness"]):
            one["value"] = None

    report = compose(report_sample.revised(sample[0], state), sample[1])

    assert report.verdict == "Do not use: the data are wrong"
    assert report.certificate.bars == ()
    assert "enter none" in report.certificate.note
    assert "nominal" not in report.certificate.picture.caption
    html = page(report, {one.name: "" for one in report.figures})
    assert 'id="values"' in html
    assert 'class="barred"' not in html


def test_wrong_data_that_were_corrected_may_be_used(sample):
    """The headline says which values."""

    def state(content):
        content["diagnosis"]["verdict"] = "bad_data"
        content["recommended"] |= {"reason": str(Reason.MISTAKE), "data": "corrected"}

    report = compose(report_sample.revised(sample[0], state), sample[1])

    assert report.verdict == "The data are wrong: use corrected values only"
    assert report.certificate.bars


def test_picture_and_gauge_have_the_same_digits(sample):
    """The arrow's number is that of the gauge, which says that it is predicted, and for what."""
    picture, gauge = (
        " ".join(ET.fromstring(draw(name, *sample).svg).itertext())
        for name in ("certificate", "gauge")
    )
    (shown,) = re.findall(r"([\d.]+) mm", picture)

    assert f"predicted {shown} ± " in gauge
    assert "these poses and forces only" in certificate(*sample).gauge.caption


def test_the_axis_of_the_rail_is_marked_on_the_carriage(sample):
    """Between its ends, not where the rail begins."""
    _, tables = sample
    arm = arm_of(tables, 400.0, 64.0)
    rows = tables["posture"].query("part == 'carriage'")
    low, up = (
        arm(rows[[f"{end}_{a}_m" for a in "xyz"]].to_numpy(float))[0] for end in ("from", "to")
    )
    at = arm.joints[1]

    assert min(np.hypot(*(at - low)), np.hypot(*(at - up))) > 0.0
    assert np.hypot(*(at - low)) + np.hypot(*(at - up)) == pytest.approx(np.hypot(*(up - low)))


def test_what_is_not_determined_looks_unlike_what_is_uncertain(sample):
    """A dashed outline, on the robot and in the key, of joint 7 alone."""
    drawn = ET.fromstring(draw("certificate", *sample).svg)
    circles = [one.attrib for one in drawn.iter() if one.tag.endswith("circle")]
    dashed = [one for one in circles if "stroke-dasharray" in one]

    assert len(dashed) == 2
    (tip,) = [one["data-tip"] for one in dashed if "data-tip" in one]
    assert tip.endswith("not determined")
    assert "as nominal (within 5 % or U)" in "".join(drawn.itertext())


def test_a_cause_too_small_to_name_asks_for_no_effective_values():
    """It stands beside all that was identified, here an error of the scale; a rival does not."""

    def answer(*sets):
        named = [[SimpleNamespace(name=name) for name in one] for one in sets]
        return SimpleNamespace(
            diagnosis=SimpleNamespace(
                causes=[SimpleNamespace(name="scale_zero", location="force")]
            ),
            recommended=SimpleNamespace(hypotheses=[SimpleNamespace(causes=one) for one in named]),
        )

    assert _acting(answer(["scale_zero"], ["scale_zero", "rail_roll"])) == set()
    assert _acting(answer(["scale_zero"], ["rail_roll"])) == {"rail_roll"}
    assert _acting(answer(["rail_roll"], ["rail_roll", "scale_zero"])) == {"rail_roll"}
