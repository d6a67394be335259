"""Content of the report, in order, independent of its presentation.

Page and PDF are both made from the same record, so that they cannot contradict each other.
"""

from __future__ import annotations

from collections.abc import Collection

from pipeline.answer.contract import Answer
from pipeline.answer.words import ABOUT
from pipeline.base import doors
from pipeline.base.appearance import PLAIN, Appearance
from pipeline.base.language import spoken, translated
from pipeline.diagnosis.finding import Verdict
from pipeline.report import words
from pipeline.report.certificate import certificate, enterable
from pipeline.report.record import Headline, Item, PageFrame, Report, Section
from pipeline.report.summaries import Tables

_ANNEX = "pipeline.annex.sections:sections"
"""Door of the annex: sections after the first page."""


def compose(
    answer: Answer,
    tables: Tables,
    run_time_s: float | None = None,
    previous: Answer | None = None,
    beside: Collection[str] = (),
    wear: str | None = None,
    look: Appearance = PLAIN,
) -> Report:
    """Compose the report of a campaign.

    Args:
        answer: The answer to the campaign.
        tables: REGISTRATION, RELIABILITY, RESIDUALS, REJECTED, VALIDATION, FORCES, DISPLACEMENTS
            and others by their lower-case names, in SI units; the report omits what needs a table
            that is missing.
        run_time_s: Run time [s].
        previous: The answer to the robot's previous campaign, to report changes since then.
        beside: Names of the files in the folder of the page, for links to them.
        wear: Result of all campaigns of the robot together; None if there are too few.
        look: Language of the certificate and what the house adds to it; the rest is in English.
    """
    say = spoken(look.language)
    title, tone = _verdict(answer)
    annex = doors.found(_ANNEX)
    sections = annex(answer, tables, previous, beside, wear) if annex else ()
    return Report(
        kicker=f"{say(_about(answer))} · {say(answer.machine)}",
        heading=answer.campaign,
        title=say(_title(answer)),
        verdict=say(title),
        tone=tone,
        first=(
            *(Item(ABOUT[one.about], one.text) for one in answer.first_screen),
            *([Item("Wear", wear)] if wear else []),
        ),
        sections=tuple(sorted(sections, key=lambda one: _place(one, look))),
        judged=translated(_judged(answer), say),
        elsewhere=say(
            "The same report is in index.html and report.pdf, the numbers in result.json."
        ),
        run_time=None if run_time_s is None else f"{run_time_s:.1f} s",
        certificate=certificate(answer, tables, say, look),
        frame=translated(PageFrame(language=look.language), say),
    )


def _verdict(answer: Answer) -> tuple[str, str]:
    """The verdict and its tone; for wrong data, whether any values may be used."""
    title, tone = words.VERDICTS[answer.diagnosis.verdict]
    if answer.diagnosis.verdict == Verdict.BAD_DATA:
        title = words.CORRECTED if enterable(answer) else words.UNUSABLE
    return title, tone


def _judged(answer: Answer) -> Headline | None:
    """Whether the deflection is within tolerance; None if no tolerance is judged."""
    worst = None if answer.tolerance is None else answer.tolerance.worst
    if answer.tolerance is None or worst is None:
        return None
    doubtful = words.VERDICTS[answer.diagnosis.verdict][1] == "bad"
    word, tone = words.JUDGED[worst, doubtful]
    return Headline(word, tone)


def _place(one: Section, look: Appearance) -> int:
    """Rank of a section in the order of the house; sections that it does not list come last."""
    return look.order.index(one.key) if one.key in look.order else len(look.order)


def _title(answer: Answer) -> str:
    """Title of the report."""
    if answer.of_positions:
        return f"Geometry and joint stiffness of {answer.robot}: {answer.campaign}"
    return f"Joint stiffness of {answer.robot}: {answer.campaign}"


def _about(answer: Answer) -> str:
    """Subject of the page: joint stiffness, absolute positions, or both."""
    if answer.of_positions:
        return "Where the robot stands"
    return f"Joint stiffness{' and where the robot stands' if answer.position_steps else ''}"
