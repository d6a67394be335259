"""Joint stiffnesses, what changed since the previous campaign, and how well the model fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.answer.history import Change, changes, trusted
from pipeline.base.quantities import (
    MISSING,
    common_prefix,
    interval,
    known,
    p_value,
    plain,
    prefixed,
    probability,
    with_std,
)
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import Column, Entry, Section, Table, Text, entry, text_entry
from pipeline.report.sections._tree import at, bracketed, items, joint_name, section_of
from pipeline.report.summaries import Result


def stiffness(result: Result, previous: Result | None) -> Section | None:
    """The table of stiffnesses with what is odd about them; None when there is none."""
    joints = items(result, "stiffness")
    if not joints:
        return None
    said = [*items(result, "findings"), *(j.get("finding") for j in joints)]
    said = [words.in_words(str(f)) for f in said if f]
    told = previous is not None and trusted(result)
    since = changes(items(previous, "stiffness"), joints) if told else []
    said += [_changed(c, str(at(previous, "campaign"))) for c in since if c.sure]
    findings = [Text(f, "finding") for f in _of_each(list(dict.fromkeys(said)))]
    return section_of(
        "stiffness",
        "Joint stiffnesses",
        [
            *findings,
            _stiffness_table(joints, result, since, previous),
            _hypotheses_table(items(result, "recommended", "hypotheses")),
            *figures(("stiffness",), result, {}),
            _compliance_table(joints),
            _fit_text(result),
        ],
    )


def _of_each(said: Sequence[str]) -> list[str]:
    """Sentences that begin with a stiffness; where several go on alike, one for all of them."""
    alike: dict[str, list[str]] = {}
    for sentence in said:
        name, _, rest = sentence.partition(" ")
        stiffness = name.startswith("k_")
        alike.setdefault(rest if stiffness else sentence, []).append(name if stiffness else "")
    return [rest if names == [""] else f"{_each(names)} {rest}" for rest, names in alike.items()]


def _each(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"Each of {', '.join(names[:-1])} and {names[-1]}"


def _changed(change: Change, campaign: str) -> str:
    return (
        f"{change.name} changed by {bracketed(with_std(change.percent, change.percent_std))} % "
        f"since {campaign}, more than chance explains."
    )


def _stiffness_table(
    joints: list[Any], result: Result, since: list[Change], previous: Result | None
) -> Table:
    factor, letter = common_prefix(j.get("value") for j in joints)
    other = words.beside(result)
    springs = {j.get("name"): j for j in items(other[1], "stiffness")} if other else {}
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
    if other:
        columns.append(Column(words.capital(other[0]), numeric=True))
    changed = {change.name: change for change in since}
    if changed:
        columns.append(Column(f"Change since {at(previous, 'campaign')} [%]", numeric=True))
    rows = []
    for joint in joints:
        row = _stiffness_row(joint, factor, letter)
        if has_nominal:
            row += _nominal_entries(joint, factor)
        if other:
            row.append(_scaled(springs.get(joint.get("name")), factor))
        if changed:
            row.append(_change_entry(changed.get(joint_name(joint))))
        rows.append(tuple(row))
    note = (
        "Stiffness is one over the estimated compliance; its interval is that of the compliance, "
        "turned over, and therefore not symmetric."
    )
    title = f"Stiffness of each joint, {words.values_of(result)}"
    return Table("stiffness", title, tuple(columns), tuple(rows), note)


def _hypotheses_table(hypotheses: list[Any]) -> Table | None:
    """What the values are averaged over; nothing where they are those of one model."""
    if len(hypotheses) < 2:
        return None
    rows = [
        (
            text_entry(" and ".join(_hypothesis_words(c) for c in one.get("causes") or [])),
            entry(probability(one.get("weight")), one.get("weight")),
        )
        for one in hypotheses
    ]
    columns = (Column("Beside the joint springs"), Column("Weight", numeric=True))
    return Table("hypotheses", "What the values are averaged over", columns, tuple(rows))


def _hypothesis_words(cause: Mapping[str, Any]) -> str:
    said = words.cause(str(cause.get("name")), cause.get("where"))
    if cause.get("form"):
        said += f" ({cause['form']})"
    return said if cause.get("in_catalogue", True) else f"something without a name like {said}"


def _change_entry(change: Change | None) -> Entry:
    if change is None or change.percent is None:
        return Entry(MISSING)
    return entry(with_std(change.percent, change.percent_std), change.percent)


def _stiffness_row(joint: Mapping[str, Any], factor: float, letter: str) -> list[Entry]:
    value, std = _times(joint.get("value"), factor), _times(joint.get("std"), factor)
    given = [_times(bound, factor) for bound in joint.get("ci95") or [None, None]]
    relative = joint.get("relative_std")
    if relative is None and known(joint.get("value")) and known(joint.get("std")):
        relative = joint["std"] / abs(joint["value"]) if joint["value"] else None
    determined = bool(joint.get("identifiable", True))
    return [
        text_entry(joint_name(joint), sort=joint.get("joint")),
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


def _times(value: Any, factor: float) -> float | None:
    return float(value) / factor if known(value) else None


def _compliance_table(joints: list[Any]) -> Table | None:
    if not any(known(j.get("compliance")) for j in joints):
        return None
    rows = [
        (
            text_entry(joint_name(j), sort=j.get("joint")),
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
