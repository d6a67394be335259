"""Many campaigns in parallel: in processes of this machine, or on one without access to the folder.

With access, a process locks, computes and writes its campaign as a plain run does. Without, the
campaign's bytes are sent there and its results back; only this process holds the locks and writes.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from re import ASCII, fullmatch
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from pipeline.app.outcome import Meant, Outcome, Several, failed, named, outcome
from pipeline.base import files
from pipeline.base.errors import PipelineError, Unfinished, UsageError
from pipeline.base.shown import printable
from pipeline.service.executor import Executor, InProcesses, ItemResult
from pipeline.service.sync import misnamed
from pipeline.store.campaign import (
    MANIFEST,
    CampaignFolder,
    dump,
    find,
    in_memory,
    label,
    versions,
)

if TYPE_CHECKING:  # these types import the numerical libraries, which takes a second
    from pipeline.answer.contract import Answer


def executor(jobs: int | None, on: str | None) -> Executor | None:
    """The executor that the options ask for; None if they ask for none."""
    if on is None:
        return InProcesses(jobs) if jobs else None
    from pipeline.service.cluster import Cluster

    return Cluster(on)


def several(jobs: int | None, on: str | None) -> Several:
    """Function that processes many campaigns: in processes of this machine, or on a cluster."""
    return partial(outcomes, executor(jobs, on) or InProcesses())


def outcomes(
    executor: Executor, root: Path, everyone: Iterable[Meant], force: bool = False
) -> Iterator[Outcome]:
    """Yield the outcomes of campaigns as they finish; a failure does not stop the others."""
    if not executor.near:
        yield from _Abroad(root, executor, force).outcomes(everyone)
        return
    for done in executor.results(partial(_here, root, force), everyone):
        yield done.value or failed(_name(done.item), _problem(done))


def _here(root: Path, force: bool, one: Meant) -> Outcome:
    from pipeline.run import run

    return named(root, one, partial(outcome, compute=partial(run, force=force)))


def _name(one: Meant) -> str:
    return one.name if isinstance(one, CampaignFolder) else label(one)


def _problem(done: ItemResult[Meant, Outcome]) -> Exception:
    assert done.problem is not None  # an outcome is always truthy
    return done.problem


@dataclass(frozen=True)
class Parcel:
    """A campaign as sent to another machine.

    Attributes:
        name: Name of the campaign.
        key: Hash of its files, the code and the libraries here.
        files: Name relative to its folder -> bytes, of everything that campaign.toml names.
    """

    name: str
    key: str
    files: Mapping[str, bytes]


@dataclass(frozen=True)
class _Made:
    """Results of a parcel: content by file name, of tables with manifest, and of answers."""

    processed: Mapping[str, bytes]
    reports: Mapping[str, bytes]


def computed(parcel: Parcel) -> _Made:
    """Compute a campaign in a temporary project.

    Raises:
        PipelineError: As for `run`.
        UsageError: Code or libraries differ from those of the sender.
    """
    from pipeline.run import run

    with TemporaryDirectory(prefix="pipeline-") as folder:
        root = Path(folder).resolve()
        campaign = CampaignFolder(root, root / "data" / "raw" / parcel.name)
        for name, content in parcel.files.items():
            files.write(campaign.folder / name, content)
        if campaign.read().key != parcel.key:
            raise UsageError(
                f"the worker on {socket.gethostname()} has another version of the project or of "
                "its libraries: install the same one there, with the same requirements.lock"
            )
        run(campaign)
        return _Made(_within(campaign.processed), _within(campaign.reports))


def _within(folder: Path) -> dict[str, bytes]:
    """All files of a folder except hidden ones, such as its lock."""
    paths = [path for path in folder.rglob("*") if path.is_file() and path.name[0] != "."]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


class _Abroad:
    """Campaigns computed elsewhere, each locked until its answer is here."""

    def __init__(self, root: Path, executor: Executor, force: bool) -> None:
        self._root, self._executor, self._force = root, executor, force
        self._held: dict[str, tuple[CampaignFolder, ExitStack]] = {}
        self._known: list[Outcome] = []
        self._later: list[Meant] = []

    def outcomes(self, everyone: Iterable[Meant]) -> Iterator[Outcome]:
        """Yield outcomes as they finish, and those with nothing to compute in between."""
        try:
            for done in self._executor.results(computed, self._parcels(everyone)):
                campaign, held = self._held.pop(done.item.name)
                with held:
                    made = outcome(campaign, partial(_received, done))
                yield made
                yield from self._without_work()
        finally:
            for _, held in self._held.values():
                held.close()
        yield from self._without_work()
        if self._later:
            yield from _Abroad(self._root, self._executor, self._force).outcomes(self._later)

    def _without_work(self) -> list[Outcome]:
        known, self._known = self._known, []
        return known

    def _parcels(self, everyone: Iterable[Meant]) -> Iterator[Parcel]:
        """Yield the campaigns to be computed, each locked when it is sent."""
        for one in everyone:
            if _name(one) in self._held:  # its own lock would block it forever
                self._later.append(one)
                continue
            try:
                campaign = one if isinstance(one, CampaignFolder) else find(self._root, one)
            except Exception as problem:
                self._known.append(failed(_name(one), problem))
                continue
            if parcel := self._parcel(campaign):
                yield parcel

    def _parcel(self, campaign: CampaignFolder) -> Parcel | None:
        """A campaign as parcel; None if nothing is to be computed, with its outcome recorded."""
        from pipeline.answer.archive import read

        try:
            parcel = self._packed(campaign)
        except Exception as problem:
            self._known.append(outcome(campaign, partial(_refused, problem)))
            return None
        if parcel is None:
            self._known.append(outcome(campaign, read))
        return parcel

    def _packed(self, campaign: CampaignFolder) -> Parcel | None:
        """A campaign read and locked; None if its last run is still valid.

        Raises:
            PipelineError: It cannot be read or locked.
        """
        raw = campaign.read()
        if not self._force and campaign.done(raw.key):  # before any lock, as in `run`
            return None
        with ExitStack() as stack:
            if stack.enter_context(campaign.locked()):  # the other run may have computed it
                raw = campaign.read()
                if not self._force and campaign.done(raw.key):
                    return None
            self._held[campaign.name] = campaign, stack.pop_all()
        return Parcel(campaign.name, raw.key, dict(raw.files))


def _refused(problem: Exception, campaign: CampaignFolder) -> Answer:
    raise problem


def _received(done: ItemResult[Parcel, _Made], campaign: CampaignFolder) -> Answer:
    """Write the results received and return the answer; the caller holds the lock."""
    with campaign.remembering(done.item.key):
        made = _sent(done)
    answer, about, tables = _whole(made, done.item)
    for name, content in tables.items():
        files.write(campaign.processed / name, content)
    campaign.finish(done.item.key, made.reports, about)
    return answer


def _sent(done: ItemResult[Parcel, _Made]) -> _Made:
    """What a worker has made of a parcel.

    Raises:
        Unfinished: It failed for a reason that may be its machine's or ours, which shows here.
    """
    problem = done.problem
    if (
        problem is None
        or isinstance(problem, PipelineError | MemoryError)
        or files.refused(problem)
    ):
        return done.result
    words = printable(f"{type(problem).__name__}: {problem}", 200)
    way_out = "run it without --on: if that fails too, it leaves a report of the error to send"
    raise Unfinished(f"its worker failed ({words})", way_out) from problem


def _whole(made: _Made, parcel: Parcel) -> tuple[Answer, dict[str, Any], dict[str, bytes]]:
    """Answer, entries of the manifest and tables, if they are this parcel's and intact.

    Raises:
        Unfinished: They belong to another parcel, or were changed or truncated in transit.
    """
    from pipeline.answer.contract import Answer

    try:
        tables = dict(made.processed)
        manifest: dict[str, Any] = json.loads(tables.pop(MANIFEST))
        written = made.reports["result.json"]
        answer = Answer.model_validate(json.loads(written), strict=False)
        came = _hashes(f"data/processed/{parcel.name}", tables)
        came |= _hashes(f"reports/{parcel.name}", made.reports)
        run_time_s = float(manifest["run_time_s"])
        whole = (
            (manifest["key"], manifest["outputs"]) == (parcel.key, came)
            and (answer.campaign, dump(answer.as_json())) == (parcel.name, written)
            and _has_read(answer, parcel)
            and isfinite(run_time_s)
            and all(fullmatch(r"\w+\.parquet", name, ASCII) for name in tables)
            and not any(misnamed(name, made.reports) for name in made.reports)
        )
        about = {"run_time_s": run_time_s, **_about(manifest, answer, parcel)}
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError):
        whole = False
    if not whole:
        raise Unfinished(
            "what its worker has sent is not what is to be made of it",
            "run it again, and see to that worker's installation, memory and disk",
        )
    return answer, about, tables


def _hashes(folder: str, inside: Mapping[str, bytes]) -> dict[str, str]:
    """SHA-256 of each file by its path."""
    return {f"{folder}/{name}": files.sha256(content) for name, content in inside.items()}


def _has_read(answer: Answer, parcel: Parcel) -> bool:
    """Whether the answer is from the parcel's files, by the versions of this machine."""
    read = sorted((one.file, one.sha256, one.bytes) for one in answer.inputs)
    sent = [(name, files.sha256(data), len(data)) for name, data in parcel.files.items()]
    return (read, answer.versions) == (sorted(sent), versions())


def _about(manifest: Mapping[str, Any], answer: Answer, parcel: Parcel) -> dict[str, Any]:
    """Entries of the manifest: what this machine knows; what a page shows, by the worker's."""
    settings = in_memory(parcel.files).settings
    shown = {name: manifest.get(name) for name in ("look", "previous", "wear")}
    return {
        **{name: mark for name, mark in shown.items() if isinstance(mark, str | None)},
        "language": settings.language,
        "fields": settings.fields,
        "verdict": str(answer.diagnosis.verdict),
        "robot": answer.robot,
        "machine": answer.machine,
        "measured": answer.measured,
    }
