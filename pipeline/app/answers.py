"""Finished answers in the form somebody asks for: page, PDF, numbers, text, two side by side."""

from __future__ import annotations

from pathlib import Path

from pipeline.answer import archive
from pipeline.app import pages
from pipeline.app.outcome import Outcome
from pipeline.base import files
from pipeline.base.errors import CannotWrite, UsageError
from pipeline.report.model import compose
from pipeline.report.render import page as as_page
from pipeline.report.text import as_text
from pipeline.run import run
from pipeline.store import campaign as campaigns


def report(root: Path, name: str | None, form: str) -> Path:
    """A report brought up to date: its page, PDF or numbers; without a name the page over all.

    Raises:
        UsageError: There is no finished campaign, or only campaigns have this form.
    """
    if name is None:
        if form != "html":
            raise UsageError(f"the page over all campaigns has no form {form}: name a campaign")
        page = pages.refresh(root)
        if page is None:
            raise UsageError("no campaign is finished: run `pipeline run` first")
        return page

    campaign = campaigns.find(root, name)
    run(campaign)
    pages.refresh(root)
    names = {"html": "index.html", "pdf": "report.pdf", "json": "result.json"}
    return campaign.reports / names[form]


def report_text(root: Path, name: str) -> str:
    """A campaign's report as plain text."""
    report(root, name, "html")
    campaign = campaigns.find(root, name)
    answer = archive.read(campaign)
    before = archive.earlier(campaign, answer)
    return as_text(compose(answer, archive.shown(campaign), previous=before))


def compare(root: Path, first: str, second: str) -> tuple[Outcome, Path | None]:
    """Two campaigns or models beside each other, and the page of it, where one can be kept."""
    said, content = pages.compare(root, first, second)
    path = root / "reports" / f"{first}--{second}.html".replace(":", ".").replace("/", ".")
    complaints: list[str] = []
    try:
        files.write(path, as_page(said, {}).encode())
    except CannotWrite as problem:  # the answer itself needs no page
        complaints.append(str(problem))
        return Outcome(
            f"{first}--{second}",
            content | {"page": None},
            as_text(said),
            exit_code=problem.exit_code,
            complaints=complaints,
        ), None
    return Outcome(
        f"{first}--{second}",
        content | {"page": str(path)},
        as_text(said),
        complaints=complaints,
    ), path
