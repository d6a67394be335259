"""Commands that process campaigns automatically, and that check the machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import AsJson, Root
from pipeline.base.doors import opened
from pipeline.base.environment import NOBODYS, elsewhere
from pipeline.base.errors import UsageError
from pipeline.base.toml import given

if TYPE_CHECKING:
    from pipeline.library.preferences import Preferences


def serve(
    interval: Annotated[float | None, Option(help="Seconds between two scans of data/raw.")] = None,
    cron: Annotated[str | None, Option(help="Cron schedule, in place of --interval.")] = None,
    port: Annotated[
        int | None, Option(help="Port of Prefect's dashboard; reports are served on the next one.")
    ] = None,
    unit: Annotated[bool, Option("--unit", help="Print a systemd unit and exit.")] = False,
    root: Root = Path(),
) -> None:
    """Process campaigns as they arrive, with Prefect's dashboard."""
    if unit:
        from pipeline.service.unit import unit as of_systemd

        typer.echo(of_systemd(root), nl=False)
        return
    from pipeline.service import processes, supervisor

    wanted = _preferred(root, interval_s=interval, cron=cron, port=port)
    every = f"at {wanted.service.cron}" if wanted.service.cron else _every(wanted)
    typer.secho(f"Looking at {root / 'data' / 'raw'} {every}; Ctrl-C stops.", err=True)
    supervisor.serve(root, wanted, processes.log)


def watch(
    campaign: Annotated[
        str | None, Argument(help="With --live: a campaign under data/raw, or its folder.")
    ] = None,
    live: Annotated[
        bool, Option("--live", help="Judge one campaign pose by pose while it is measured.")
    ] = False,
    interval: Annotated[float | None, Option(help="Seconds between two scans of data/raw.")] = None,
    as_json: AsJson = False,
    root: Root = Path(),
) -> None:
    """Process campaigns as they arrive, without Prefect; or judge one while it is measured."""
    if live or campaign is not None:
        if not (live and campaign):
            raise UsageError("--live and the name of a campaign belong together: give both")
        opened("pipeline.live.command:live")(campaign, root, interval or _LIVE_S, as_json)
        return
    from pipeline.base.shown import say
    from pipeline.service import processes, supervisor
    from pipeline.service import watch as watching

    wanted = _preferred(root, interval_s=interval)
    processes.stop_on_sigterm()
    where = root / "data" / "raw"
    typer.secho(f"Looking at {where} {_every(wanted)}; Ctrl-C stops.", err=True)
    with supervisor.alone(root, wanted.service):
        for outcome in watching.watch(root, wanted):
            if as_json:
                say(outcome.as_json())
            else:
                processes.log(processes.event(outcome))


_LIVE_S = 1.0
"""Interval between two looks at a growing folder [s], a matter of taste: a reading takes some
seconds."""


def deploy(
    pool: Annotated[str, Option(help="Prefect work pool whose workers process the campaigns.")],
    interval: Annotated[float | None, Option(help="Seconds between two scans of data/raw.")] = None,
    cron: Annotated[str | None, Option(help="Cron schedule, in place of --interval.")] = None,
    root: Root = Path(),
) -> None:
    """Schedule the scan for new campaigns on a team's Prefect server: docs/teams.md."""
    from pipeline.service import processes
    from pipeline.service import server as service

    wanted = _preferred(root, interval_s=interval, cron=cron)
    service.join(root)
    service.see_settings()
    with elsewhere():
        from pipeline.service import flow  # only after Prefect's settings are in the environment

        flow.deploy(pool, wanted.service)
    place = f"cd {NOBODYS} && {processes.ROOT}={root.resolve()}"  # as in elsewhere()
    typer.echo(f"{place} prefect worker start --pool {pool} --limit 2")


def doctor(as_json: AsJson = False, root: Root = Path()) -> None:
    """Check this machine: what is missing, and how to install it."""
    import json
    from dataclasses import asdict

    from pipeline.service import doctor as examination

    sound = True
    for finding in examination.examine(root):
        mark = "ok" if finding.good else "PROBLEM" if finding.needed else "note"
        line = f"{mark:8} {finding.what:16} {finding.text}"
        keys = asdict(finding)
        typer.echo(json.dumps(keys | {"said": keys.pop("text")}) if as_json else line)
        sound = sound and (finding.good or not finding.needed)
    raise typer.Exit(0 if sound else UsageError.exit_code)


def _preferred(root: Path, **options: Any) -> Preferences:
    """Preferences from pipeline.toml, overridden by the command line."""
    from pipeline.library import preferences

    if not root.is_dir():
        raise UsageError(f"there is no folder {root}: correct --root")
    return preferences.load(root, given(options))


def _every(preferences: Preferences) -> str:
    return f"every {preferences.service.interval_s:g} s"
