"""The stages of run.py as a Prefect flow: one task per stage, with artifacts at the end.

This file and gate.py are the only ones that import Prefect, which takes seconds. `server.settle`
must be called before the import, since Prefect then reads its settings.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
import warnings
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import httpx
from prefect import artifacts, flow, runtime, tags, task
from prefect.cache_policies import NO_CACHE
from prefect.client.orchestration import get_client
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.client.schemas.filters import FlowFilter, FlowRunFilter
from prefect.client.schemas.objects import State, StateType
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectAlreadyExists, ObjectNotFound, PrefectException
from prefect.schedules import Cron
from prefect.states import Completed, Crashed, Failed, Scheduled
from prefect.types.entrypoint import EntrypointType

from pipeline.answer.archive import read
from pipeline.answer.contract import Answer
from pipeline.answer.remarks import stiffness_text
from pipeline.app.outcome import Outcome, failed
from pipeline.app.progress import Tell, reporting
from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError, PipelineError, Unfinished, UsageError
from pipeline.base.shown import printable
from pipeline.library.preferences import Service, load
from pipeline.run import run
from pipeline.service import server as service
from pipeline.service import watch
from pipeline.service.current import current
from pipeline.service.guard import Guard
from pipeline.service.processes import PARENT, REPORTS_URL, ROOT, event, follow, log
from pipeline.store.campaign import CampaignFolder, every, find

_TAG = "campaign"
"""Tag of the task that computes: a Prefect limit for `tag:campaign` holds for the whole team."""

_DEPLOYED = "data-raw"
_ATTEND = f"run-campaign/{_DEPLOYED}"

_SETTLES_S = 30.0
"""Age from which a running flow either holds its campaign or has abandoned it [s]; allows for
differences between clocks."""


def _named() -> str:
    return Path(runtime.flow_run.parameters["campaign"]).name


@flow(name="identify-stiffness", flow_run_name=_named, persist_result=False)
def _identify(root: str, campaign: str, force: bool = False) -> Answer:
    """Run every stage of one campaign as a Prefect task and return its answer."""
    found = find(Path(root), campaign)
    try:
        answer = run(found, step=_as_task, force=force)
    except PipelineError as problem:  # a one-sentence message, which needs no traceback
        refused: Any = _refused(problem)
        return refused
    _publish(found, answer)
    return answer


def _refused(problem: PipelineError) -> State[Any]:
    return Failed(message=str(problem), data=problem)


@flow(name="scan-campaigns", flow_run_name="scan", persist_result=False)
def scan(hand_out: bool = False) -> None:
    """Run every campaign under data/raw that is new or changed and complete, each as a flow.

    Where another one is at work this has nothing to do. A lock says so, which ends with its
    process: Prefect's limit of runs keeps the place of one whose worker was killed before it began,
    for ever where its server was killed, too.

    Args:
        hand_out: Leave them to the workers of the pool, instead of one after another here.

    Raises:
        UsageError: PIPELINE_ROOT does not say where the project is.
    """
    if PARENT in os.environ:
        follow(int(os.environ[PARENT]))
    root = _root()
    with service.looking(root) as first:
        if first:
            _look(root, hand_out)


def _look(root: Path, hand_out: bool) -> None:
    _drop_late()
    outcomes = []
    for made in _scanned(root, hand_out):
        if made.exit_code == Unfinished.exit_code:
            _crashed(made)
        log(event(made))
        outcomes.append(made)
        _drop_late()
    if outcomes:
        artifacts.create_markdown_artifact(key="scan", markdown=_summary(outcomes))


def _root() -> Path:
    """Root of the project, taken from the environment of this process only.

    Whoever can reach Prefect's API can choose the parameters of a flow.
    """
    if not os.environ.get(ROOT):
        raise UsageError(f"{ROOT} is not set: start the worker with {ROOT}=/path/to/the/project")
    return Path(os.environ[ROOT])


def _scanned(root: Path, hand_out: bool) -> Iterator[Outcome]:
    try:
        preferences = load(root)
    except InputError as problem:  # somebody has edited it in the meantime
        yield from watch.reported_once(root, [failed(watch.SERVICE, problem)])
        return
    if hand_out := hand_out and preferences.storage.raw is None:  # only this one has copies
        _take_up(root)
    with Guard(root, "prefect", preferences.service) as guard:
        yield from watch.scan(root, preferences, _Pool(guard) if hand_out else guard)


def _take_up(root: Path) -> None:
    """Begin those runs of campaigns again that a worker which is gone has left, and end its looks.

    Whoever calls this looks alone.
    """
    begun = FlowRunFilter.model_validate(
        {"state": {"type": {"any_": [StateType.PENDING, StateType.RUNNING]}}}
    )
    own = FlowFilter.model_validate({"name": {"any_": [attend.name]}})
    known = {one.name: one for one in every(root)}
    with get_client(sync_client=True) as client:
        for run in client.read_flow_runs(flow_filter=own, flow_run_filter=begun, limit=200):
            campaign = known.get(run.parameters["campaign"])
            if run.state and _left(run.state, campaign):
                client.set_flow_run_state(run.id, Scheduled(name="Again"), force=True)
        looks = FlowFilter.model_validate({"name": {"any_": [scan.name]}})
        for run in client.read_flow_runs(flow_filter=looks, flow_run_filter=begun, limit=200):
            if run.state and str(run.id) != runtime.flow_run.id and _left(run.state, None):
                gone: State[Any] = Crashed(message="Its worker is gone.")
                client.set_flow_run_state(run.id, gone, force=True)


def _left(state: State[Any], campaign: CampaignFolder | None) -> bool:
    """Whether a run that has begun was abandoned; the campaign is None if it no longer exists."""
    patience_s = _SETTLES_S if state.type == StateType.RUNNING else service.PATIENCE_S
    age_s = (datetime.now(UTC) - state.timestamp).total_seconds()
    return age_s > patience_s and (campaign is None or not watch.attended(campaign))


@dataclass(frozen=True)
class _Pool:
    """Hands campaigns out to the workers of a pool, one flow run for each.

    A run is identified by what it was handed out for: the files of its campaign, the code, and the
    number of failures with these. So nothing is handed out twice; if a run has ended and something
    remains to be done, such as a report that somebody has removed, the run is started once more.
    """

    guard: Guard

    def campaign(self, campaign: CampaignFolder) -> None:
        """Hand out one campaign, unless this was done before."""
        seen, before = watch.fingerprint(campaign.folder), watch.recall(campaign)
        failures = before.attempts if before.print == seen else 0
        known = files.sha256(f"{campaign.name}\n{seen}\n{failures}".encode())
        run: Any = run_deployment(
            _ATTEND,
            parameters={"campaign": campaign.name, "seen": seen},
            idempotency_key=known,
            flow_run_name=campaign.name,
            tags=[_TAG],
            timeout=0,
            as_subflow=False,
        )
        if run.state.is_final() and run.state.type != StateType.CANCELLED:  # the user's wish
            with get_client(sync_client=True) as client:
                client.set_flow_run_state(run.id, Scheduled(name="Again"), force=True)

    def pages(self) -> Outcome | None:
        """Update the page over all campaigns, which this worker draws."""
        return self.guard.pages()


@flow(name="run-campaign", flow_run_name=_named, persist_result=False)
def attend(campaign: str, seen: str) -> Any:
    """Bring a campaign up to date that was handed out, within the limits of time and memory.

    Args:
        campaign: Name under data/raw.
        seen: Fingerprint with which it was handed out.
    """
    root = _root()
    found = {one.name: one for one in every(root)}.get(campaign)
    if found is None:
        return Failed(message=f"There is no campaign {printable(campaign, 80)} any more.")
    with tags(_TAG), Guard(root, "local", load(root).service) as guard:
        made = watch.attend(found, seen, _Slot(guard))
    if made is None:
        return Completed(message="It has changed since, or is done; the next scan sees to it.")
    log(event(made))
    if made.verdict is None:
        return (Crashed if made.exit_code == Unfinished.exit_code else Failed)(message=event(made))
    _publish(found, read(found))
    return Completed(message=event(made))


@dataclass(frozen=True)
class _Slot:
    """Works on a campaign while it holds one of the slots of `_TAG`, if these are limited."""

    guard: Guard

    def campaign(self, campaign: CampaignFolder) -> Outcome:
        """Process one campaign as a task."""
        carried_out = task(name="compute", cache_policy=NO_CACHE, persist_result=False)(
            self.guard.campaign
        )
        made: Outcome = carried_out(campaign)
        return made

    def pages(self) -> None:
        """Do nothing: the scan updates the page."""


def within(campaign: CampaignFolder) -> Answer:
    """Answer of a campaign, by a flow of its own unless its last run is still current."""
    campaign.fit()  # a campaign whose name cannot be shown gets no run
    with contextlib.suppress(InputError):  # an unreadable one gets a visible run, too
        if current(campaign):
            return read(campaign)
    return identified(campaign)


def identified(campaign: CampaignFolder, force: bool = False) -> Answer:
    """Answer of a campaign, by a run that Prefect shows.

    Raises:
        PipelineError: As in `run`.
        CannotWrite: Prefect's server cannot store the run.
    """
    try:
        answer: Answer = _result(_identify(str(campaign.root), str(campaign.folder), force))
    except (httpx.HTTPError, PrefectException, RuntimeError) as problem:
        ours = isinstance(problem, RuntimeError)
        if ours and not re.search("Prefect|Failed to reach API", str(problem)):
            raise
        raise CannotWrite(
            f"Prefect's server does not keep this run ({problem}); see that the machine is not "
            "overloaded and its disk has room, and run it again, or use --engine local."
        ) from problem
    return answer


def _result(made: Any) -> Any:
    """Result of a flow or a task; Prefect passes on a state that was returned as it is."""
    return made.result() if isinstance(made, State) else made


def _crashed(made: Outcome) -> None:
    """Mark on Prefect's server the run as crashed whose process could not report it."""
    ended: State[Any] = Crashed(message=made.complaints[0])
    running = FlowRunFilter.model_validate(
        {"state": {"type": {"any_": [StateType.RUNNING]}}, "name": {"any_": [made.campaign]}}
    )
    with contextlib.suppress(httpx.HTTPError), get_client(sync_client=True) as client:
        for run in client.read_flow_runs(flow_run_filter=running):
            client.set_flow_run_state(run.id, ended, force=True)


def _drop_late() -> None:
    """Delete scans that were due while this one is at work: the next one covers them."""
    late = FlowRunFilter.model_validate(
        {
            "state": {"type": {"any_": [StateType.SCHEDULED]}},
            "expected_start_time": {"before_": datetime.now(UTC)},
        }
    )
    own = FlowFilter.model_validate({"name": {"any_": [scan.name]}})
    # what is not deleted now is deleted next time
    with contextlib.suppress(httpx.HTTPError, ObjectNotFound), get_client(sync_client=True) as api:
        while found := api.read_flow_runs(flow_filter=own, flow_run_filter=late, limit=200):
            for run in found:
                api.delete_flow_run(run.id)


def _summary(outcomes: list[Outcome]) -> str:
    rows = [
        f"| {_cell(one.campaign)} | {watch.verdict_of(one)} | {_cell('; '.join(one.complaints))} |"
        for one in outcomes
    ]
    return "\n".join(["| campaign | verdict | complaints |", "|---|---|---|", *rows])


def _cell(text: str) -> str:
    """Foreign text for a Markdown table, with special characters made harmless."""
    plain = printable(text).replace("|", "/").replace("`", "'")
    return f"`{plain}`" if plain else " "


def serve(wanted: Service) -> None:
    """Scan on a schedule, one scan at a time, until this process is told to stop."""
    _clear()
    with warnings.catch_warnings():  # Prefect misses an await when it stops on SIGTERM
        warnings.filterwarnings("ignore", "coroutine 'Runner.astop' was never awaited")
        scan.serve(
            limit=1,
            pause_on_shutdown=False,
            print_starting_message=False,
            **_planned(wanted),
        )


def deploy(pool: str, wanted: Service) -> None:
    """Register the scan on the server of PREFECT_API_URL, to be run by the workers of a pool."""
    with get_client(sync_client=True) as client, contextlib.suppress(ObjectAlreadyExists):
        client.create_work_pool(WorkPoolCreate(name=pool, type="process"))
    place: Any = {"entrypoint_type": EntrypointType.MODULE_PATH, "work_pool_name": pool}
    looks: Any = scan.to_deployment(parameters={"hand_out": True}, **place, **_planned(wanted))
    campaigns: Any = attend.to_deployment(_DEPLOYED, **place)
    for deployment in (campaigns, looks):
        deployment.apply()


def _planned(wanted: Service) -> dict[str, Any]:
    """Name and schedule of the scan."""
    if wanted.cron:  # local time including daylight saving; Prefect would use UTC
        return {"name": _DEPLOYED, "schedule": Cron(wanted.cron, timezone=_zone())}
    return {"name": _DEPLOYED, "interval": wanted.interval_s}


def _zone() -> str:
    """Name of this machine's time zone; UTC if it has none."""
    here = os.path.realpath("/etc/localtime").rpartition("/zoneinfo/")[2]
    for name in (os.environ.get("TZ", "").removeprefix(":"), here):
        with contextlib.suppress(ZoneInfoNotFoundError, ValueError, OSError):
            return ZoneInfo(name).key
    return "UTC"


def _clear() -> None:
    """Mark runs that a killed service left as crashed, and delete the scans that it missed."""
    open_states = [StateType.RUNNING, StateType.PENDING, StateType.SCHEDULED, StateType.CANCELLING]
    left = FlowRunFilter.model_validate({"state": {"type": {"any_": open_states}}})
    with get_client(sync_client=True) as client:
        while found := client.read_flow_runs(flow_run_filter=left, limit=200):
            for run in found:
                if run.state is not None and run.state.type == StateType.SCHEDULED:
                    client.delete_flow_run(run.id)
                else:
                    client.set_flow_run_state(run.id, Crashed(message="killed"), force=True)


_LISTENER: ContextVar[Tell] = ContextVar("listener", default=str)


@contextlib.contextmanager
def telling(tell: Tell) -> Iterator[None]:
    """Report every stage to `tell` in the block; a flow's arguments would go to the server."""
    before = _LISTENER.set(tell)
    try:
        yield
    finally:
        _LISTENER.reset(before)


def _as_task(stage: Callable[..., Any]) -> Callable[..., Any]:
    """One stage as a task; Prefect's cache is off, as our manifest decides what is current."""
    reading = stage.__name__ == "read"  # a share that was away for a moment; nothing else heals

    @functools.wraps(stage)
    def quietly(*given: Any, **named: Any) -> Any:
        try:
            return stage(*given, **named)
        except PipelineError as problem:
            if reading and getattr(problem, "passing", False):
                raise
            return _refused(problem)

    carried_out = task(
        name=stage.__name__,
        cache_policy=NO_CACHE,
        persist_result=False,
        retries=2 if reading else 0,
        retry_delay_seconds=2,
        retry_condition_fn=_may_heal,
    )(quietly)
    return reporting(_LISTENER.get(), lambda *given, **named: _result(carried_out(*given, **named)))


def _may_heal(task: Any, run: Any, state: Any) -> bool:
    problem = state.result(raise_on_failure=False)
    return isinstance(problem, InputError) and problem.passing


def _publish(campaign: CampaignFolder, answer: Answer) -> None:
    """Publish the result table and a link to the report as Prefect artifacts."""
    key = "".join(c if c.isascii() and c.isalnum() else "-" for c in campaign.name.lower())
    artifacts.create_table_artifact(
        key=f"{key}-stiffness",
        table=[
            {"joint": joint.name, "stiffness": stiffness_text(joint, joint.unit)}
            for joint in answer.stiffness
        ],
        description=" ".join(answer.verdict_sentence[:2]),
    )
    artifacts.create_link_artifact(key=f"{key}-report", link=_link(campaign))


def _link(campaign: CampaignFolder) -> str:
    base = os.environ.get(REPORTS_URL)
    if base:
        return f"{base.rstrip('/')}/{quote(campaign.name)}/index.html"
    return (campaign.reports / "index.html").resolve().as_uri()
