"""The stages of run.py as a Prefect flow: one task per stage, artifacts at the end.

Prefect takes seconds to import and starts a server, so nothing else in the project imports it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.campaign import Campaign
from pipeline.errors import InputError


def settle(root: Path) -> None:
    """Settings that must stand in the environment before Prefect is imported."""
    os.environ.setdefault("PREFECT_HOME", str(root.resolve() / ".prefect"))
    os.environ.setdefault("DO_NOT_TRACK", "1")
    os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
    os.environ.setdefault("PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS", "120")
    os.environ.setdefault("PREFECT_LOGGING_LEVEL", "WARNING")


def identify(campaign: Campaign, force: bool = False) -> dict[str, Any]:
    """Run every stage of one campaign as a Prefect task and give its result.json."""
    settle(campaign.root)
    from prefect import flow

    @flow(name="identify-stiffness", flow_run_name=campaign.name, persist_result=False)
    def identify_stiffness() -> dict[str, Any]:
        from pipeline.run import run

        answer = run(campaign, step=as_task, force=force)
        publish(campaign, answer)
        return answer

    return identify_stiffness()


def as_task(stage: Callable[..., Any]) -> Callable[..., Any]:
    """One stage as a task; Prefect's own cache is off, our manifest decides what is current."""
    from prefect import task
    from prefect.cache_policies import NO_CACHE

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
    from prefect.artifacts import create_link_artifact, create_table_artifact

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
