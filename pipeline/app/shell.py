"""What is done with campaigns, without a word about how it is typed or printed."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.app.many import Meant, outcomes
from pipeline.app.outcome import EARLIER, Outcome, dated, failed, named, outcome, sentences
from pipeline.app.progress import Progress, Tell, told
from pipeline.base import files, preferences
from pipeline.base.doors import is_there, opened
from pipeline.base.errors import InputError, PipelineError, UsageError
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import Campaign

if TYPE_CHECKING:  # its types bring the numerical libraries, which take a second
    from pipeline.answer.contract import Answer
    from pipeline.base.executor import Executor

PREFECT = "pipeline.service.engine:through_prefect"
"""Brings a campaign up to date as a Prefect flow."""
FETCH, PUBLISH = "pipeline.service.sync:fetch", "pipeline.service.sync:publish"
"""Campaigns that live on object storage, to this machine and back."""


def usual_engine() -> str:
    """What carries out a run where nobody says: Prefect, where the service is there."""
    return "prefect" if is_there(PREFECT) else "local"


def run_all(
    root: Path, names: list[str], engine: str, force: bool, executor: Executor | None = None
) -> Iterator[Outcome]:
    """Bring campaigns up to date; one that fails stops none of the others.

    Args:
        root: The project's root.
        names: Which, by name or path; all when none is named.
        engine: `local` or `prefect`.
        force: Compute even if nothing has changed.
        executor: Who computes several at a time; None: here, one after another.
    """
    storage = preferences.load(root).storage
    refused = list[Outcome]() if storage == preferences.Storage() else opened(FETCH)(root, storage)
    yield from refused
    everyone = names or campaigns.every(root)
    if not everyone and not refused:
        raise no_campaign(root)
    with Progress(len(everyone)) as bar:
        if executor is None:
            yield from _one_by_one(root, everyone, engine, force, bar)
        else:
            bar.now("several at a time")
            for done in outcomes(root, everyone, executor, force):
                bar.done()
                yield done
                bar.now("several at a time")
    from pipeline.answer import archive

    archive.refresh(root)
    if storage != preferences.Storage():
        yield from opened(PUBLISH)(root, storage)


def _one_by_one(
    root: Path, everyone: Iterable[Meant], engine: str, force: bool, bar: Progress
) -> Iterator[Outcome]:
    compute = plainly if engine == "local" else opened(PREFECT)
    work = partial(outcome, compute=partial(compute, force=force, tell=bar.at))
    for one in everyone:
        bar.now(one.name if isinstance(one, Campaign) else campaigns.label(one))
        done = named(root, one, work)
        bar.done()
        yield done


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


def check(root: Path, name: str) -> Outcome:
    """Read a campaign, say what would be used and which line is wrong; write nothing."""
    from pipeline.app.check import check as look

    return named(root, name, look)


def inspect(
    path: Path,
    said: Mapping[str, Any],
    csv: bool = False,
    mapping: Path | None = None,
    ask: Ask | None = None,
) -> Outcome:
    """Say what a tracker export or a log is, or with `csv` give an export's readings in SI.

    A campaign.toml beside it says what the export does not; what is left open is asked, or said
    with an answer to paste.

    Args:
        path: The export.
        said: What [tracker] would say, by its keys; None where nobody says it.
        csv: Whether to give its readings.
        mapping: A file with [tracker.mapping] to try.
        ask: Answers a question; None where nobody can be asked.
    """
    from pipeline.answer.contract import Rejected
    from pipeline.readers import largest, refuse_other_programs
    from pipeline.readers.inspect import as_csv
    from pipeline.readers.inspect import inspect as look
    from pipeline.readers.known import settled
    from pipeline.readers.logs import refuse_without_poses

    data, hints = b"", None
    try:
        none = InputError("there is no such file", "correct the path", file=str(path))
        begins = partial(refuse_other_programs, path.name)
        data = files.read(path, path.name, largest(path.name), none, begins)
        folder = Campaign(path.parent, path.parent)
        if not (csv or mapping or any(said.values())):
            if log := _log(path, data, folder):
                return log
            refuse_without_poses(path.name, data)
        hints, bodies = _hints(folder, said, mapping)
        hints, why = settled(path.name, data, hints, bodies)
        hints = _answered(path.name, data, hints, ask)
        seen = replace(look(path.name, data, hints), settled=list(why))
        text = as_csv(path.name, data, hints).decode().rstrip("\n") if csv else seen.to_text()
    except PipelineError as problem:
        return _unread(path.name, data, hints, problem)
    return Outcome(
        campaign=path.name,
        content=seen.to_json(),
        text=text,
        exit_code=InputError.exit_code if seen.rejected else 0,
        complaints=sentences(Rejected(file=path.name, **entry) for entry in seen.rejected),
    )


def _log(path: Path, data: bytes, folder: Campaign) -> Outcome | None:
    """What a file is that is a log beside the exports, None where it is none."""
    from pipeline.app.blank import log_lines
    from pipeline.reduction.which_logs import propose_logs

    robots = {}
    for one in sorted(path.parent.glob("*.toml")):
        with contextlib.suppress(InputError):  # what cannot be read is no robot that matters here
            robots[one.name] = folder.content(one.name)
    said = propose_logs(robots | {path.name: data})
    if not (said.loads or said.joints):
        return None
    what = "log of loads" if said.loads else "joint log"
    facts = {"dialect": what} | ({"robots": ", ".join(said.robots)} if said.joints else {})
    lines = [path.name, *(f"  {name:12} {fact}" for name, fact in facts.items())]
    proposal = "\n".join(log_lines(said, _named_robot(robots.get("campaign.toml", b""))))
    content = {"file": path.name, **facts, "proposal": proposal}
    return Outcome(path.name, content, "\n".join([*lines, "", proposal]))


def _named_robot(data: bytes) -> str | None:
    """The robot that a campaign.toml names; None where it names none, or cannot be read."""
    from pipeline.base import toml

    with contextlib.suppress(InputError):
        return str(toml.loads(files.text(data, "campaign.toml"), "campaign.toml").get("robot"))
    return None


Ask = Callable[[Any], Mapping[str, Any]]
"""What [tracker] says in answer to the question of a `readers.offer.Offer`."""


def _hints(folder: Campaign, said: Mapping[str, Any], mapping: Path | None) -> Any:
    """What campaign.toml, a mapping to try and the command line say, the last before the first.

    And the reflectors whose places campaign.toml has; while it is still to be filled in, none.
    """
    from pipeline.base import toml
    from pipeline.readers import Hints

    known, bodies = Hints(), []
    if (folder.folder / "campaign.toml").is_file():
        known = _words(folder.content("campaign.toml"), "campaign.toml", known)
        with contextlib.suppress(InputError):
            bodies = folder.settings().bodies
    if mapping is not None:
        none = InputError("there is no such file", "correct --mapping", file=str(mapping))
        known = _words(files.read(mapping, mapping.name, toml.LARGEST, none), mapping.name, known)
    given = {word: value for word, value in said.items() if value is not None}
    return known.model_copy(update=given), bodies


def _words(data: bytes, name: str, known: Any) -> Any:
    """What is known of how an export is read, with what [tracker] of a file says of it."""
    from pipeline.base import toml
    from pipeline.base.strict import checked
    from pipeline.readers import Hints

    tracker = toml.loads(files.text(data, name), name).get("tracker", {})
    if not isinstance(tracker, dict):
        raise InputError("tracker is no table", "write [tracker], and its keys below", file=name)
    words = {word: tracker[word] for word in Hints.model_fields if word in tracker}
    tried = checked(Hints, words, name, "[tracker]", "correct it")
    return known.model_copy(update={word: getattr(tried, word) for word in words})


def _answered(name: str, data: bytes, hints: Any, ask: Ask | None) -> Any:
    """What is said of an export, with all that it leaves open asked."""
    from pipeline.readers.offer import offer

    found = None
    while ask is not None and (found := offer(name, data, hints)) and found.question:
        hints = hints.model_copy(update=dict(ask(found)))
    return found.hints if found and hints.mapping else hints


def _unread(name: str, data: bytes, hints: Any, problem: PipelineError) -> Outcome:
    """Why an export cannot be read, and what can be pasted for it to be."""
    from pipeline.readers.inspect import offer_in_words
    from pipeline.readers.offer import offer

    refused = failed(name, problem)
    content = {"file": name, "error": refused.content["error"]}
    try:
        found = offer(name, data, hints) if hints is not None else None
    except PipelineError:
        found = None
    text = offer_in_words(name, found) if found else refused.text
    return replace(
        refused,
        content=content | (found.to_json() if found else {}),
        text=text,
        complaints=[str(problem)],
    )


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
    from pipeline.answer import archive
    from pipeline.run import run

    if name is None:
        if form != "html":
            raise UsageError(f"the page over all campaigns has no form {form}: name a campaign")
        page = archive.refresh(root)
        if page is None:
            raise UsageError("no campaign is finished: run `pipeline run` first")
        return page

    campaign = campaigns.find(root, name)
    run(campaign)
    archive.refresh(root)
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
    wear = archive.together(answer, root)
    return as_text(compose(answer, archive.shown(campaign), previous=before, wear=wear))
