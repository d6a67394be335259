"""Typer: parse, call, print. stdout is data, stderr is progress; exit codes are in the README."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import Abort, TyperException

from pipeline.errors import MISFIT, Interrupted, PipelineError, UsageError, worst

if TYPE_CHECKING:
    from pipeline.preferences import Preferences
    from pipeline.shell import Outcome

app = typer.Typer(
    help="Joint stiffnesses of a robot from tracker campaigns, and how far to trust them.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Root = Annotated[Path, typer.Option(help="Project root with data/ and reports/.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON on stdout, one line each.")]


@app.command()
def run(
    campaigns: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CAMPAIGN]...", help="Name under data/raw, or a path."),
    ] = None,
    as_json: AsJson = False,
    engine: Annotated[str, typer.Option(help="prefect or local.")] = "prefect",
    force: Annotated[
        bool, typer.Option("--force", help="Compute even if nothing changed.")
    ] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit 4 when the model does not fit.")
    ] = False,
    root: Root = Path(),
) -> None:
    """Bring campaigns up to date (all new or changed ones by default) and say where reports are."""
    from pipeline import shell

    if engine not in ("prefect", "local"):
        raise UsageError(f'there is no engine "{engine}": use prefect or local')
    codes = []
    for outcome in shell.run_all(root, campaigns or [], engine, force):
        codes += [outcome.exit_code, MISFIT if strict and outcome.misfit else 0]
        _show(outcome, as_json)
    raise typer.Exit(worst(codes))


@app.command()
def serve(
    interval: Annotated[float | None, typer.Option(help="Seconds between two looks.")] = None,
    cron: Annotated[str | None, typer.Option(help="A cron line instead of the interval.")] = None,
    port: Annotated[
        int | None, typer.Option(help="Of Prefect's page; reports get the next.")
    ] = None,
    root: Root = Path(),
) -> None:
    """Run new campaigns by themselves; Prefect's page shows them."""
    from pipeline import service

    wanted = _preferred(root, interval_s=interval, cron=cron, port=port)
    every = f"at {wanted.service.cron}" if wanted.service.cron else _every(wanted)

    def started(urls: dict[str, str]) -> None:
        typer.echo(f"{urls['page']}  Prefect's page: runs, results, logs")
        typer.echo(f"{urls['reports']}  the reports")
        typer.secho(f"Looking at {root / 'data' / 'raw'} {every}; Ctrl-C stops.", err=True)

    service.serve(root, wanted, started)


@app.command()
def doctor(as_json: AsJson = False, root: Root = Path()) -> None:
    """Say what is missing on this machine, and how to get it."""
    import json
    from dataclasses import asdict

    from pipeline import doctor as examination

    sound = True
    for finding in examination.examine(root):
        mark = "ok" if finding.good else "MISSING" if finding.needed else "note"
        line = f"{mark:8} {finding.what:16} {finding.said}"
        typer.echo(json.dumps(asdict(finding)) if as_json else line)
        sound = sound and (finding.good or not finding.needed)
    raise typer.Exit(0 if sound else UsageError.exit_code)


@app.command()
def deploy(
    pool: Annotated[str, typer.Option(help="Work pool whose workers run the campaigns.")],
    interval: Annotated[float | None, typer.Option(help="Seconds between two looks.")] = None,
    cron: Annotated[str | None, typer.Option(help="A cron line instead of the interval.")] = None,
    root: Root = Path(),
) -> None:
    """Put the scan on a team's own Prefect server: docs/teams.md."""
    from pipeline import service

    wanted = _preferred(root, interval_s=interval, cron=cron)
    typer.echo(service.deploy(root, pool, wanted))


@app.command()
def watch(
    interval: Annotated[float | None, typer.Option(help="Seconds between two looks.")] = None,
    as_json: AsJson = False,
    root: Root = Path(),
) -> None:
    """Run new campaigns by themselves, without Prefect."""
    from pipeline import service
    from pipeline import watch as watching

    wanted = _preferred(root, interval_s=interval)
    service.stop_on_sigterm()
    where = root / "data" / "raw"
    typer.secho(f"Looking at {where} {_every(wanted)}; Ctrl-C stops.", err=True)
    for outcome in watching.watch(root, wanted):
        _show(outcome, as_json)


def _preferred(root: Path, **said: Any) -> Preferences:
    """What pipeline.toml says, and the command line otherwise."""
    from pipeline import preferences

    return preferences.load(
        root, {name: value for name, value in said.items() if value is not None}
    )


def _every(preferences: Preferences) -> str:
    return f"every {preferences.service.interval_s:g} s"


@app.command()
def compensate(
    campaign: str,
    path: Annotated[Path, typer.Argument(help="pose, joint values, fx_n, fy_n, fz_n per row.")],
    tip: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Tool tip in the flange frame [m]; else the campaign's load point."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(help="Where to; PATH-compensation.csv beside the path.")
    ] = None,
    root: Root = Path(),
) -> None:
    """Write offsets that cancel the deflection along a path."""
    from pipeline import shell

    written = shell.compensate(root, campaign, path, tip, output)
    typer.echo(written.path)
    for line in written.remarks:
        typer.secho(line, err=True)


@app.command()
def check(campaign: str, as_json: AsJson = False, root: Root = Path()) -> None:
    """Read a campaign, say what would be used and what is wrong; compute nothing."""
    from pipeline import shell

    outcome = shell.check(root, campaign)
    _show(outcome, as_json)
    raise typer.Exit(outcome.exit_code)


@app.command()
def inspect(
    file: Annotated[Path, typer.Argument(help="A tracker export.")],
    unit: Annotated[
        str | None, typer.Option(help="mm, m or in, where the export does not say.")
    ] = None,
    as_json: AsJson = False,
    csv: Annotated[
        bool, typer.Option("--csv", help="Print the readings in SI, for a spreadsheet.")
    ] = False,
) -> None:
    """Say what a tracker export is: dialect, unit, coordinates, times, what is wrong with it."""
    from pipeline import shell

    if unit not in (None, "mm", "m", "in"):
        raise UsageError(f'there is no unit "{unit}": use mm, m or in')
    outcome = shell.inspect(file, unit, csv)
    _show(outcome, as_json)
    raise typer.Exit(outcome.exit_code)


@app.command()
def report(
    campaign: Annotated[
        str | None, typer.Argument(help="Name or path; without it the page over all campaigns.")
    ] = None,
    form: Annotated[str, typer.Option("--format", help="html, pdf, json or text.")] = "html",
    show: Annotated[bool, typer.Option("--open", help="Open it.")] = False,
    root: Root = Path(),
) -> None:
    """Bring a campaign's report up to date and say where it is; with --format text, print it."""
    from pipeline import shell

    if form not in ("html", "pdf", "json", "text"):
        raise UsageError(f'there is no format "{form}": use html, pdf, json or text')
    if form == "text":
        if campaign is None:
            raise UsageError("name the campaign whose report you want as text")
        typer.echo(shell.report_text(root, campaign), nl=False)
        return
    path = shell.report(root, campaign, form)
    typer.echo(path)
    if show:
        _open(path)


@app.command()
def compare(
    first: Annotated[str, typer.Argument(help="A campaign, or campaign:extended.")],
    second: Annotated[str, typer.Argument(help="Another one, or another model of it.")],
    as_json: AsJson = False,
    show: Annotated[bool, typer.Option("--open", help="Open the page.")] = False,
    root: Root = Path(),
) -> None:
    """Say how the stiffnesses of two campaigns, or of two models of one, differ."""
    from pipeline import shell

    outcome, path = shell.compare(root, first, second)
    _show(outcome, as_json)
    typer.secho(path, err=True)
    if show:
        _open(path)


def _open(path: Path) -> None:
    import webbrowser

    if not webbrowser.open(path.resolve().as_uri()):
        raise UsageError(f"no program opens {path} here: open it yourself")


@app.command()
def status(as_json: AsJson = False, root: Root = Path()) -> None:
    """List the campaigns under data/raw: new, changed or done, with their verdicts."""
    from pipeline import shell

    codes = []
    for outcome in shell.status(root):
        codes.append(outcome.exit_code)
        _show(outcome, as_json)
    if not codes:
        typer.secho(str(shell.no_campaign(root)), err=True)
    raise typer.Exit(worst(codes))


@app.command()
def init(
    name: Annotated[str | None, typer.Argument(help="Of the new campaign.")] = None,
    robot: Annotated[str | None, typer.Option(help="A robot that ships, or a robot file.")] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Plan file: its poses, steps and tool are filled in.")
    ] = None,
    root: Root = Path(),
) -> None:
    """Make the folder of a new campaign; asks on a terminal."""
    from pipeline import shell

    ask = sys.stdin.isatty()
    if name is None and not ask:
        raise UsageError("the campaign has no name: write `pipeline init NAME`")
    if name is None:
        name = str(typer.prompt(f"Name of the campaign ({shell.NAME})", err=True))
    if plan is not None:
        from pipeline import virtual

        typer.echo(virtual.prepare(root, name, plan))
        return
    if robot is None and ask:
        robot = typer.prompt(f"Robot ({shell.robots()}, or a file)", "kr500_rail", err=True)
    known = {
        key: typer.prompt(f"{what} [{unit}]", default, type=float, err=True) if ask else default
        for key, (what, unit, default) in shell.ASKED.items()
    }
    typer.echo(shell.init(root, name, robot or "kr500_rail", **known))


@app.command()
def simulate(
    plan: Annotated[
        Path | None, typer.Argument(help="Plan file; without it the plan of the demo.")
    ] = None,
    plan_file: Annotated[
        Path | None, typer.Option("--plan", help="The same, as an option.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the campaign.")] = None,
    robot: Annotated[str | None, typer.Option(help="A robot that ships, or a robot file.")] = None,
    seed: Annotated[int | None, typer.Option(help="Determines every byte.")] = None,
    poses: Annotated[int | None, typer.Option(help="Draw so many feasible poses.")] = None,
    step: Annotated[
        list[float] | None, typer.Option(help="Load step [N]; repeat it for more, up and down.")
    ] = None,
    repeats: Annotated[int | None, typer.Option(help="Runs through the steps.")] = None,
    noise: Annotated[
        str | None, typer.Option(help="paper, instrument, or metres per axis.")
    ] = None,
    noise_scale: Annotated[
        float | None, typer.Option(help="True over stated scatter of the tracker.")
    ] = None,
    exact: Annotated[bool, typer.Option("--exact", help="No noise, all digits.")] = False,
    spread: Annotated[
        float | None, typer.Option(help="True stiffnesses are off by up to this fraction.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="NAME[:where][=size], size in SI or like 2x; repeat it for more."),
    ] = None,
    dialect: Annotated[str | None, typer.Option(help="Form of the tracker export.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of the export: mm, m or in.")] = None,
    digits: Annotated[str | None, typer.Option(help="Decimals in the export, or full.")] = None,
    truth: Annotated[
        Path | None, typer.Option(help="Truth file; data/processed/NAME.truth.json.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a campaign.")] = False,
    root: Root = Path(),
) -> None:
    """Write a raw campaign of a virtual cell; what is true in it goes to a file elsewhere."""
    from pipeline import virtual

    changes = {
        "name": name,
        "robot": robot,
        "seed": seed,
        "poses": {"count": poses},
        "pulls": {"steps_n": step, "repeats": repeats},
        "tracker": {
            "noise_scale": noise_scale,
            "dialect": dialect,
            "unit": unit,
            "digits": digits,
        },
        "hidden": {"stiffness_spread": spread, "effects": effect},
    }
    written = virtual.write(root, plan or plan_file, changes, noise, exact, truth, force)
    typer.echo(written.folder)
    typer.secho(f"truth: {written.truth}", err=True)


@app.command()
def design(
    problem: Annotated[
        str, typer.Argument(help="paper_reference, or a problem file ending in .toml.")
    ] = "paper_reference",
    poses: Annotated[int | None, typer.Option(help="Number of poses, m_0.")] = None,
    readings: Annotated[int | None, typer.Option(help="Pulls in all, n.")] = None,
    step: Annotated[
        list[float] | None, typer.Option(help="Load step [N]; repeat it for more, up and down.")
    ] = None,
    anchor: Annotated[
        tuple[float, float, float] | None, typer.Option(help="Anchor in F_b [m], fixed there.")
    ] = None,
    robot: Annotated[str | None, typer.Option(help="A robot that ships, or a robot file.")] = None,
    criterion: Annotated[str | None, typer.Option(help="test_pose, workspace, D, A or E.")] = None,
    add_to: Annotated[
        str | None, typer.Option(help="Propose further poses for this campaign.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the plan.")] = None,
    seed: Annotated[int, typer.Option(help="Determines the plan.")] = 1,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of new starts.")] = 2,
    write: Annotated[
        bool | None,
        typer.Option("--write/--no-write", help="Plan file and sheet; not with --json."),
    ] = None,
    as_json: AsJson = False,
    root: Root = Path(),
) -> None:
    """Choose the poses to measure, and say how near they are to the best that could be."""
    from pipeline import campaign as campaigns
    from pipeline import planning

    changes = {
        "name": name,
        "robot": robot,
        "plan": {"poses": poses, "readings": readings},
        "pull": {"steps_n": step},
        "anchor": dict(zip(("x_m", "y_m", "z_m"), anchor, strict=True)) if anchor else None,
        "criterion": {"kind": criterion},
    }
    campaign = campaigns.find(root, add_to) if add_to else None
    made = planning.run(problem, changes, seed, rounds, _at_work, campaign)
    if write or (write is None and not as_json):
        made = planning.write(root, made, seed)
    typer.echo(made.as_json() if as_json else made.as_text())
    if made.interrupted:
        raise Interrupted("Interrupted; this is the best plan so far.")


@app.command()
def effects(
    robot: Annotated[str, typer.Option(help="A robot that ships, or a robot file.")] = "kr500_rail",
    as_json: AsJson = False,
) -> None:
    """List the causes that a diagnosis knows, with their sizes and signatures."""
    from pipeline.effects import listing
    from pipeline.robot import load

    machine = load(robot)
    typer.echo(listing.as_json(machine) if as_json else listing.as_text(machine))


@app.command()
def league(
    clean: Annotated[int, typer.Option(help="Games without a secret.")] = 1000,
    single: Annotated[int, typer.Option(help="Games per known secret.")] = 6,
    pairs: Annotated[int, typer.Option(help="Games with two secrets.")] = 100,
    strange: Annotated[int, typer.Option(help="Games per secret outside the catalogue.")] = 15,
    seed: Annotated[int, typer.Option(help="Determines every game.")] = 2026,
    log: Annotated[Path | None, typer.Option(help="One JSON line per game.")] = None,
    page: Annotated[Path | None, typer.Option(help="Markdown page of the results.")] = None,
) -> None:
    """Hide effects in machines that share nothing with the catalogue, and see what is named."""
    from pipeline import contest
    from pipeline.league.run import League
    from pipeline.league.table import rows

    rules = League(clean=clean, single=single, pairs=pairs, strange=strange, seed=seed)
    played = contest.contest(rules, _at_work, log)
    for what, value, aim in rows(played):
        typer.echo(f"{what}: {value}" + (f"  (aim {aim})" if aim else ""))
    if page is not None:
        command = (
            f"pipeline league --clean {clean} --single {single} --pairs {pairs} "
            f"--strange {strange} --seed {seed}"
        )
        contest.write_page(played, command, page)


@app.command()
def paper(
    repetitions: Annotated[int, typer.Option(min=10, help="Of Table IV.")] = 200,
    poses: Annotated[int, typer.Option(min=10, help="Validation poses of each set.")] = 1000,
    seed: Annotated[int, typer.Option(help="Determines every draw and search.")] = 1,
    write: Annotated[
        bool | None, typer.Option("--write/--no-write", help="Page and PDF; not with --json.")
    ] = None,
    as_json: AsJson = False,
    root: Root = Path(),
) -> None:
    """Compute the paper's tables and figures again, and show what a better plan gives."""
    from pipeline import reproduction

    made = reproduction.run(seed, repetitions, poses, _at_work)
    typer.echo(made.as_json() if as_json else made.as_text())
    if write or (write is None and not as_json):
        typer.echo(reproduction.write(root, made))


def _at_work(words: str) -> None:
    """One line of progress; on a terminal only."""
    if sys.stderr.isatty():
        typer.secho(words, err=True, dim=True)


def _show(outcome: Outcome, as_json: bool) -> None:
    typer.echo(outcome.as_json() if as_json else outcome.as_text())
    for line in outcome.complaints:
        typer.secho(line, err=True, fg="red")


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every way out has a documented exit code and no traceback."""
    sys.exit(_exit_code(arguments))


def _exit_code(arguments: list[str] | None) -> int:
    try:
        code: Any = app(args=arguments, standalone_mode=False, prog_name="pipeline")
        if code == Interrupted.exit_code:  # Typer's word for a KeyboardInterrupt
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0
    except PipelineError as problem:
        return _say(str(problem), problem.exit_code)
    except (Abort, KeyboardInterrupt):
        return _say(
            "Interrupted; run it again to go on, nothing half-written counts.",
            Interrupted.exit_code,
        )
    except TyperException as problem:
        return _say(f"{problem} Try `pipeline --help`.", UsageError.exit_code)
    except BrokenPipeError:
        return 0
    except Exception as problem:  # the last net: a sentence for the engineer, the rest in a file
        from pipeline.shell import record_crash

        return _say(record_crash(problem), 1)


def _say(sentence: str, code: int) -> int:
    typer.secho(sentence, err=True, fg="red")
    return code
