"""Outcome of processing one campaign: output for people and programs, and the exit code."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.base import doors, files
from pipeline.base.errors import CannotWrite, InputError, PipelineError, Unfinished, place
from pipeline.base.quantities import bracketed, prefixed
from pipeline.base.shown import in_json, printable
from pipeline.store.campaign import CampaignFolder, find, label

if TYPE_CHECKING:  # importing its types loads the numerical libraries, which takes a second
    from pipeline.answer.contract import Answer, Cause, Combination, Rejected, Stiffness


Meant = str | CampaignFolder
"""A campaign, or the name or path of one."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of processing one campaign.

    Attributes:
        campaign: Name of its folder, even if it was requested by path.
        content: Output of --json.
        text: Output otherwise, one or more lines.
        exit_code: 0 done, 1 internal error, 3 not written, 5 rejected in whole or in part, 6
            abandoned.
        misfit: Whether the model does not fit or leaves a stiffness undetermined, or the tolerance
            is not certainly kept.
        complaints: Sentences for stderr.
        verdict: Verdict of the diagnosis; None without a result.
        passing: Whether the problem may be temporary.
    """

    campaign: str
    content: dict[str, Any]
    text: str
    exit_code: int = 0
    misfit: bool = False
    complaints: list[str] = field(default_factory=list)
    verdict: str | None = None
    passing: bool = False

    def as_json(self) -> str:
        """One line of JSON."""
        return in_json(self.content)


Several = Callable[[Path, Iterable[Meant], bool], Iterator[Outcome]]
"""Function that processes many campaigns at a time: from the project's root, the campaigns, and
whether to recompute unchanged ones, to their outcomes as they end."""
Compute = Callable[[CampaignFolder], "Answer"]
"""Function that brings a campaign up to date and returns its answer."""


def outcome(campaign: CampaignFolder, compute: Compute) -> Outcome:
    """Process one campaign; any error is part of the outcome."""
    return dated(campaign, partial(_outcome, compute=compute))


def dated(campaign: CampaignFolder, work: Callable[[CampaignFolder], Outcome]) -> Outcome:
    """Outcome of `work` on a campaign; if it fails, an existing report is marked as an old one."""
    made, old = guarded(campaign.name, partial(work, campaign)), campaign.reports / "index.html"
    if "error" not in made.content or not os.path.isfile(old):
        return made
    return replace(
        made,
        content=made.content | {"earlier_report": str(old)},
        complaints=[*made.complaints, f"{campaign.name}: {old} is {EARLIER}."],
    )


EARLIER = "of an earlier input or program"


def _outcome(campaign: CampaignFolder, compute: Compute) -> Outcome:
    name, answer = campaign.name, compute(campaign)
    first, *more = _first_screen(answer)
    lines = [
        f"{name}: {first}",
        *(f"  {line}" for line in more),
        *_stiffnesses(answer.stiffness),
        *map(_mixed, answer.combinations),
        *_sizes(answer.diagnosis.causes),
        f"  {campaign.reports / 'index.html'}",
    ]
    return Outcome(
        campaign=name,
        content=answer.as_json(),
        text="\n".join(lines),
        exit_code=InputError.exit_code if answer.rejected else 0,
        misfit=answer.diagnosis.verdict != "adequate"
        or not all(joint.identifiable for joint in answer.stiffness)
        or (answer.tolerance is not None and answer.tolerance.worst not in (None, "pass")),
        complaints=[f"{name}: {line}" for line in sentences(answer.rejected)],
        verdict=str(answer.diagnosis.verdict),
    )


_MOST_SIZES = 6
"""Maximum number of sizes of errors in the data that are printed."""


def _sizes(causes: Sequence[Cause]) -> list[str]:
    """`  size of the error in pose03/P1: 10.0 mm`, and the number of further ones; then causes."""
    from pipeline.answer.amounts import sizes

    errors, others = (
        [f"  {size}" for one in causes if bool(one.evidence) is wrong for size in sizes(one)]
        for wrong in (True, False)
    )
    more = len(errors) - _MOST_SIZES
    rest = [f"  {more} more errors are listed in the report"] if more > 0 else []
    return [*errors[:_MOST_SIZES], *rest, *others]


def _stiffnesses(joints: Sequence[Stiffness]) -> list[str]:
    """`  A1   k_theta2   3.800 ± 0.012 MN·m/rad`; without axes if the robot file maps none.

    A line before them says what ± is here: on a report's first page it is twice as much.
    """
    from pipeline.answer.remarks import other_way, stiffness_text

    width = max((len(joint.axis) + 3 for joint in joints if joint.axis), default=0)
    rows = [
        f"  {joint.axis or '':<{width}}{joint.name:<10} "
        f"{stiffness_text(joint, joint.unit)}{other_way(joint)}"
        for joint in joints
    ]
    return ["  ± is one standard uncertainty (k = 1):", *rows] if rows else []


def _first_screen(answer: Answer) -> list[str]:
    """Lines of the first screen without that of the stiffnesses, which are listed separately."""
    from pipeline.answer.contract import About
    from pipeline.answer.words import ABOUT

    first, *more = answer.first_screen
    chosen = [one for one in more if one.about is not About.NUMBERS]
    return [first.text, *(f"{ABOUT[one.about]}: {one.text}" for one in chosen)]


def _mixed(one: Combination) -> str:
    """A determined combination: `c_theta2 + 0.58 c_theta4   (8.50 ± 0.11) × 10⁻⁵ rad/(N·m)`."""
    return f"  {one.formula}   {bracketed(one.value, one.std)} {prefixed(one.unit, '')}"


def named(root: Path, meant: Meant, work: Callable[[CampaignFolder], Outcome]) -> Outcome:
    """Outcome of `work` on a campaign, which is given by itself, by name or by path."""
    if isinstance(meant, CampaignFolder):
        return guarded(meant.name, lambda: work(meant))
    return guarded(label(meant), lambda: work(find(root, meant)))


def guarded(name: str, work: Callable[[], Outcome]) -> Outcome:
    """Outcome of `work` on a campaign; an exception is turned into a failed outcome."""
    try:
        return work()
    except Exception as problem:  # one broken campaign must not stop the others
        return failed(name, problem)


def failed(name: str, problem: Exception) -> Outcome:
    """Outcome of a campaign without a result, with the reason."""
    if isinstance(problem, MemoryError):
        problem = Unfinished("needs more memory than it may have", _FRUGAL)
    problem = files.refused(problem) or problem
    if isinstance(problem, PipelineError):
        words, code = str(problem), problem.exit_code
    else:
        words, code = record_crash(problem), 1
    error = {"kind": type(problem).__name__, "message": words, "exit_code": code}
    shown = printable(name, 80)
    if isinstance(problem, InputError):
        error |= problem.parts
    return Outcome(
        name,
        {"campaign": name, "error": error},
        f"{shown}: {'rejected' if code == InputError.exit_code else 'failed'}",
        code,
        complaints=[f"{shown}: {words}"],
        passing=bool(error.get("passing")),
    )


_FRUGAL = "split its files, or raise memory_gib in pipeline.toml where a service runs it"


_SHAREABLE = "pipeline.service.crash:shareable"
"""Door of the service: an internal error without any data of the user."""


def record_crash(problem: Exception) -> str:
    """Write a shareable report of an internal error, and return the sentence for the screen."""
    import tempfile

    shareable = doors.found(_SHAREABLE)
    if shareable is None:
        return f"internal error ({_brief(problem)})."
    text = shareable(problem).encode("utf-8", "backslashreplace")
    path = Path(tempfile.gettempdir()) / f"pipeline-crash-{files.sha256(text)[:8]}.txt"
    try:
        files.write(path, text)
    except CannotWrite as worse:
        return f"internal error ({_brief(problem)}); its details could not be kept ({worse})."
    safe = "which contains no names or values of your data"
    return f"internal error ({_brief(problem)}); please report it with {path}, {safe}."


def _brief(problem: Exception) -> str:
    return printable(f"{type(problem).__name__}: {problem}", 300)


_ALIKE = 3
"""Maximum number of rows listed of those whose reasons differ in numbers only."""
_KINDS = 4
"""Maximum number of kinds of reasons listed, those with the most rows; the others usually follow
from them, or would not fit on the screen."""


def sentences(rejected: Iterable[Rejected]) -> list[str]:
    """Rejected rows in words; similar ones of a file are counted. result.json lists all."""
    groups: dict[tuple[str, str], list[Rejected]] = {}
    for row in rejected:
        alike = re.sub(r"[0-9]+", "0", row.reason)
        groups.setdefault((row.file, alike), []).append(row)
    most = sorted(groups, key=lambda kind: -len(groups[kind]))[:_KINDS]
    items = [line for kind in groups if kind in most for line in _told(groups[kind])]
    rest = [len(rows) for kind, rows in groups.items() if kind not in most]
    if rest:
        items.append(f"... and {sum(rest)} more lines of {len(rest)} other kinds; --json has them")
    return items


def _told(rows: Sequence[Rejected]) -> list[str]:
    first: dict[str, str] = {}
    for row in rows:
        first.setdefault(row.reason, f"{place(row.file, row.line)}{row.reason}")
    shown = list(first.values())[:_ALIKE]
    more = len(rows) - len(shown)
    if more:
        shown.append(f"{rows[0].file}: ... and {more} more line{'s' * (more > 1)} like this")
    return shown
