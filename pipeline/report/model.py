"""What the report says, in order, independent of how it is shown.

Page and PDF both walk through the same record, so neither can say what the other does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from pipeline.report import words
from pipeline.report.captions import figures
from pipeline.report.history import Change, changes
from pipeline.report.numbers import (
    MISSING,
    common_prefix,
    interval,
    known,
    p_value,
    percent,
    plain,
    prefixed,
    probability,
    typeset,
    with_std,
)
from pipeline.report.record import (
    Block,
    Column,
    Entry,
    Report,
    Section,
    Table,
    Text,
    entry,
    text_entry,
)
from pipeline.report.summaries import Tables, has, registration_by_target

Result = Mapping[str, Any]

MOST_ROWS = 400
"""Rows of rejected readings shown; the rest is counted and stands in the tables."""


def compose(
    result: Result,
    tables: Tables,
    run_time_s: float | None = None,
    previous: Result | None = None,
) -> Report:
    """Everything the report says about a campaign.

    Args:
        result: The object of result.json; keys that are missing or null leave their part out.
        tables: REGISTRATION, RESIDUALS, REJECTED, VALIDATION, FORCES and DISPLACEMENTS by the
            lower-case name of their promise, SI.
        run_time_s: How long the run took [s].
        previous: The result of the robot's previous campaign, to say what has changed.
    """
    title, tone = words.VERDICTS.get(
        _get(result, "diagnosis", "verdict"), ("Stiffness identified", "neutral")
    )
    sections = [
        _stiffness(result, previous),
        _diagnosis(result, tables),
        _test_pose(result, tables),
        _validation(result, tables),
        _residuals(result, tables),
        _budget(result),
        _registration(result, tables),
        _rejected(result, tables),
        _method(result),
    ]
    campaign, robot = str(result.get("campaign") or "campaign"), str(result.get("robot") or "robot")
    return Report(
        kicker=f"Joint stiffness · {robot}",
        heading=campaign,
        title=f"Joint stiffness of {robot}: {campaign}",
        verdict=title,
        tone=tone,
        sentences=tuple(_verdict_sentences(result)),
        sections=tuple(s for s in sections if s is not None),
        elsewhere="The same stands in index.html and report.pdf, the numbers in result.json.",
        run_time=None if run_time_s is None else f"{run_time_s:.1f} s",
    )


def _get(tree: Any, *path: str) -> Any:
    """The value at a path of keys, None where any of them is missing."""
    for key in path:
        if not isinstance(tree, Mapping):
            return None
        tree = tree.get(key)
    return tree


def _list(tree: Any, *path: str) -> list[Any]:
    value = _get(tree, *path)
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else []


def _section(key: str, title: str, blocks: Iterable[Block | None]) -> Section | None:
    kept = tuple(block for block in blocks if block is not None)
    return Section(key, title, kept) if kept else None


# --- the verdict ---------------------------------------------------------------------------


def _verdict_sentences(result: Result) -> list[str]:
    given = result.get("verdict_sentence")
    if isinstance(given, str) and given:
        given = [given]
    if given:
        return [words.in_words(str(sentence)) for sentence in given]
    verdict = _get(result, "diagnosis", "verdict")
    weak = [_joint_name(s) for s in _list(result, "stiffness") if not s.get("identifiable", True)]
    first = words.EXPLAINED.get(
        str(verdict),
        "The joint stiffnesses are identified; whether the model is complete was not tested.",
    )
    if weak:
        return [first, f"Not determined by these poses: {', '.join(weak)}."]
    return [first, "All joint stiffnesses are determined; their uncertainties stand in the table."]


def _joint_name(one: Mapping[str, Any]) -> str:
    return str(one.get("name") or f"joint {one.get('joint')}")


# --- stiffness -----------------------------------------------------------------------------


def _stiffness(result: Result, previous: Result | None) -> Section | None:
    joints = _list(result, "stiffness")
    if not joints:
        return None
    said = [*_list(result, "findings"), *(j.get("finding") for j in joints)]
    since = changes(_list(previous, "stiffness"), joints) if previous else []
    said += [_changed(c, str(_get(previous, "campaign"))) for c in since if c.sure]
    findings = [Text(f, "finding") for f in dict.fromkeys(str(f) for f in said if f)]
    return _section(
        "stiffness",
        "Joint stiffnesses",
        [
            *findings,
            _stiffness_table(
                joints, _extended_stiffness(result), _richer_words(result), since, previous
            ),
            *figures(("stiffness",), result, {}),
            _compliance_table(joints),
            _fit_text(result),
        ],
    )


def _changed(change: Change, campaign: str) -> str:
    return (
        f"{change.name} changed by {_bracketed(with_std(change.percent, change.percent_std))} % "
        f"since {campaign}, more than chance explains."
    )


def _richer_words(result: Result) -> str:
    wrong = _get(result, "diagnosis", "verdict") == "bad_data"
    return "With the data put right" if wrong else "With the named causes"


def _stiffness_table(
    joints: list[Any],
    extended: list[Any],
    richer_words: str,
    since: list[Change],
    previous: Result | None,
) -> Table:
    factor, letter = common_prefix(j.get("value") for j in joints)
    richer = {j.get("name"): j for j in extended}
    has_nominal = any(known(j.get("nominal")) for j in joints)
    columns = [
        Column("Joint"),
        Column("Stiffness ± standard uncertainty", numeric=True),
        Column("95 % interval", numeric=True),
        Column("Unit"),
        Column("Relative uncertainty [%]", numeric=True),
    ]
    if has_nominal:
        columns += [Column("Nominal", numeric=True), Column("Of nominal [%]", numeric=True)]
    if richer:
        columns.append(Column(richer_words, numeric=True))
    changed = {change.name: change for change in since}
    if changed:
        columns.append(Column(f"Change since {_get(previous, 'campaign')} [%]", numeric=True))
    rows = []
    for joint in joints:
        row = _stiffness_row(joint, factor, letter)
        if has_nominal:
            row += _nominal_entries(joint, factor)
        if richer:
            row.append(_scaled(richer.get(joint.get("name")), factor))
        if changed:
            row.append(_change_entry(changed.get(_joint_name(joint))))
        rows.append(tuple(row))
    note = (
        "Stiffness is one over the estimated compliance; its interval is that of the compliance, "
        "turned over, and therefore not symmetric."
    )
    return Table("stiffness", "Stiffness of each joint", tuple(columns), tuple(rows), note)


def _change_entry(change: Change | None) -> Entry:
    if change is None or change.percent is None:
        return Entry(MISSING)
    return entry(with_std(change.percent, change.percent_std), change.percent)


def _extended_stiffness(result: Result) -> list[Any]:
    """Stiffnesses of the model with the named causes; nothing where no cause is named."""
    return _list(result, "extended", "stiffness") if _list(result, "diagnosis", "causes") else []


def _stiffness_row(joint: Mapping[str, Any], factor: float, letter: str) -> list[Entry]:
    value, std = _times(joint.get("value"), factor), _times(joint.get("std"), factor)
    given = [_times(bound, factor) for bound in joint.get("ci95") or [None, None]]
    relative = joint.get("relative_std")
    if relative is None and known(joint.get("value")) and known(joint.get("std")):
        relative = joint["std"] / abs(joint["value"]) if joint["value"] else None
    determined = bool(joint.get("identifiable", True))
    return [
        text_entry(_joint_name(joint), sort=joint.get("joint")),
        _scaled(joint, factor) if determined else Entry("not determined"),
        entry(interval(given, std), given[0]) if determined else Entry(MISSING),
        text_entry(prefixed(str(joint.get("unit") or ""), letter)),
        entry(plain(_times(relative, 0.01), 2), relative) if known(value) else Entry(MISSING),
    ]


def _scaled(joint: Mapping[str, Any] | None, factor: float) -> Entry:
    if joint is None or not joint.get("identifiable", True) or not known(joint.get("value")):
        return Entry(MISSING)
    value, std = _times(joint.get("value"), factor), _times(joint.get("std"), factor)
    return entry(with_std(value, std), value)


def _nominal_entries(joint: Mapping[str, Any], factor: float) -> list[Entry]:
    nominal, value, std = joint.get("nominal"), joint.get("value"), joint.get("std")
    if not known(nominal) or not nominal:
        return [Entry(MISSING), Entry(MISSING)]
    shown = entry(plain(nominal / factor), nominal)
    if not known(value) or not joint.get("identifiable", True):
        return [shown, Entry(MISSING)]
    ratio, spread = 100 * value / nominal, _times(std, nominal / 100)
    return [shown, entry(with_std(ratio, spread), ratio)]


def _bracketed(text: str) -> str:
    return f"({text})" if "±" in text and not text.startswith("(") else text


def _times(value: Any, factor: float) -> float | None:
    return float(value) / factor if known(value) else None


def _compliance_table(joints: list[Any]) -> Table | None:
    if not any(known(j.get("compliance")) for j in joints):
        return None
    rows = [
        (
            text_entry(_joint_name(j), sort=j.get("joint")),
            entry(with_std(j.get("compliance"), j.get("compliance_std")), j.get("compliance")),
            text_entry(_compliance_unit(str(j.get("unit") or ""))),
        )
        for j in joints
    ]
    columns = (
        Column("Joint"),
        Column("Compliance ± standard uncertainty", numeric=True),
        Column("Unit"),
    )
    return Table("compliance", "Compliances, as estimated", columns, tuple(rows))


def _compliance_unit(unit: str) -> str:
    over, _, under = unit.partition("/")
    over = over.strip().replace(" ", "·")
    return f"{under.strip() or '1'}/{f'({over})' if '·' in over else over}" if over else ""


def _fit_text(result: Result) -> Text | None:
    fit = result.get("fit")
    if not fit:
        return None
    said = []
    if known(fit.get("rms_mm")):
        said.append(f"The fit leaves {plain(fit['rms_mm'])} mm rms per coordinate.")
    if known(fit.get("chi2")) and known(fit.get("dof")) and known(fit.get("p_value")):
        said.append(
            f"Weighted by the noise, chi² is {plain(fit['chi2'], 4)} for {fit['dof']} degrees of "
            f"freedom ({p_value(fit['p_value'])})."
        )
    if fit.get("noise_statement"):
        said.append(str(fit["noise_statement"]))
    elif fit.get("noise_from") == "residuals":
        said.append(
            "No noise is stated for this campaign: it is estimated from the residuals, so a misfit "
            "of the model makes the uncertainties larger but cannot be told from noise."
        )
    if known(fit.get("residual_std_mm")):
        said.append(f"The residual standard deviation is {plain(fit['residual_std_mm'])} mm.")
    return Text(" ".join(said)) if said else None


# --- what is missing -----------------------------------------------------------------------


def _diagnosis(result: Result, tables: Tables) -> Section | None:
    diagnosis = result.get("diagnosis")
    title = "What the simulation gets wrong"
    if not diagnosis:
        return _section(
            "diagnosis", title, [Text("This run did not search for effects the model lacks.")]
        )
    causes, poses = _list(diagnosis, "causes"), _list(diagnosis, "next_poses")
    gains = list(dict.fromkeys(" ".join(_gain_sentences(one)) for one in causes))
    shared = gains[0] if len(gains) == 1 and len(causes) > 1 else ""
    blocks: list[Block | None] = [_explained(diagnosis)]
    for number, one in enumerate(causes, 1):
        blocks += _cause(number, one, with_gain=not shared)
    blocks += [
        Text(shared.replace("With it ", "With all causes ", 1)) if shared else None,
        *figures(("gain", "evidence"), result, tables),
        _next_poses(poses),
        _next_joint_values(poses, _list(result, "stiffness")),
        _blind_spots(_list(diagnosis, "blind_spots")),
    ]
    return _section("diagnosis", title, blocks)


def _explained(diagnosis: Mapping[str, Any]) -> Text | None:
    sentence = words.EXPLAINED.get(str(diagnosis.get("verdict")))
    why = diagnosis.get("why")
    if why:
        return Text(words.in_words(str(why)))
    return None if sentence is None else Text(sentence)


def _cause(number: int, one: Mapping[str, Any], with_gain: bool) -> list[Block]:
    name, where = str(one.get("name")), one.get("where")
    said = words.cause(name, where)
    facts = [
        _evidence_sentence(one),
        f"It shows like this: {one['signature']}." if one.get("signature") else "",
        _probability_sentence(one),
        *_parameter_sentences(one),
        *(_gain_sentences(one) if with_gain else []),
        f"What would settle it: {one['needs']}." if one.get("needs") else "",
    ]
    blocks: list[Block] = [
        Text(f"Cause {number}: {said} ({words.label(name, where)}).", "finding"),
        Text(" ".join(fact for fact in facts if fact)),
    ]
    rivals = _list(one, "rivals")
    return [*blocks, _rivals(number, rivals)] if rivals else blocks


def _evidence_sentence(one: Mapping[str, Any]) -> str:
    """What speaks for a mistake in the data, and what the corrected result rests on."""
    evidence = one.get("evidence")
    if not isinstance(evidence, Mapping):
        return ""
    said = [str(evidence.get(key) or "") for key in ("sentence", "correction")]
    return " ".join(f"{text[0].upper()}{text[1:]}." for text in said if text)


def _probability_sentence(one: Mapping[str, Any]) -> str:
    said = []
    if known(one.get("probability")):
        said.append(f"Its probability among the known causes is {probability(one['probability'])}")
    if known(one.get("p_value")):
        said.append(f"without it, chance makes such readings with {p_value(one['p_value'])}")
    sentence = "; ".join(said)
    return f"{sentence[0].upper()}{sentence[1:]}." if sentence else ""


def _parameter_sentences(one: Mapping[str, Any]) -> list[str]:
    sizes = [
        f"{p.get('name')} = {_bracketed(with_std(p.get('value'), p.get('std')))} "
        f"{str(p.get('unit') or '').replace(' ', '·')}".rstrip()
        for p in _list(one, "parameters")
    ]
    return [f"Its size: {', '.join(sizes)}."] if sizes else []


def _gain_sentences(one: Mapping[str, Any]) -> list[str]:
    gain = one.get("gain") or {}
    said = []
    before, after = gain.get("held_out_rms_before_mm"), gain.get("held_out_rms_after_mm")
    if known(before) and known(after):
        low, high = [*(gain.get("ci95") or []), None, None][:2]
        sure = f", 95 % interval {percent(low)} to {percent(high)}" if known(low) else ""
        less = gain.get("reduction")
        share = f" ({percent(less)} less{sure})" if known(less) else ""
        how = "put right" if one.get("evidence") else "in the model"
        said.append(
            f"With it {how} the error at poses that were left out falls from {plain(before)} mm "
            f"to {plain(after)} mm{share}."
        )
    if known(gain.get("test_pose_change_mm")):
        said.append(
            f"The predicted deflection at the test pose changes by "
            f"{plain(gain['test_pose_change_mm'])} mm."
        )
    return said


def _rivals(number: int, rivals: list[Any]) -> Table:
    rows = [
        (
            text_entry(words.cause(str(r.get("name")), r.get("where"))),
            text_entry(words.label(str(r.get("name")), r.get("where"))),
            entry(probability(r.get("probability")), r.get("probability")),
        )
        for r in rivals
    ]
    columns = (Column("Rival"), Column("Name"), Column("Probability", numeric=True))
    return Table(f"rivals-{number}", f"What else cause {number} could be", columns, tuple(rows))


def _next_poses(poses: list[Any]) -> Table | None:
    rows = [
        (
            entry(str(number), number),
            text_entry(" / ".join(words.from_label(str(n)) for n in p.get("separates") or [])),
            entry(plain(_size(p.get("force_n"))), _size(p.get("force_n"))),
            text_entry(_how(p)),
            entry(plain(p.get("sigmas_before"), 2), p.get("sigmas_before")),
            entry(plain(p.get("sigmas_after"), 2), p.get("sigmas_after")),
        )
        for number, p in enumerate(poses, 1)
    ]
    columns = (
        Column("Pose", numeric=True),
        Column("Tells apart"),
        Column("Pull [N]", numeric=True),
        Column("How"),
        Column("Separation now [σ]", numeric=True),
        Column("With this pose [σ]", numeric=True),
    )
    note = "Below 4.6 σ two causes are not told apart reliably."
    return Table("next-poses", "What to measure next", columns, tuple(rows), note) if rows else None


def _how(pose: Mapping[str, Any]) -> str:
    anchor = pose.get("anchor_m")
    where = f"towards ({', '.join(f'{v:.2f}' for v in anchor)}) m" if anchor else ""
    return ", ".join(part for part in (where, str(pose.get("pull") or "")) if part)


def _size(force: Any) -> float | None:
    """Size of a force given as a number or as three components [N]."""
    if isinstance(force, Sequence) and not isinstance(force, str):
        return math.hypot(*(float(f) for f in force))
    return float(force) if known(force) else None


def _next_joint_values(poses: list[Any], joints: list[Any]) -> Table | None:
    rows = []
    for number, pose in enumerate(poses, 1):
        q = pose.get("q") or []
        rows.append((entry(str(number), number), *[entry(plain(v, 4), v) for v in q]))
    if not rows or len({len(row) for row in rows}) != 1:
        return None
    columns = [Column("Pose", numeric=True)]
    for j in range(len(rows[0]) - 1):
        one = joints[j] if j < len(joints) else {}
        unit = "m" if one.get("joint_type") == "prismatic" or one.get("unit") == "N/m" else "°"
        columns.append(Column(f"{_coordinate(one, j)} [{unit}]", numeric=True))
    return Table("next-joints", "Joint values of these poses", tuple(columns), tuple(rows))


def _coordinate(joint: Mapping[str, Any], index: int) -> str:
    return str(joint.get("name") or f"q{index + 1}").removeprefix("k_")


def _blind_spots(spots: list[Any]) -> Table | None:
    alike: dict[tuple[str, str, str, bool], list[Any]] = {}
    for spot in spots:
        never = spot.get("smallest_visible") is None
        key = (str(spot.get("name")), str(spot.get("unit") or ""), str(spot.get("needs")), never)
        alike.setdefault(key, []).append(spot)
    rows = [
        (
            text_entry(words.CAUSES.get(name, name.replace("_", " "))),
            text_entry(_places(group)),
            entry(*_smallest(group, unit)),
            text_entry("; ".join(dict.fromkeys(_why(s) for s in group))),
            text_entry(needs),
        )
        for (name, unit, needs, _), group in alike.items()
    ]
    columns = (
        Column("Effect"),
        Column("Where"),
        Column("Smallest size seen", numeric=True),
        Column("Why"),
        Column("What would show it"),
    )
    note = "These effects may be there without this campaign showing them."
    title = "What these readings cannot see"
    return Table("blind-spots", title, columns, tuple(rows), note) if rows else None


def _places(group: list[Any]) -> str:
    places = [s["where"] for s in group if s.get("where") is not None]
    return ", ".join(sorted((str(p).replace("_", " ") for p in places), key=lambda p: (len(p), p)))


def _smallest(group: list[Any], unit: str) -> tuple[str, float | None]:
    """Smallest visible size of effects of one kind, as a range over their places."""
    sizes = sorted(s["smallest_visible"] for s in group if known(s.get("smallest_visible")))
    if not sizes:
        return "never visible", None
    wide = sizes[-1] > 300 * sizes[0]
    factor, letter = (1.0, "") if unit in ("", "1") or wide else common_prefix(sizes)
    shown = list(dict.fromkeys(plain(size / factor, 2) for size in (sizes[0], sizes[-1])))
    name = "" if unit in ("", "1") else f" {prefixed(unit, letter)}"
    return f"{' to '.join(shown)}{name}", sizes[0]


def _why(spot: Mapping[str, Any]) -> str:
    """Why it is not seen; how far a usual size stays below what would be seen, once per group."""
    size, typical = spot.get("smallest_visible"), spot.get("typical")
    if known(size) and known(typical):
        return "a usual size stays below what these readings can show"
    return str(spot.get("why") or "")


# --- predictions ---------------------------------------------------------------------------


def _test_pose(result: Result, tables: Tables) -> Section | None:
    plainly = _list(result, "test_pose_deflection")
    extended = _list(result, "extended", "test_pose_deflection")
    return _section(
        "test-pose",
        "Deflection under load",
        [
            _deflections(
                "deflection", "Predicted deflection at the test pose, joint springs alone", plainly
            ),
            _deflections(
                "deflection-extended", f"The same: {_richer_words(result).lower()}", extended
            ),
            *figures(("workspace", "workspace-extended"), result, tables),
        ],
    )


def _deflections(name: str, title: str, points: list[Any]) -> Table | None:
    if not points:
        return None
    rows = []
    for point in points:
        values = [point.get(f"d{axis}_mm") for axis in "xyz"]
        stds = [*(point.get("std_mm") or []), None, None, None][:3]
        size = sum(v * v for v in values) ** 0.5 if all(known(v) for v in values) else None
        cells = [entry(with_std(v, s), v) for v, s in zip(values, stds, strict=True)]
        rows.append((text_entry(point.get("target")), *cells, entry(plain(size), size)))
    columns = (
        Column("Target"),
        *[Column(f"d{axis} [mm]", numeric=True) for axis in "xyz"],
        Column("Distance [mm]", numeric=True),
    )
    note = "Base frame; ± is one standard uncertainty from the full covariance of the estimate."
    return Table(name, title, columns, tuple(rows), note)


def _validation(result: Result, tables: Tables) -> Section | None:
    given = result.get("validation")
    if not given:
        return None
    return _section(
        "validation",
        "How far predictions can be trusted",
        [
            _held_out(given),
            _mu_table(given),
            *figures(("prediction",), result, tables),
        ],
    )


def _held_out(given: Mapping[str, Any]) -> Text | None:
    value = given.get("held_out_rms_mm")
    if not known(value):
        return None
    return Text(
        f"At poses that were left out of the estimate, the model misses the readings by "
        f"{plain(value)} mm rms per coordinate."
    )


def _mu_table(given: Mapping[str, Any]) -> Table | None:
    kinds = [
        ("around the test pose", "full covariance", given.get("test_pose")),
        ("over the workspace", "full covariance", given.get("global")),
        ("around the test pose", "independent, Eq. (23)", _get(given, "independent", "test_pose")),
        ("over the workspace", "independent, Eq. (23)", _get(given, "independent", "global")),
    ]
    targets = list(dict.fromkeys(t for _, _, mu in kinds for t in mu or {}))
    if not targets:
        return None
    rows = [
        (
            text_entry(where),
            text_entry(draw),
            *[entry(percent(mu.get(t), 3), mu.get(t)) for t in targets],
        )
        for where, draw, mu in kinds
        if mu
    ]
    columns = (
        Column("Poses"),
        Column("Stiffnesses drawn"),
        *[Column(t, numeric=True) for t in targets],
    )
    number = given.get("poses")
    note = f"Mean over {number} poses each. " if known(number) else ""
    note += (
        "The paper draws the stiffnesses independently; the estimate has correlations, so the rows "
        "with the full covariance are the ones to rely on."
    )
    title = "Error of the predicted deflection from the uncertain stiffnesses, Eq. (22)"
    return Table("prediction-error", title, columns, tuple(rows), note)


# --- what the data look like ---------------------------------------------------------------


def _residuals(result: Result, tables: Tables) -> Section | None:
    names = ("pose-rms", "residual-force", "whitened", "arrows")
    return _section("residuals", "Residuals", figures(names, result, tables))


def _budget(result: Result) -> Section | None:
    return _section(
        "budget",
        "Uncertainty budget",
        [
            _budget_table(_list(result, "budget")),
            _noise_table(_list(result, "noise", "components")),
        ],
    )


def _budget_table(lines: list[Any]) -> Table | None:
    if not lines:
        return None
    shares = [key for key in lines[0] if key != "source"]
    rows = [
        (
            text_entry(words.SOURCES.get(str(line.get("source")), line.get("source"))),
            *[entry(_share(line.get(key)), line.get(key)) for key in shares],
        )
        for line in lines
    ]
    columns = (Column("Source"), *[Column(key, numeric=True) for key in shares])
    note = "Shares of the variance of each stiffness; the largest is where better measuring pays."
    return Table("budget", "Where the uncertainty comes from", columns, tuple(rows), note)


def _share(value: Any) -> str:
    return "below 0.1" if known(value) and value < 0.1 else plain(value, 2)


def _noise_table(found: list[Any]) -> Table | None:
    rows = []
    for one in found:
        scale, std = one.get("found_over_stated"), one.get("std")
        p = one.get("p_value")
        rows.append(
            (
                text_entry(words.SOURCES.get(str(one.get("name")), one.get("name"))),
                entry(with_std(scale, std), scale),
                entry(p_value(p) if known(p) else MISSING, p),
            )
        )
    columns = (
        Column("Noise of"),
        Column("Found over stated", numeric=True),
        Column("Chance of as much or more", numeric=True),
    )
    note = "Found from repeats, zeros read again and the effector's own triangle; 1 is as stated."
    title = "Noise in the readings beside the stated noise"
    return Table("noise", title, columns, tuple(rows), note) if rows else None


def _registration(result: Result, tables: Tables) -> Section | None:
    table = None
    if has(tables, "registration"):
        digest = registration_by_target(tables["registration"])
        rows = [
            (
                text_entry(r.target),
                entry(str(r.readings), r.readings),
                *[entry(plain(v, 2), v) for v in (r.dx, r.dy, r.dz, r.rms, r.largest)],
            )
            for r in _rows(digest)
        ]
        names = ("mean dx", "mean dy", "mean dz", "rms", "largest")
        columns = (
            Column("Base reflector"),
            Column("Readings", numeric=True),
            *[Column(f"{name} [mm]", numeric=True) for name in names],
        )
        table = Table(
            "registration",
            "Base reflectors: measured minus nominal, base frame",
            columns,
            tuple(rows),
        )
    return _section(
        "registration",
        "Registration of the tracker",
        [_registration_text(result), table, *figures(("registration",), result, tables)],
    )


def _rows(table: pd.DataFrame) -> Iterator[Any]:
    """Rows with their columns as attributes."""
    return table.itertuples()


def _registration_text(result: Result) -> Text | None:
    given = result.get("registration")
    if not isinstance(given, Mapping):
        return None
    said = []
    if known(given.get("rms_mm")):
        said.append(f"The base reflectors fit their nominals to {plain(given['rms_mm'])} mm rms")
        if known(given.get("max_mm")):
            said[-1] += f", {plain(given['max_mm'])} mm at worst"
        said[-1] += "."
    if known(given.get("chi2")) and known(given.get("dof")):
        tested = f" ({p_value(given['p_value'])})" if known(given.get("p_value")) else ""
        said.append(
            f"chi² is {plain(given['chi2'], 4)} for {given['dof']} degrees of freedom{tested}."
        )
    rotation, translation = _worst(given, "rotation_std_rad"), _worst(given, "translation_std_m")
    if rotation is not None:
        said.append(
            f"The standard uncertainty of its orientation is {plain(1e6 * rotation, 2)} µrad."
        )
    if translation is not None:
        said.append(f"That of its origin is {plain(1e6 * translation, 2)} µm.")
    return Text(" ".join(said)) if said else None


def _worst(given: Mapping[str, Any], key: str) -> float | None:
    value = given.get(key)
    values = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    sizes = [float(v) for v in values if known(v)]
    return max(sizes) if sizes else None


def _rejected(result: Result, tables: Tables) -> Section:
    rejected = _list(result, "rejected")
    if not rejected and has(tables, "rejected"):
        rejected = tables["rejected"].to_dict("records")
    title = "Rejected rows"
    if not rejected:
        return Section("rejected", title, (Text("No row of the raw files was rejected."),))
    rows = [
        (text_entry(r.get("file")), _line(r.get("line")), text_entry(r.get("reason")))
        for r in rejected[:MOST_ROWS]
    ]
    columns = (Column("File", code=True), Column("Line", numeric=True), Column("Reason"))
    more = len(rejected) - len(rows)
    note = f"{more} more stand in result.json." if more > 0 else ""
    count = "1 row was" if len(rejected) == 1 else f"{len(rejected)} rows were"
    said = Text(f"{count} left out of the estimate; nothing was corrected silently.")
    return Section(
        "rejected", title, (said, Table("rejected", "Left out and why", columns, tuple(rows), note))
    )


def _line(line: Any) -> Entry:
    return Entry("whole file", 0) if not known(line) else entry(str(int(line)), int(line))


# --- how it was done -----------------------------------------------------------------------

METHOD = (
    "Loaded minus unloaded reflector positions c, Eq. (20), are explained by one linear spring per "
    "joint, c = B x with the compliances x, Eqs. (6), (7), (19). The compliances come from "
    "generalised least squares with the full covariance of c: tracker noise per reading, the zero "
    "shared by all pulls of a pose, the force reading that moves all coordinates of a pull "
    "together, the direction of the chain and the registration. The force acts along the chain, "
    "Eqs. (10), (11). Validation leaves out one pose with all its pulls at a time."
)


def _method(result: Result) -> Section:
    equilibrium = _get(result, "model", "equilibrium")
    said = METHOD
    if equilibrium == "deformed":
        said += " The force acts on the deflected robot (second order in the load)."
    elif equilibrium == "undeformed":
        said += " The geometry is that of the unloaded robot."
    second = _get(result, "fit", "second_order_rms_mm")
    if known(second):
        said += (
            f" The second order in the load amounts to {plain(second, 2)} mm rms"
            f"{'.' if equilibrium == 'deformed' else ' and is left out.'}"
        )
    blocks = [Text(said), _assumptions(result), _inputs(result), _versions(result)]
    return Section(
        "method",
        "Method, assumptions, versions, inputs",
        tuple(block for block in blocks if block is not None),
    )


def _assumptions(result: Result) -> Table | None:
    rows = [(text_entry(typeset(str(a))),) for a in _list(result, "assumptions")]
    return Table("assumptions", "Assumptions", (Column("Assumed"),), tuple(rows)) if rows else None


def _inputs(result: Result) -> Table | None:
    rows = [
        (
            text_entry(i.get("file")),
            entry(str(i.get("bytes")), i.get("bytes")) if known(i.get("bytes")) else Entry(MISSING),
            text_entry(i.get("sha256")),
        )
        for i in _list(result, "inputs")
    ]
    columns = (
        Column("File", code=True),
        Column("Bytes", numeric=True),
        Column("SHA-256", code=True),
    )
    return Table("inputs", "Input files", columns, tuple(rows)) if rows else None


def _versions(result: Result) -> Text | None:
    versions = result.get("versions") or {}
    said = ", ".join(f"{name} {version}" for name, version in versions.items())
    return Text(f"Computed with {said}.") if said else None
