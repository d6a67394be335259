"""What became of one campaign: what is printed for people and programs, and the exit code."""

from __future__ import annotations

import json
import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError, PipelineError
from pipeline.base.quantities import common_prefix, prefixed, with_std
from pipeline.store.campaign import Campaign


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


Compute = Callable[[Campaign], dict[str, Any]]
"""How a campaign is brought up to date: campaign in, result.json out."""


def outcome(name: str, find: Callable[[], Campaign], compute: Compute) -> Outcome:
    """What becomes of one campaign; whatever goes wrong is part of it."""

    def work() -> Outcome:
        campaign = find()
        return dated(guarded(campaign.name, partial(_outcome, campaign, compute)), campaign)

    return guarded(name, work)


def dated(outcome: Outcome, campaign: Campaign) -> Outcome:
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
        f"{name}: {answer['verdict_sentence'][0]}",
        *(f"  {line}" for line in (*answer["verdict_sentence"][1:], *_stiffness_lines(answer))),
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


def _stiffness_lines(answer: dict[str, Any]) -> list[str]:
    """The stiffnesses that the answer stands for, one line per joint."""
    out = []
    for joint in answer["stiffness"]:
        factor, letter = common_prefix([joint["value"]])
        shown = (
            f"{with_std(joint['value'] / factor, joint['std'] / factor)} "
            f"{prefixed(joint['unit'], letter)}"
            if joint["value"] is not None
            else "not determined"
        )
        out.append(f"{joint['name']:<10} {shown}")
    return out


def stiffness_rows(answer: dict[str, Any]) -> list[dict[str, Any]]:
    """The same as a table for machines."""
    shown = ("name", "value", "std", "unit", "identifiable")
    return [{key: joint[key] for key in shown} for joint in answer["stiffness"]]


def guarded(name: str, work: Callable[[], Outcome]) -> Outcome:
    """What `work` makes of a campaign, or what went wrong in it."""
    try:
        return work()
    except PipelineError as problem:
        return failed(name, problem, str(problem), problem.exit_code)
    except Exception as problem:  # one broken campaign must not stop the others
        return failed(name, problem, record_crash(problem), 1)


def failed(name: str, problem: Exception, words: str, code: int) -> Outcome:
    """A campaign without a result, and why."""
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


def sentence(rejected: dict[str, Any]) -> str:
    """One rejected row in words."""
    line = "" if rejected["line"] is None else f":{rejected['line']}"
    return f"{rejected['file']}{line}: {rejected['reason']}"


_ALIKE = 3
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
    told = [sentence(entry) for entry in list(first.values())[:_ALIKE]]
    more = len(entries) - len(told)
    if more:
        told.append(f"{entries[0]['file']}: ... and {more} more line{'s' * (more > 1)} like this")
    return told
