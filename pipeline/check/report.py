"""`check`: contents of a campaign, errors in it, and the next command."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from pipeline.answer.inputs import registration_entry, rejected_entries
from pipeline.app.outcome import Outcome, sentences
from pipeline.base.doors import opened as behind
from pipeline.base.errors import InputError, listed
from pipeline.base.quantities import plain as in_digits
from pipeline.base.shown import typed
from pipeline.base.toml import line_of, quoted
from pipeline.check.contradictions import overload_entry, overloaded
from pipeline.check.findings import (
    against_pulls,
    growth_findings,
    limit_findings,
    shot_findings,
    treated_findings,
)
from pipeline.check.proven import proven
from pipeline.check.survey import (
    CampaignTimes,
    Distance,
    SurveyedPose,
    clock,
    distances,
    over_nominal,
    stands,
)
from pipeline.check.wrong_lines import TOML, WrongLine, mistaken, text_of, wrong_lines
from pipeline.faults.conventions import anchored_miss, miss
from pipeline.machine.effect import HUNG, MOUNTED
from pipeline.machine.robot import Robot, axes, configure
from pipeline.machine.robot.axes import in_log_units
from pipeline.prediction.path import Path
from pipeline.prediction.tolerance import path_of
from pipeline.readers import _log_table, opened_as_text
from pipeline.readers.export_settings import LogForm
from pipeline.readers.logs import POSE, POSE_REPEAT, REMARK, REPEAT, has_joints, has_load
from pipeline.readers.pose_names import shown
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.reduction.expected import expected
from pipeline.reduction.settings import Settings
from pipeline.run import ingested
from pipeline.store.campaign import CampaignFolder, Raw
from pipeline.tables import XYZ

_POSITIONS = "pipeline.positions.checked:of_positions"
"""Door of the positions: the check of a campaign of them."""

_MOST_LINES = 40
"""Maximum number of lines of a kind on the screen."""
_OTHER_UNIT = 2.2
"""Ratio of displacements to nominal ones from which another unit of force is suspected [1]: units
differ by this (lb and kg) or more, robots of one type by tens of per cent."""


def check(campaign: CampaignFolder) -> Outcome:
    """Read a campaign and report what would be used; write nothing.

    Raises:
        InputError: It cannot be used, and no line of campaign.toml explains why.
    """
    raw = campaign.read()
    if raw.settings.of_positions:
        positions: Outcome = behind(_POSITIONS)(campaign.name, raw)
        return positions
    wrong = wrong_lines(raw)
    try:
        with raw.placing():
            raw.settings.within_reach(text_of(raw))
            case = ingested(raw)
            reduced = bring(case)
            expected(case, reduced.data)
            path = path_of(raw.settings.tolerance, raw.files, case.robot, case.tool)
    except InputError as problem:
        others = [] if wrong else mistaken(raw)
        if not wrong and not others:
            raise
        return _refused(campaign, wrong, others, problem)
    told = _told(campaign, raw, case, reduced, wrong)
    if raw.settings.positions is not None:
        told = _of_both(told, behind(_POSITIONS)(campaign.name, raw))
    return _with_tolerance(told, raw.settings, path, reduced.data.pulls.range_n)


def _with_tolerance(
    told: Outcome, settings: Settings, path: Path | None, pulled: tuple[float, float]
) -> Outcome:
    """Add what [tolerance] requests, if it is given, compared with the pulls [N]."""
    tolerance = settings.tolerance
    if tolerance is None:
        return told
    found: dict[str, Any] = {"deflection_mm": tolerance.deflection_mm}
    line = f"  tolerance    {tolerance.deflection_mm:g} mm"
    notes: list[str] = []
    if path is not None:
        size = np.linalg.norm(path.force, axis=1)
        least, most = float(size.min()), float(size.max())
        found |= {"file": tolerance.path, "points": len(size), "force_range_n": [least, most]}
        line += f" along {tolerance.path}: {len(size)} points, {least:.0f} to {most:.0f} N"
        notes += [f"{tolerance.path}: {one}" for one in against_pulls(size, pulled)]
    *above, last = told.text.split("\n")
    return replace(
        told,
        content=told.content | {"tolerance": found, "notes": [*told.content["notes"], *notes]},
        complaints=[*told.complaints, *(f"{told.campaign}: {one}" for one in notes)],
        text="\n".join([*above, line, last]),
    )


def _of_both(pulls: Outcome, positions: Outcome) -> Outcome:
    """Report on pulls with that on positions inserted above the last line."""
    *above, last = pulls.text.split("\n")
    *more, _ = positions.text.split("\n")
    text = [*above, *(f"  {line.strip()}" for line in more), last]
    return replace(
        pulls,
        content=pulls.content | {"positions": positions.content},
        text="\n".join(text),
        exit_code=max(pulls.exit_code, positions.exit_code),
        complaints=[*pulls.complaints, *positions.complaints],
    )


def _refused(
    campaign: CampaignFolder, wrong: list[WrongLine], others: list[str], problem: InputError
) -> Outcome:
    """Report on a campaign that can be used once a line, or a whole file, is corrected."""
    shown = problem
    for first in wrong[:1]:
        shown = InputError(first.said, "then check again", file=TOML, line=first.line)
    error = {"kind": "InputError", "message": str(shown), "exit_code": InputError.exit_code}
    return Outcome(
        campaign=campaign.name,
        content={
            "campaign": campaign.name,
            "error": error | shown.parts,
            "wrong": _entries(wrong),
            "notes": others,
        },
        text=f"{campaign.name}: rejected",
        exit_code=InputError.exit_code,
        complaints=[
            *_complaints(campaign.name, wrong),
            *(f"{campaign.name}: {one}" for one in [*others, str(problem)]),
        ],
    )


def _entries(wrong: list[WrongLine]) -> list[dict[str, Any]]:
    return [
        {"file": TOML, "line": one.line, "key": one.key, "reason": one.said,
         "probability": one.probability}
        for one in wrong
    ]  # fmt: skip


def _complaints(name: str, wrong: list[WrongLine]) -> list[str]:
    return [f"{name}: {one.sentence}" for one in wrong]


def _told(
    campaign: CampaignFolder, raw: Raw, case: Case, reduced: Reduced, wrong: list[WrongLine]
) -> Outcome:
    name, shown, data = campaign.name, reduced.shown, reduced.data
    rejected = rejected_entries(shown["rejected"])
    used = _used(reduced) | {"rejected": len(rejected)} | _hung(reduced)
    there, ratio = stands(data), over_nominal(case, data)
    when = clock(case, _logs(raw))
    line = ", ".join(f"{count} {what}" for what, count in used.items())
    found = _Seen(case, there, ratio, when, _remarks(raw, case.robot))
    grown = growth_findings(registration_entry(reduced.registration))
    others = [] if wrong else proven(case, reduced)
    overload = overload_entry(raw.robot, reduced.data.pulls)
    said = [
        *limit_findings(case),
        *shot_findings(case, data.pulls),
        *treated_findings(case),
        *grown,
    ]
    doubled = _load_point_at_a_target(raw)
    notes = [
        *others,
        *_unplaced(raw.settings),
        *_without_times(raw, case),
        *_at_the_origin(case),
        *doubled,
        *said,
        *found.doubts(),
        *overloaded(overload),
    ]
    todo, next_step = _next(name, wrong, others)
    text = [f"{name}: {line}", *found.lines(raw), f"  next         {todo}"]
    return Outcome(
        campaign=name,
        content={"campaign": name, **used, **found.content(), "wrong": _entries(wrong),
                 "rejected_rows": [one.model_dump(mode="json") for one in rejected],
                 "notes": notes, "next": next_step}
        | ({"overload": overload.model_dump(mode="json")} if overload else {}),
        text="\n".join(text),
        exit_code=InputError.exit_code if rejected or wrong else 0,
        complaints=[
            *_complaints(name, wrong),
            *(f"{name}: {note}" for note in notes),
            *(f"{name}: {one}" for one in sentences(rejected)),
        ],
    )  # fmt: skip


def _unplaced(settings: Settings) -> Iterator[str]:
    """Remark that nothing defines the base frame."""
    if settings.tracker is not None and not settings.base_frame:
        yield (
            "[base_frame] of campaign.toml has no reflectors: readings are taken to be in F_b; "
            "give the coordinates of three or more where they are in the tracker's frame"
        )


def _without_times(raw: Raw, case: Case) -> Iterator[str]:
    """Remark that an export has times, and [tracker.mapping] leaves them out."""
    tracker = raw.settings.tracker
    if tracker is None or tracker.mapping is None:
        return
    for name in case.readings["file"].unique():
        text = opened_as_text(name, raw.files[name], tracker)
        if titles := behind("pipeline.dialects.mapped:unread_times")(text, tracker.mapping):
            words = dict(
                zip(("date", "time") if len(titles) > 1 else ("time",), titles, strict=False)
            )
            entry = ", ".join(f"{role} = {quoted(title)}" for role, title in words.items())
            yield (
                f"{name} has times ({listed(titles)}), which columns in [tracker.mapping] leaves "
                f"out: without them no drift is found; write {entry} into it"
            )


def _at_the_origin(case: Case) -> Iterator[str]:
    """Remark on readings of exactly (0, 0, 0), as programs write what was not measured."""
    rows = case.readings
    origin = rows[(rows[XYZ] == 0.0).all(axis=1)]
    each = [f"{r.target} in {r.group} ({r.file}:{r.line})" for r in origin.itertuples()]
    if each:
        yield (
            f"{listed(each)} {'is' if len(each) == 1 else 'are'} at (0, 0, 0), as programs write "
            "what was not measured: measure it again, or set it aside in [set_aside]"
        )


def _load_point_at_a_target(raw: Raw) -> Iterator[str]:
    """Remark that the load point coincides with a reflector, where nothing can be suspended.

    Reduced data are excepted, which may state force and displacement at one point.
    """
    tool = raw.settings.tool
    measured = raw.settings.measured if raw.settings.tracker is not None else []
    for name in measured:
        if tool[name] == tool["load_point"]:
            lines = [line_of(text_of(raw), ["tool", one]) for one in ("load_point", name)]
            where = " and ".join(str(line) for line in lines if line)
            yield (
                f"load_point and {name} have the same coordinates in [tool] ({TOML}, lines "
                f"{where}), but no load can act at the centre of a reflector: measure both points "
                "and correct the wrong one"
            )


def _used(reduced: Reduced) -> dict[str, int]:
    data = reduced.data
    return {
        "readings": len(reduced.shown["readings"]),
        "poses": len(set(data.pulls.pose)),
        "pulls": len(data.pulls),
        "displacements": len(data.delta),
    }


def _hung(reduced: Reduced) -> dict[str, int]:
    """Number of weights and of payloads among the pulls, if there are any."""
    by = reduced.data.pulls.by
    kinds = {"weights": int((by == HUNG).sum()), "payloads": int((by == MOUNTED).sum())}
    return {what: count for what, count in kinds.items() if count}


def _next(name: str, wrong: list[WrongLine], others: list[str]) -> tuple[str, str]:
    """Next step, in words and as a command."""
    run, check = (f"pipeline {command} {typed(name)}" for command in ("run", "check"))
    if wrong:
        return f"correct campaign.toml, then: {check}", check
    if others:
        what = "this" if len(others) == 1 else "these"
        todo = f"look into {what} while the robot still stands there, then: {check}"
        return f"{todo}; `run` judges what is left: {run}", run
    return run, run


def _logs(raw: Raw) -> dict[str, bytes]:
    names = (raw.settings.loads_file, raw.settings.joints.file)
    return {name: raw.files[name] for name in names if name in raw.files}


def _remarks(raw: Raw, robot: Robot) -> list[str]:
    """Remarks of the log readers on their rows."""
    settings, files = raw.settings, raw.files
    both = [
        (settings.loads_file, settings.loads_log, None),
        (settings.joints.file, settings.joints, robot),
    ]
    return [
        one
        for file, form, whose in both
        if file in files
        for one in _remarks_of(file, files[file], form, whose)
    ]


_ELSEWHERE = 2.0
"""Distance in the base frame over that at best from which the robot stands elsewhere in F_b [1]."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """Findings, as text and as JSON."""

    case: Case
    stands: list[SurveyedPose]
    ratio: float | None
    clock: CampaignTimes | None
    remarks: list[str]

    @cached_property
    def between(self) -> list[Distance]:
        """Distances between reflectors."""
        return distances(self.case)

    @cached_property
    def unloaded(self) -> dict[str, float]:
        """Distance of unloaded reflectors from where the robot file places them, median [m].

        After the rigid motion that fits best, and in the base frame, as far as these are known. A
        single wrong pose spoils a fit by least squares: the base frame's motion may then be better.
        """
        best, base = miss(self.case), anchored_miss(self.case)
        by = {"at best": best if base is None or best is None else min(best, base)}
        by |= {"in the base frame": base}
        return {how: off for how, off in by.items() if off is not None}

    @property
    def range_n(self) -> tuple[float, float]:
        """Smallest and largest force [N]."""
        least = min((one.least_n for one in self.stands), default=0.0)
        return least, max((one.most_n for one in self.stands), default=0.0)

    def content(self) -> dict[str, Any]:
        """Findings for JSON."""
        robot = self.case.robot
        return {
            "force_range_n": list(self.range_n),
            "over_nominal": self.ratio,
            "unused_groups": list(self.case.unused),
            "set_aside": [asdict(one) for one in self.case.aside],
            "unloaded_off_m": [*self.unloaded.values()],
            "distances": [
                {"table": d.table, "between": [d.first, d.second], "read_m": d.read_m,
                 "stated_m": d.stated_m}
                for d in self.between
            ],
            "each_pose": [
                {"pose": one.pose, "q": in_log_units(robot, one.q).tolist(),
                 "axes": axes.displayed(robot, one.q).round(6).tolist(), "pulls": one.pulls,
                 "force_n": [one.least_n, one.most_n]}
                for one in self.stands
            ],
            "times": self._times(),
            "remarks": self.remarks,
        }  # fmt: skip

    def _times(self) -> dict[str, Any] | None:
        when = self.clock
        if when is None:
            return None
        return {
            "first": when.ends[0],
            "last": when.ends[1],
            "longest_pause_s": when.pause.total_seconds(),
            "pause_before": when.before,
            "backwards": when.backwards,
            "away_s": {name: by.total_seconds() for name, by in when.away.items()},
        }

    def lines(self, raw: Raw) -> Iterator[str]:
        """Findings as lines of text."""
        least, most = self.range_n
        nominal = "" if self.ratio is None else (
            f"; displacements {in_digits(self.ratio, 2)} times those of the nominal stiffnesses"
        )  # fmt: skip
        yield f"  forces       {least:.0f} to {most:.0f} N{nominal}"
        if self.clock is not None:
            yield f"  times        {_span(self.clock)}"
        if self.unloaded:
            off = [f"{in_digits(1e3 * off, 2)} mm {how}" for how, off in self.unloaded.items()]
            yield f"  robot file   unloaded reflectors are off by {', '.join(off)}{self._stands()}"
        yield from (f"  remark       {one}" for one in self.remarks)
        for one in self.case.aside:
            yield f"  set aside    {one.name} (readings: {one.readings}): {one.reason}"
        if self.case.unused:
            yield f"  not used     groups {listed(self.case.unused)}"
        yield from self._distances(text_of(raw))
        yield from self._asked_about()
        yield from _table(self.case.robot, self.stands)

    def _stands(self) -> str:
        """What follows where the robot stands elsewhere in F_b than its file says."""
        best, base = (self.unloaded.get(how) for how in ("at best", "in the base frame"))
        if best is None or base is None or base < _ELSEWHERE * best:
            return ""
        away = in_digits(1e3 * float(np.sqrt(base**2 - best**2)), 2)
        return (
            f": the robot stands about {away} mm from where its file places it in F_b, which "
            "absolute positions show and displacements under load hardly do"
        )

    def _distances(self, text: str) -> Iterator[str]:
        """Distances measured and nominal, with the lines of campaign.toml, whose text this is."""
        far = self._farthest_off()
        pairs = [f"{d.first} to {d.second}" for d in far]
        width = max(map(len, pairs), default=0)
        for d, pair in zip(far, pairs, strict=True):
            lines = [line_of(text, [d.table, name]) for name in (d.first, d.second)]
            where = " and ".join(str(one) for one in lines if one)
            yield (
                f"  {pair:{width}} {1e3 * d.read_m:9.2f} mm measured, "
                f"{1e3 * d.stated_m:9.2f} mm nominal (lines {where})"
            )

    def _asked_about(self) -> Iterator[str]:
        """Test pose in the controller's axes, and its load point, so that a wrong sign shows."""
        robot, asked = self.case.robot, self.case.settings.test_pose
        if asked is None:
            return
        q = asked.joint_values(robot)
        at = configure(robot, q[None]).points(self.case.tool.load_point[None])[0, 0]
        names, shown = axes.of(robot).names, axes.displayed(robot, q)
        pose = ", ".join(f"{name} {x:.7g}" for name, x in zip(names, shown, strict=True))
        place = ", ".join(f"{x:.3f}" for x in at)
        yield f"  test pose    {pose} (mm, deg); its load point is at [{place}] m in F_b"

    def _farthest_off(self) -> list[Distance]:
        """Distances to be shown: all, or those with the largest errors if there are many."""
        every = self.between
        most = sorted((one.off_m for one in every), reverse=True)[:_MOST_LINES]
        return [one for one in every if one.off_m >= most[-1]] if most else []

    def doubts(self) -> Iterator[str]:
        """Possible errors, in sentences."""
        if self.ratio is not None and not 1 / _OTHER_UNIT < self.ratio < _OTHER_UNIT:
            yield (
                f"the displacements are {in_digits(self.ratio, 2)} times those of the nominal "
                "stiffnesses: check the unit of the force column, or the stiffnesses of the robot "
                "file"
            )
        for name, by in self.clock.away.items() if self.clock else ():
            hours = in_digits(abs(by.total_seconds()) / 3600, 2)
            way = "after" if by.total_seconds() > 0 else "before"
            yield f"{name}: its times are {hours} h {way} those of the readings: another time zone?"


def _span(when: CampaignTimes) -> str:
    """First and last reading, the longest pause, and rows out of order."""
    back = f"; {when.backwards} rows are earlier than the one above" if when.backwards else ""
    pause = in_digits(when.pause.total_seconds() / 60, 2)
    first, last = (one.replace("T", " ").rpartition(":")[0] for one in when.ends)
    return f"{first} to {last}, longest pause {pause} min (before {when.before}){back}"


def _table(robot: Robot, poses: list[SurveyedPose]) -> Iterator[str]:
    """Table of poses with the controller's axes, pulls and forces."""
    mapped = axes.of(robot)
    units = ["mm" if slides else "deg" for slides in mapped.slides]
    titles = [f"{name}_{unit}" for name, unit in zip(mapped.names, units, strict=True)]
    yield "  " + " ".join(["pose", *(f"{one:>10}" for one in titles), " pulls", "force_n"])
    for one in poses[:_MOST_LINES]:
        values = " ".join(f"{x:10.3f}" for x in axes.displayed(robot, one.q))
        force = f"{one.least_n:.0f} to {one.most_n:.0f}"
        yield f"  {one.pose:4d} {values} {one.pulls:6d} {force}"
    if len(poses) > _MOST_LINES:
        yield f"  and {len(poses) - _MOST_LINES} more poses; --json has them all"


def _remarks_of(name: str, data: bytes, stated: LogForm, robot: Robot | None = None) -> list[str]:
    """What the column `remark` of a log says, each with its line, pose and pull.

    Args:
        name: Name of the file.
        data: Its content.
        stated: [scale] or [joints] of campaign.toml.
        robot: Whose joint log it is; None for a log of loads.

    Raises:
        InputError: The file cannot be read.
    """
    holds = has_load if robot is None else partial(has_joints, robot)
    section = "scale" if robot is None else "joints"
    file = _log_table.opened(name, data, stated, section, POSE.stem, holds)
    carried = robot is None and "group" not in file.titles
    needed = POSE_REPEAT.stem not in file.titles
    pose = replace(POSE, filled=False, carried=carried, needed=needed)
    repeat = replace(REPEAT, needed=False)
    log = _log_table.typed(file, [pose, repeat, POSE_REPEAT, REMARK], stated, section)
    out = [*log.notes]
    for k in np.flatnonzero(log.word.get("remark", np.array([])) != ""):
        where = [f"{what} {shown(int(log.number[what][k]))}" for what in ("pose", "repeat")
                 if what in log.number and np.isfinite(log.number[what][k])]  # fmt: skip
        where += [log.word[POSE_REPEAT.stem][k]] if POSE_REPEAT.stem in log.word else []
        said_of = f", {' '.join(where)}" if where else ""
        out.append(f"{name}, line {log.line[k]}{said_of}: {log.word['remark'][k]}")
    return out
