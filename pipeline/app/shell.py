"""What is done with campaigns, without a word about how it is typed or printed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.app import preferences, service, sync
from pipeline.app.outcome import EARLIER, Outcome, dated, failed, named, outcome, sentences
from pipeline.app.processes import sheltered
from pipeline.app.progress import Progress, Tell, told
from pipeline.base import files
from pipeline.base.errors import InputError, PipelineError, UsageError
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import Campaign

if TYPE_CHECKING:  # its types bring the numerical libraries, which take a second
    from pipeline.answer.contract import Answer


def run_all(root: Path, names: list[str], engine: str, force: bool) -> Iterator[Outcome]:
    """Bring campaigns up to date; one that fails stops none of the others."""
    storage = preferences.load(root).storage
    refused = sync.fetch(root, storage)
    yield from refused
    everyone = names or campaigns.every(root)
    if not everyone and not refused:
        raise no_campaign(root)
    compute = plainly if engine == "local" else _through_prefect
    with Progress(len(everyone)) as bar:
        work = partial(outcome, compute=partial(compute, force=force, tell=bar.at))
        for one in everyone:
            bar.now(one.name if isinstance(one, Campaign) else campaigns.label(one))
            done = named(root, one, work)
            bar.done()
            yield done
    from pipeline.app import pages

    pages.refresh(root)
    yield from sync.publish(root, storage)


def no_campaign(root: Path) -> InputError:
    """What to say where there is nothing to do."""
    return InputError(
        f"there is no campaign under {(root / 'data' / 'raw').absolute()}",
        "go to the project's folder or name it with --root; a new campaign begins with "
        "`pipeline init NAME` or `pipeline simulate`",
    )


def plainly(campaign: Campaign, force: bool = False, tell: Tell = str) -> Answer:
    """Bring a campaign up to date in this process."""
    from pipeline.run import run

    return run(campaign, partial(told, tell), force)


def _through_prefect(campaign: Campaign, force: bool, tell: Tell) -> Answer:
    """Bring a campaign up to date as a Prefect flow, unless nothing is to be done."""
    if campaign.current() and not force:  # also says what no engine can read
        from pipeline.answer.archive import read

        return read(campaign)
    home = campaign.root / service.HOME
    with files.writing(home):
        home.mkdir(parents=True, exist_ok=True)
    service.has_room(home)
    service.settle(campaign.root)
    from pipeline.app.flow import identified, telling  # importing Prefect takes two seconds

    with telling(tell), sheltered(signal.SIGUSR1):
        return identified(campaign, force)


def check(root: Path, name: str) -> Outcome:
    """Ingest a campaign and say what would be used; write nothing."""
    return named(root, name, _check)


def _check(campaign: Campaign) -> Outcome:
    from pipeline.answer.inputs import rejected_entries
    from pipeline.machine.effect import HUNG, MOUNTED
    from pipeline.reduction.bring import conformed
    from pipeline.run import reduce

    name, reduced = campaign.name, reduce(campaign.read(), conformed)
    rejected = rejected_entries(reduced.shown["rejected"])
    used = {
        "readings": len(reduced.shown["readings"]),
        "poses": len(set(reduced.data.pulls.pose)),
        "pulls": len(reduced.data.pulls),
        "displacements": len(reduced.data.delta),
        "rejected": len(rejected),
    }
    by = reduced.data.pulls.by
    kinds = {"weights": int((by == HUNG).sum()), "payloads": int((by == MOUNTED).sum())}
    used |= {what: count for what, count in kinds.items() if count}
    text = f"{name}: " + ", ".join(f"{count} {what}" for what, count in used.items())
    return Outcome(
        campaign=name,
        content={"campaign": name, **used},
        text=text,
        exit_code=InputError.exit_code if rejected else 0,
        complaints=[f"{name}: {line}" for line in sentences(rejected)],
    )


def inspect(path: Path, unit: str | None, csv: bool = False) -> Outcome:
    """Say what a tracker export is, or with `csv` give its readings in SI.

    A campaign.toml beside it says what the export does not.
    """
    from pipeline.answer.contract import Rejected
    from pipeline.readers import LARGEST_FILE, refuse_other_programs
    from pipeline.readers.inspect import as_csv
    from pipeline.readers.inspect import inspect as look

    try:
        none = InputError("there is no such file", "correct the path", file=str(path))
        begins = partial(refuse_other_programs, path.name)
        data = files.read(path, path.name, LARGEST_FILE, none, begins)
        hints = _hints(Campaign(path.parent, path.parent), unit)
        seen = look(path.name, data, hints)
        text = as_csv(path.name, data, hints).decode().rstrip("\n") if csv else seen.to_text()
    except PipelineError as problem:
        refused = failed(path.name, problem)
        content = {"file": path.name, "error": refused.content["error"]}
        return replace(refused, content=content, complaints=[str(problem)])
    return Outcome(
        campaign=path.name,
        content=seen.to_json(),
        text=text,
        exit_code=InputError.exit_code if seen.rejected else 0,
        complaints=sentences(Rejected(file=path.name, **entry) for entry in seen.rejected),
    )


def _hints(folder: Campaign, unit: str | None) -> Any:
    from pipeline.readers import Hints

    there = (folder.folder / "campaign.toml").is_file()
    said = (folder.settings().tracker if there else None) or Hints()
    return said.model_copy(update={"unit": unit or said.unit})


def status(root: Path) -> Iterator[Outcome]:
    """State of every campaign under data/raw."""
    for campaign in campaigns.every(root):
        yield dated(campaign, _status)


def _status(campaign: Campaign) -> Outcome:
    before, key = campaign.manifest(), campaign.read().key
    if before is not None and campaign.done(key):
        return _standing(campaign, "done", before.get("verdict"))
    rejected = campaign.rejection(key)
    if rejected is None:
        return _standing(campaign, "changed" if before else "new", None)
    told = failed(campaign.name, rejected)
    content = {"campaign": campaign.name, "state": "rejected", "verdict": None}
    return replace(told, content=told.content | content, text=f"{campaign.name:24} rejected")


def _standing(campaign: Campaign, state: str, verdict: str | None) -> Outcome:
    """A campaign that was not rejected; the report of another input is said to be one."""
    content = {"campaign": campaign.name, "state": state, "verdict": verdict}
    report = campaign.reports / "index.html"
    shown = str(report) if report.is_file() else ""
    if shown and state != "done":
        content |= {"earlier_report": shown}
        shown += f" ({EARLIER})"
    text = f"{campaign.name:24} {state:8} {verdict or '':12} {shown}".rstrip()
    return Outcome(campaign.name, content, text)


def report(root: Path, name: str | None, form: str) -> Path:
    """A report brought up to date: its page, PDF or numbers; without a name the page over all.

    Raises:
        UsageError: There is no finished campaign, or only campaigns have this form.
    """
    from pipeline.app import pages
    from pipeline.run import run

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
    from pipeline.answer import archive
    from pipeline.report.model import compose
    from pipeline.report.text import as_text

    report(root, name, "html")
    campaign = campaigns.find(root, name)
    answer = archive.read(campaign)
    before = archive.earlier(campaign, answer)
    return as_text(compose(answer, archive.shown(campaign), previous=before))
