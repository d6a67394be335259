"""The stages of run.py as a Prefect flow: one task per stage, artifacts at the end.

The only file that imports Prefect, which takes seconds; `service.settle` comes before it, because
Prefect reads its settings when it is imported.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from prefect import flow, runtime, task
from prefect.artifacts import create_link_artifact, create_table_artifact
from prefect.cache_policies import NO_CACHE

from pipeline.campaign import Campaign, find
from pipeline.errors import InputError
from pipeline.run import run


def _named() -> str:
    return Path(runtime.flow_run.parameters["campaign"]).name


@flow(name="identify-stiffness", flow_run_name=_named, persist_result=False)
def identify(root: str, campaign: str, force: bool = False) -> dict[str, Any]:
    """Run every stage of one campaign as a Prefect task and give its result.json."""
    found = find(Path(root), campaign)
    answer = run(found, step=as_task, force=force)
    publish(found, answer)
    return answer


def as_task(stage: Callable[..., Any]) -> Callable[..., Any]:
    """One stage as a task; Prefect's own cache is off, our manifest decides what is current."""
    reading = stage.__name__ == "read"  # a share that was away for a moment; nothing else heals
    return task(
        name=stage.__name__,
        cache_policy=NO_CACHE,
        persist_result=False,
        retries=2 if reading else 0,
        retry_delay_seconds=2,
        retry_condition_fn=_may_heal,
    )(stage)


def _may_heal(task: Any, run: Any, state: Any) -> bool:
    problem = state.result(raise_on_failure=False)
    return isinstance(problem, InputError) and problem.passing


def publish(campaign: Campaign, answer: dict[str, Any]) -> None:
    """Result table and report link as Prefect artifacts."""
    key = "".join(c if c.isascii() and c.isalnum() else "-" for c in campaign.name.lower())
    rows = [
        {name: entry[name] for name in ("name", "value", "std", "unit", "identifiable")}
        for entry in answer["stiffness"]
    ]
    create_table_artifact(
        key=f"{key}-stiffness", table=rows, description=" ".join(answer["verdict_sentence"])
    )
    create_link_artifact(
        key=f"{key}-report", link=(campaign.reports / "index.html").resolve().as_uri()
    )
