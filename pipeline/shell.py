"""What the commands do, without a word about how they are typed or printed."""

from __future__ import annotations

import json
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from pipeline import campaign as campaigns
from pipeline import files, service
from pipeline.campaign import Campaign
from pipeline.errors import CannotWrite, InputError, PipelineError, UsageError

NAME = "a plain folder name that begins with no dot"


@dataclass(frozen=True)
class Outcome:
    """What became of one campaign.

    Attributes:
        campaign: Name of its folder, also where it was asked for by path.
        content: What --json prints.
        text: What is printed otherwise, one or more lines.
        exit_code: 0 done, 1 internal, 3 not written, 5 rejected in whole or in part.
        misfit: The model does not fit.
        complaints: Sentences for stderr.
    """

    campaign: str
    content: dict[str, Any]
    text: str
    exit_code: int = 0
    misfit: bool = False
    complaints: list[str] = field(default_factory=list)

    def as_json(self) -> str:
        """One line of JSON."""
        return json.dumps(self.content, ensure_ascii=False, allow_nan=False)

    def as_text(self) -> str:
        """For people."""
        return self.text


def run_all(root: Path, names: list[str], engine: str, force: bool) -> Iterator[Outcome]:
    """Bring campaigns up to date; one that fails stops none of the others."""
    everyone = names or [found.name for found in campaigns.every(root)]
    if not everyone:
        raise no_campaign(root)
    compute = plainly if engine == "local" else through_prefect
    with Progress(len(everyone)) as bar:
        for name in everyone:
            label = campaigns.label(name)
            bar.now(label)
            find = partial(campaigns.find, root, name)
            done = outcome(label, find, partial(compute, force=force))
            bar.done()
            yield done
    from pipeline import archive

    archive.refresh(root)


def no_campaign(root: Path) -> InputError:
    """What to say where there is nothing to do."""
    return InputError(
        f"there is no campaign under {root / 'data' / 'raw'}",
        "make a folder with `pipeline init NAME` or `pipeline simulate`",
    )


Compute = Callable[[Campaign], dict[str, Any]]
"""How a campaign is brought up to date: campaign in, result.json out."""


def outcome(name: str, find: Callable[[], Campaign], compute: Compute) -> Outcome:
    """What becomes of one campaign; whatever goes wrong is part of it."""

    def work() -> Outcome:
        campaign = find()
        return _dated(_guarded(campaign.name, partial(_outcome, campaign, compute)), campaign)

    return _guarded(name, work)


def _dated(outcome: Outcome, campaign: Campaign) -> Outcome:
    """Where there is no new report, say that the old one is still there."""
    old = campaign.reports / "index.html"
    if "error" not in outcome.content or not old.is_file():
        return outcome
    return replace(
        outcome,
        content=outcome.content | {"earlier_report": str(old)},
        complaints=[*outcome.complaints, f"{campaign.name}: {old} is {EARLIER}."],
    )


EARLIER = "of an earlier input or program"


def _outcome(campaign: Campaign, compute: Compute) -> Outcome:
    name, answer = campaign.name, compute(campaign)
    rejected = answer["rejected"]
    lines = [
        f"{name}: {' '.join(answer['verdict_sentence'])}",
        f"  {campaign.reports / 'index.html'}",
    ]
    return Outcome(
        campaign=name,
        content=answer,
        text="\n".join(lines),
        exit_code=InputError.exit_code if rejected else 0,
        misfit=answer["diagnosis"]["verdict"] != "adequate",
        complaints=[f"{name}: {line}" for line in sentences(rejected)],
    )


def plainly(campaign: Campaign, force: bool = False) -> dict[str, Any]:
    """Bring a campaign up to date in this process."""
    from pipeline.run import run

    return run(campaign, force=force)


def through_prefect(campaign: Campaign, force: bool = False) -> dict[str, Any]:
    """Bring a campaign up to date as a Prefect flow, unless nothing is to be done."""
    if not force and current(campaign):
        return campaign.result()
    home = campaign.root / service.HOME
    with files.writing(home):
        home.mkdir(parents=True, exist_ok=True)
    service.settle(campaign.root)
    from pipeline.flow import identify  # importing Prefect takes two seconds

    answer: dict[str, Any] = identify(str(campaign.root), str(campaign.folder), force)
    return answer


def current(campaign: Campaign) -> bool:
    """Whether the campaign's last run still stands, so that no engine needs to start."""
    try:
        return campaign.done(campaign.read().key) is not None
    except InputError as problem:
        if problem.passing:  # the engine reads again a little later
            return False
        raise


def sentence(rejected: dict[str, Any]) -> str:
    """One rejected row in words."""
    line = "" if rejected["line"] is None else f":{rejected['line']}"
    return f"{rejected['file']}{line}: {rejected['reason']}"


ALIKE = 3
"""How many of the rows that differ in numbers only are told one by one."""


def sentences(rejected: list[dict[str, Any]]) -> list[str]:
    """Rejected rows in words, those of a file that are alike counted; result.json has them all."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for entry in rejected:
        alike = re.sub(r"[0-9]+", "0", entry["reason"])
        groups.setdefault((entry["file"], alike), []).append(entry)
    return [line for entries in groups.values() for line in _told(entries)]


def _told(entries: list[dict[str, Any]]) -> list[str]:
    first: dict[str, dict[str, Any]] = {}
    for entry in entries:
        first.setdefault(entry["reason"], entry)
    told = [sentence(entry) for entry in list(first.values())[:ALIKE]]
    more = len(entries) - len(told)
    if more:
        told.append(f"{entries[0]['file']}: ... and {more} more line{'s' * (more > 1)} like this")
    return told


def _guarded(name: str, work: Callable[[], Outcome]) -> Outcome:
    try:
        return work()
    except PipelineError as problem:
        return _failed(name, problem, str(problem), problem.exit_code)
    except Exception as problem:  # one broken campaign must not stop the others
        return _failed(name, problem, record_crash(problem), 1)


def _failed(name: str, problem: Exception, words: str, code: int) -> Outcome:
    error = {"kind": type(problem).__name__, "message": words, "exit_code": code}
    if isinstance(problem, InputError):
        error |= {"file": problem.file, "line": problem.line}
        error |= {"thing": problem.thing, "way_out": problem.way_out, "passing": problem.passing}
    return Outcome(
        name,
        {"campaign": name, "error": error},
        f"{name}: {'rejected' if code == InputError.exit_code else 'failed'}",
        code,
        complaints=[f"{name}: {words}"],
    )


def record_crash(problem: Exception) -> str:
    """Keep the traceback in a file and give the sentence for the screen."""
    import tempfile

    text = "".join(traceback.format_exception(problem)).encode()
    path = Path(tempfile.gettempdir()) / f"pipeline-crash-{files.sha256(text)[:8]}.txt"
    try:
        files.write(path, text)
    except CannotWrite as worse:
        return f"internal error ({problem!r}); its details could not be kept ({worse})."
    return f"internal error ({type(problem).__name__}: {problem}); please report it with {path}."


def check(root: Path, name: str) -> Outcome:
    """Ingest a campaign and say what would be used; write nothing."""
    return _guarded(campaigns.label(name), partial(_check, root, name))


def _check(root: Path, name: str) -> Outcome:
    from pipeline.result import rejected_entries
    from pipeline.run import reduce
    from pipeline.tables import promised

    campaign = campaigns.find(root, name)
    name = campaign.name
    reduced = reduce(campaign.read(), promised)
    rejected = rejected_entries(reduced.shown["rejected"])
    used = {
        "readings": len(reduced.shown["readings"]),
        "poses": len(set(reduced.data.pulls.pose)),
        "pulls": len(reduced.data.pulls),
        "displacements": len(reduced.data.delta),
        "rejected": len(rejected),
    }
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
    from pipeline.readers.inspect import as_csv
    from pipeline.readers.inspect import inspect as look

    try:
        if not path.is_file():
            raise InputError("there is no such file", "correct the path", file=str(path))
        folder = Campaign(path.parent, path.parent)
        data, hints = folder.content(path.name), _hints(folder, unit)
        seen = look(path.name, data, hints)
        text = as_csv(path.name, data, hints).decode().rstrip("\n") if csv else seen.to_text()
    except PipelineError as problem:
        failed = _failed(path.name, problem, str(problem), problem.exit_code)
        content = {"file": path.name, "error": failed.content["error"]}
        return replace(failed, content=content, complaints=[str(problem)])
    return Outcome(
        campaign=path.name,
        content=seen.to_json(),
        text=text,
        exit_code=InputError.exit_code if seen.rejected else 0,
        complaints=sentences([{"file": path.name, **entry} for entry in seen.rejected]),
    )


def _hints(folder: Campaign, unit: str | None) -> Any:
    from pipeline.readers import Hints
    from pipeline.settings import parse
    from pipeline.stages.ingest import hints

    if not (folder.folder / "campaign.toml").is_file():
        return Hints(unit=unit)
    tracker = parse(folder.content("campaign.toml").decode("utf-8-sig")).tracker
    said = hints(tracker) if tracker else Hints()
    return replace(said, unit=unit or said.unit)


def report(root: Path, name: str | None, form: str) -> Path:
    """A report brought up to date: its page, PDF or numbers; without a name the page over all.

    Raises:
        UsageError: There is no finished campaign, or only campaigns have this form.
    """
    from pipeline import archive

    if name is None:
        if form != "html":
            raise UsageError(f"the page over all campaigns has no form {form}: name a campaign")
        page = archive.refresh(root)
        if page is None:
            raise UsageError("no campaign is finished: run `pipeline run` first")
        return page
    from pipeline.run import run

    campaign = campaigns.find(root, name)
    run(campaign)
    archive.refresh(root)
    names = {"html": "index.html", "pdf": "report.pdf", "json": "result.json"}
    return campaign.reports / names[form]


def report_text(root: Path, name: str) -> str:
    """A campaign's report as plain text."""
    from pipeline import archive
    from pipeline.report.history import previous
    from pipeline.report.model import compose
    from pipeline.report.text import as_text

    report(root, name, "html")
    campaign = campaigns.find(root, name)
    before = previous(campaign.result(), [c.result() for c in archive.finished(root)])
    return as_text(compose(campaign.result(), archive.shown(campaign), previous=before))


def compare(root: Path, first: str, second: str) -> tuple[Outcome, Path]:
    """Two campaigns or models beside each other, and the page that says so."""
    from pipeline import archive
    from pipeline.report.render import page
    from pipeline.report.text import as_text

    said, content = archive.compare(root, first, second)
    path = root / "reports" / f"{first}--{second}.html".replace(":", ".").replace("/", ".")
    files.write(path, page(said, {}).encode())
    return Outcome(f"{first}--{second}", content | {"page": str(path)}, as_text(said)), path


def status(root: Path) -> Iterator[Outcome]:
    """State of every campaign under data/raw."""
    for campaign in campaigns.every(root):
        yield _dated(_guarded(campaign.name, partial(_status, campaign)), campaign)


def _status(campaign: Campaign) -> Outcome:
    before = campaign.manifest()
    answer = campaign.done(campaign.read().key)
    state = "done" if answer else "changed" if before else "new"
    verdict = answer["diagnosis"]["verdict"] if answer else None
    content = {"campaign": campaign.name, "state": state, "verdict": verdict}
    report = campaign.reports / "index.html"
    shown = str(report) if report.is_file() else ""
    if shown and not answer:
        content |= {"earlier_report": shown}
        shown += f" ({EARLIER})"
    return Outcome(
        campaign.name, content, f"{campaign.name:24} {state:8} {verdict or '':12} {shown}".rstrip()
    )


@dataclass(frozen=True)
class Compensated:
    """Where the offsets of a path went.

    Attributes:
        path: The CSV file.
        remarks: What to know about it, for stderr.
    """

    path: Path
    remarks: list[str]


def compensate(
    root: Path,
    name: str,
    path: Path,
    tip: tuple[float, float, float] | None = None,
    output: Path | None = None,
) -> Compensated:
    """Offsets for a path of poses and forces, from a campaign's model.

    Raises:
        UsageError: The campaign has no model yet, or the path is not there.
        InputError: The path cannot be read.
    """
    import numpy as np

    from pipeline import compensate as stage
    from pipeline.handover import Model

    campaign = campaigns.find(root, name)
    kept = campaign.reports / "model.toml"
    if not kept.is_file():
        raise UsageError(f"{name} has no model yet: run `pipeline run {name}` first")
    model = Model.load(kept)
    robot = model.cell.robot
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise UsageError(f"{path} cannot be read ({problem.strerror}): check the path") from problem
    wanted = stage.read(path.name, data, robot)
    found = stage.compensate(model, wanted, None if tip is None else np.array(tip))
    written = output or path.with_name(f"{path.stem}-compensation.csv")
    files.write(written, stage.table(robot, wanted, found))
    remarks = [
        f"{len(wanted.pose)} points: the load moves the tip by up to "
        f"{1e3 * found.deflection.max():.3f} mm; with the offsets the model leaves "
        f"{1e3 * found.left.max():.4f} mm, known to +-{2e3 * found.std.max():.3f} mm (95 %)."
    ]
    if model.verdict in ("unexplained", "bad_data"):
        remarks.append(
            f"The model of {name} does not fit its own measurements: expect more than is stated."
        )
    return Compensated(written, remarks)


TEMPLATE = """\
format = 1
name   = {name}
robot  = {robot}          # {shipped}, or the path of a robot file

[tracker]
files   = ["tracker*.csv", "tracker*.txt"]
# unit  = "mm"              # only where the export itself does not say: mm | m | in
sigma_m = {sigma_m}          # standard uncertainty per axis of one reading [m]

[base_frame]                # fixed reflectors, nominal coordinates in F_b [m]: at least three
# B1 = [0.6, -0.5, -0.30]

[scale]
file       = "loads.csv"
sigma_n    = {sigma_n}            # standard uncertainty of one reading [N]
sigma_rel  = 0.0
gain_sigma = 0.0            # relative standard uncertainty of the scale's gain (certificate)

[joints]
file = "joints.csv"

[tool]                      # points of the effector in the flange frame [m]: measure them
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]

# [test_pose]               # where the prediction matters: m and degrees, N
# q = [{q}]
# force_n = [0, 0, -300]
"""


ASKED = {
    "sigma_mm": ("Standard uncertainty of one tracker reading per axis", "mm", 0.03),
    "sigma_n": ("Standard uncertainty of one scale reading", "N", 2.0),
}
"""What `init` asks on a terminal, with unit and default."""


def robots() -> str:
    """The robots that ship, for a sentence."""
    from pipeline.robot import SHIPPED

    return ", ".join(SHIPPED)


def init(root: Path, name: str, robot: str, sigma_mm: float = 0.03, sigma_n: float = 2.0) -> Path:
    """Make the folder of a new campaign.

    Args:
        root: The project's root.
        name: Of the campaign and its folder.
        robot: A robot that ships, or a robot file.
        sigma_mm: Standard uncertainty of one tracker reading per axis [mm].
        sigma_n: Standard uncertainty of one scale reading [N].

    Raises:
        UsageError: The name is no folder name, the folder is there already, or there is no such
            robot.
    """
    from pipeline.robot import SHIPPED, load
    from pipeline.toml import quoted

    if not name.strip() or name[0] == "." or any(c in "/\\" or not c.isprintable() for c in name):
        raise UsageError(f'"{name}" cannot name a campaign: use {NAME}')
    folder = root / "data" / "raw" / name
    if folder.exists():
        raise UsageError(f"{folder} is there already: choose another name")
    try:
        joints = load(robot, folder).joints
    except InputError as problem:
        if problem.file != "campaign.toml":  # which is still to be written
            raise
        raise UsageError(f"--robot: {problem.thing}; {problem.way_out}") from problem
    columns = [f"{j.name}_m" if j.prismatic else f"{j.name}_deg" for j in joints]
    text = TEMPLATE.format(
        name=quoted(name),
        robot=quoted(robot),
        shipped=", ".join(SHIPPED),
        sigma_m=f"{1e-3 * sigma_mm:.3g}",
        sigma_n=f"{sigma_n:g}",
        q=", ".join("0" for _ in joints),
    )
    files.write(folder / "loads.csv", b"pose,repeat,force_n,branch\n")
    files.write(folder / "joints.csv", f"pose,{','.join(columns)},approach\n".encode())
    files.write(folder / "campaign.toml", text.encode())
    return folder


class Progress:
    """A bar on stderr over campaigns, with the time that remains; on a terminal only."""

    def __init__(self, total: int) -> None:
        """Make a bar for so many campaigns."""
        self._total = total
        self._bar: Any = None

    def __enter__(self) -> Progress:
        """Make it ready."""
        if sys.stderr.isatty():
            from rich import progress
            from rich.console import Console

            self._bar = progress.Progress(
                progress.SpinnerColumn(),
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.MofNCompleteColumn(),
                progress.TimeElapsedColumn(),
                progress.TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
                redirect_stdout=False,  # else what is printed would go to stderr, the bar's console
                redirect_stderr=False,
            )
            self._task = self._bar.add_task("", total=self._total)
        return self

    def __exit__(self, *_: object) -> None:
        """Take it away."""
        if self._bar is not None:
            self._bar.stop()

    def now(self, name: str) -> None:
        """Say which campaign is being computed."""
        if self._bar is not None:
            self._bar.update(self._task, description=name)
            self._bar.start()

    def done(self) -> None:
        """One campaign further; the bar makes room for what is said about it."""
        if self._bar is not None:
            self._bar.advance(self._task)
            self._bar.stop()
