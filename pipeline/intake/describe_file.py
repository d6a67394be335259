"""Recognise one file: an export, a log or neither, and what to paste for it to be read."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.app.outcome import Outcome, failed, sentences
from pipeline.base import files
from pipeline.base.errors import InputError, PipelineError, listed
from pipeline.base.shown import in_toml as quoted
from pipeline.store.campaign import CampaignFolder


def inspect(
    path: Path,
    stated: Mapping[str, Any],
    csv: bool = False,
    mapping: Path | None = None,
    ask: _Ask | None = None,
) -> Outcome:
    """Describe a tracker export or a log, or with `csv` give an export's readings in SI.

    A campaign.toml in its folder adds what the export does not state; what is left open is asked,
    or reported with an answer to paste.

    Args:
        path: The export.
        stated: Entries of [tracker], by key; None where not given.
        csv: Whether to give its readings.
        mapping: A file with [tracker.mapping] to try.
        ask: Answers a question; None if nobody can be asked.
    """
    from pipeline.answer.contract import Rejected
    from pipeline.intake.by_reflectors import settled
    from pipeline.intake.inspect import as_csv
    from pipeline.intake.inspect import inspect as look
    from pipeline.intake.log_columns import refuse_without_poses
    from pipeline.readers import largest, refuse_other_programs

    data, hints = b"", None
    try:
        none = InputError("there is no such file", "correct the path", file=str(path))
        begins = partial(refuse_other_programs, path.name)
        _no_folder(path)
        data = files.read(path, path.name, largest(path.name), none, begins)
        folder = CampaignFolder(path.parent, path.parent)
        sheet = stated.get("sheet")
        if not (csv or mapping or any(one for key, one in stated.items() if key != "sheet")):
            _no_prose(path.name, data)
            alone = _sheet_alone(path.name, data, sheet)
            if log := _log(path, alone, folder, sheet):
                return replace(log, text=_with_sheets(path.name, data, log.text, sheet))
            refuse_without_poses(path.name, alone)
        hints, bodies = _hints(folder, stated, mapping)
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


def _no_folder(path: Path) -> None:
    """Refuse a folder.

    Raises:
        InputError: It is one.
    """
    if os.path.isdir(path):  # false, not an error, for a name that no folder can have
        names = sorted(
            one.name for one in path.iterdir() if one.is_file() and one.suffix != ".toml"
        )
        first = f" {path / names[0]}" if names else ""
        raise InputError(
            f"is a folder, with {len(names)} files",
            f"inspect one of them{first and ', as'}{first}; `pipeline init` looks at all files in "
            "the folder of a campaign",
            file=str(path),
        )


def _no_prose(name: str, data: bytes) -> None:
    """Refuse a text for people.

    Raises:
        InputError: It is one.
    """
    from pipeline.intake._prose import is_prose

    if is_prose(name, data):
        raise InputError(
            "is text for people, not a table",
            "type what it says of the campaign into campaign.toml",
            file=name,
        )


def _sheet_alone(name: str, data: bytes, sheet: str | None) -> bytes:
    """One sheet of a workbook as text; the file itself if none is named.

    Raises:
        InputError: There is no such sheet.
    """
    from pipeline.dialects.workbook import sheets

    return data if sheet is None else sheets(name, data, sheet, None, "tracker")[sheet].data


def _with_sheets(name: str, data: bytes, text: str, sheet: str | None) -> str:
    """The description of a log, and what the other sheets of its workbook are."""
    from pipeline.intake._folder import in_workbooks

    others = in_workbooks({name: data}) if sheet is None else []
    return "\n".join([text, *(f"\n{one} Another with --sheet NAME." for one in others)])


def _log(path: Path, data: bytes, folder: CampaignFolder, sheet: str | None) -> Outcome | None:
    """Description of a file that is a log, None if it is not one."""
    from pipeline.intake.blank import log_lines
    from pipeline.intake.which_logs import propose_logs

    robots = {}
    for one in sorted(path.parent.glob("*.toml")):
        with contextlib.suppress(InputError):  # a file that cannot be read does not matter here
            robots[one.name] = folder.content(one.name)
    said = propose_logs(robots | {path.name: data})
    if not (said.loads or said.joints):
        return None
    what = "log of loads" if said.loads else "joint log"
    facts = {"dialect": what} | ({"robots": ", ".join(said.robots)} if said.joints else {})
    if said.loads:
        facts["not used"] = _not_used(path.name, data, said.load_columns)
    lines = [path.name, *(f"  {name:12} {fact}" for name, fact in facts.items())]
    head, *rest = log_lines(said, _named_robot(robots.get("campaign.toml", b"")))
    named = [] if sheet is None else [f"sheet = {quoted(sheet)}"]
    proposal = "\n".join([head, *rest[:1], *named, *rest[1:]])
    content = {"file": path.name, **facts, "proposal": proposal}
    return Outcome(path.name, content, "\n".join([*lines, "", proposal]))


def _not_used(name: str, data: bytes, columns: dict[str, str]) -> str:
    """The titles of a log of loads that mean nothing."""
    from pipeline.intake import log_columns

    unknown = log_columns.unknown(name, data, log_columns.settled(columns))
    return listed(one for one in unknown if one not in columns) or "nothing"


def _named_robot(data: bytes) -> str | None:
    """The robot that a campaign.toml names; None if it names none, or cannot be read."""
    from pipeline.base import toml

    with contextlib.suppress(InputError):
        return str(toml.loads(files.text(data, "campaign.toml"), "campaign.toml").get("robot"))
    return None


_Ask = Callable[[Any], Mapping[str, Any]]
"""From an `intake.offer.Offer`: entries of [tracker] that answer its question."""


def _hints(folder: CampaignFolder, stated: Mapping[str, Any], mapping: Path | None) -> Any:
    """Statements of campaign.toml, of a mapping to try, of the command line; later ones override.

    And the reflectors with positions in campaign.toml; none while it is still to be filled in.
    """
    from pipeline.base import toml
    from pipeline.readers import ExportSettings

    known, bodies = ExportSettings(), []
    if (folder.folder / "campaign.toml").is_file():
        known = _words(folder.content("campaign.toml"), "campaign.toml", known)
        with contextlib.suppress(InputError):
            bodies = folder.settings().bodies
    if mapping is not None:
        none = InputError("there is no such file", "correct --mapping", file=str(mapping))
        known = _words(
            files.read(mapping, mapping.name, toml.LARGEST_TEXT, none), mapping.name, known
        )
    given = {word: value for word, value in stated.items() if value is not None}
    return known.model_copy(update=given), bodies


def _words(data: bytes, name: str, known: Any) -> Any:
    """The known statements on an export, updated from [tracker] of a file.

    Raises:
        InputError: [tracker] is not a table, or not valid.
    """
    from pipeline.base import toml
    from pipeline.base.strict import checked
    from pipeline.readers import ExportSettings

    tracker = toml.loads(files.text(data, name), name).get("tracker", {})
    if not isinstance(tracker, dict):
        raise InputError("tracker is no table", "write [tracker], and its keys below", file=name)
    words = {word: tracker[word] for word in ExportSettings.model_fields if word in tracker}
    tried = checked(ExportSettings, words, name, "[tracker]", "correct it")
    return known.model_copy(update={word: getattr(tried, word) for word in words})


def _answered(name: str, data: bytes, hints: Any, ask: _Ask | None) -> Any:
    """Statements on an export after asking for everything it leaves open."""
    from pipeline.intake.offer import offer

    found = None
    while ask is not None and (found := offer(name, data, hints)) and found.question:
        hints = hints.model_copy(update=dict(ask(found)))
    return found.hints if found and hints.mapping else hints


def _unread(name: str, data: bytes, hints: Any, problem: PipelineError) -> Outcome:
    """Why an export cannot be read, and what to paste for it to be."""
    from pipeline.intake.inspect import offer_in_words
    from pipeline.intake.offer import offer

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
