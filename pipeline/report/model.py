"""What the report says, in order, independent of how it is shown.

Page and PDF both walk through the same record, so neither can say what the other does not.
"""

from __future__ import annotations

from pipeline.report import words
from pipeline.report.record import Report
from pipeline.report.sections._tree import at, items, joint_name
from pipeline.report.sections.diagnosis import diagnosis
from pipeline.report.sections.method import method
from pipeline.report.sections.prediction import test_pose, validation
from pipeline.report.sections.readings import budget, registration, rejected, residuals
from pipeline.report.sections.stiffness import stiffness
from pipeline.report.summaries import Result, Tables


def compose(
    result: Result,
    tables: Tables,
    run_time_s: float | None = None,
    previous: Result | None = None,
) -> Report:
    """Everything the report says about a campaign.

    Args:
        result: The object of result.json; keys that are missing or null leave their part out.
        tables: REGISTRATION, RESIDUALS, REJECTED, VALIDATION, FORCES and DISPLACEMENTS by the
            lower-case name of their promise, SI.
        run_time_s: How long the run took [s].
        previous: The result of the robot's previous campaign, to say what has changed.
    """
    title, tone = words.VERDICTS.get(
        at(result, "diagnosis", "verdict"), ("Stiffness identified", "neutral")
    )
    sections = [
        stiffness(result, previous),
        diagnosis(result, tables),
        test_pose(result, tables),
        validation(result, tables),
        residuals(result, tables),
        budget(result),
        registration(result, tables),
        rejected(result, tables),
        method(result),
    ]
    campaign, robot = str(result.get("campaign") or "campaign"), str(result.get("robot") or "robot")
    return Report(
        kicker=f"Joint stiffness · {robot}",
        heading=campaign,
        title=f"Joint stiffness of {robot}: {campaign}",
        verdict=title,
        tone=tone,
        sentences=tuple(_verdict_sentences(result)),
        sections=tuple(s for s in sections if s is not None),
        elsewhere="The same stands in index.html and report.pdf, the numbers in result.json.",
        run_time=None if run_time_s is None else f"{run_time_s:.1f} s",
    )


def _verdict_sentences(result: Result) -> list[str]:
    given = result.get("verdict_sentence")
    if isinstance(given, str) and given:
        given = [given]
    if given:
        return [words.in_words(str(sentence)) for sentence in given]
    verdict = at(result, "diagnosis", "verdict")
    weak = [joint_name(s) for s in items(result, "stiffness") if not s.get("identifiable", True)]
    first = words.EXPLAINED.get(
        str(verdict),
        "The joint stiffnesses are identified; whether the model is complete was not tested.",
    )
    if weak:
        return [first, f"Not determined by these poses: {', '.join(weak)}."]
    return [first, "All joint stiffnesses are determined; their uncertainties stand in the table."]
