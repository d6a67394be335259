"""Operations on campaigns, independent of how they are typed and printed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.app.outcome import Meant, Outcome, Several, named, outcome
from pipeline.app.progress import Progress, Tell, reporting
from pipeline.base import files
from pipeline.base.doors import found, is_there, opened
from pipeline.base.errors import InputError, UsageError
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import CampaignFolder

if TYPE_CHECKING:  # importing its types loads the numerical libraries, which takes a second
    from pipeline.answer.contract import Answer

_PREFECT = "pipeline.service.engine:through_prefect"
"""Door: brings a campaign up to date as a Prefect flow."""
_TEXT = "pipeline.annex.text:as_text"
"""Door: a report as plain text."""
_STORAGE = "pipeline.library.preferences:storage"
"""Door: the object storage that pipeline.toml states, None without one."""

_FETCH, _PUBLISH = "pipeline.service.sync:fetch", "pipeline.service.sync:publish"
"""Doors: copy campaigns from object storage to this machine and back."""


def usual_engine() -> str:
    """Default engine of a run: Prefect if the service is installed, otherwise local."""
    return "prefect" if is_there(_PREFECT) else "local"


def run_all(
    root: Path, names: list[str], engine: str, force: bool, several: Several | None = None
) -> Iterator[Outcome]:
    """Bring campaigns up to date; one that fails does not stop the others.

    Args:
        root: Root of the project.
        names: Names or paths of the campaigns; all if empty.
        engine: `local` or `prefect`.
        force: Compute even if nothing has changed.
        several: Processes several campaigns at a time; None to compute them here one by one.

    Raises:
        InputError: There is no campaign.
    """
    storage = found(_STORAGE)
    copies = storage(root) if storage else None
    refused = opened(_FETCH)(root, copies) if copies else []
    yield from refused
    everyone = names or campaigns.every(root)
    if not everyone and not refused:
        raise no_campaign(root)
    with Progress(len(everyone)) as bar:
        if several is None:
            yield from _one_by_one(root, everyone, engine, force, bar)
        else:
            bar.now("several at a time")
            for done in several(root, everyone, force):
                bar.done()
                yield done
                bar.now("several at a time")
    from pipeline.answer import archive

    archive.refresh(root)
    if copies:
        yield from opened(_PUBLISH)(root, copies)


def _one_by_one(
    root: Path, everyone: Iterable[Meant], engine: str, force: bool, bar: Progress
) -> Iterator[Outcome]:
    compute = _plainly if engine == "local" else opened(_PREFECT)
    work = partial(outcome, compute=partial(compute, force=force, tell=bar.at))
    for one in everyone:
        bar.now(one.name if isinstance(one, CampaignFolder) else campaigns.label(one))
        done = named(root, one, work)
        bar.done()
        yield done


def no_campaign(root: Path) -> InputError:
    """Error for a project without campaigns."""
    return InputError(
        f"there is no campaign under {(root / 'data' / 'raw').absolute()}",
        "go to the project's folder or name it with --root; a new campaign begins with "
        "`pipeline init NAME` or `pipeline simulate`",
    )


def _plainly(campaign: CampaignFolder, force: bool = False, tell: Tell = str) -> Answer:
    """Bring a campaign up to date in this process."""
    from pipeline.run import run

    return run(campaign, partial(reporting, tell), force)


def report(root: Path, name: str | None, form: str, language: str | None = None) -> Path:
    """Bring a report up to date, and return the path of its page, PDF or numbers.

    Args:
        root: Root of the project.
        name: Name or path of the campaign; None for the page over all campaigns.
        form: html, pdf or json.
        language: Language of a further certificate, in addition to that of the project.

    Raises:
        UsageError: There is no finished campaign, or the page over all campaigns does not exist
            in this form or language.
    """
    from pipeline.answer import archive
    from pipeline.run import run

    if name is None:
        if form != "html" or language:
            lacks = "further language" if form == "html" else f"form {form}"
            raise UsageError(f"the page over all campaigns has no {lacks}: name a campaign")
        page = archive.refresh(root)
        if page is None:
            raise UsageError("no campaign is finished: run `pipeline run` first")
        return page

    campaign = campaigns.find(root, name)
    run(campaign)
    archive.refresh(root)
    names = {"html": "index.html", "pdf": "report.pdf", "json": "result.json"}
    if language is None:
        return campaign.reports / names[form]
    return _in_language(root, campaign, names[form], language)


def _in_language(root: Path, campaign: CampaignFolder, name: str, language: str) -> Path:
    """Write the report with its certificate in another language, in a folder below its own."""
    from pipeline.answer import archive
    from pipeline.base.appearance import appearances
    from pipeline.report.render import render

    answer, manifest = archive.read(campaign), campaign.manifest() or {}
    look = appearances(root)(manifest | {"language": language}, answer)
    others, took = archive.among(campaign, answer), manifest.get("run_time_s")
    shown = archive.kept_tables(campaign)
    pages = render(answer, shown, took, others.previous, (), others.wear, look)
    files.write(campaign.reports / language / name, pages[name])
    return campaign.reports / language / name


def report_text(root: Path, name: str) -> str:
    """A campaign's report as plain text."""
    from pipeline.answer import archive
    from pipeline.report.model import compose

    report(root, name, "html")
    campaign = campaigns.find(root, name)
    answer = archive.read(campaign)
    others, shown = archive.among(campaign, answer), archive.kept_tables(campaign)
    whole = compose(answer, shown, previous=others.previous, wear=others.wear)
    text: str = opened(_TEXT)(whole)
    return text
