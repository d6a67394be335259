"""What the simulation gets wrong: causes, rivals and gain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.base.quantities import known, p_value, percent, plain, probability, with_std
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import Block, Column, Section, Table, Text, entry, text_entry
from pipeline.report.sections._tree import bracketed, items, section_of
from pipeline.report.sections.unseen import blind_spots, next_joint_values, next_poses
from pipeline.report.summaries import Result, Tables


def diagnosis(result: Result, tables: Tables) -> Section | None:
    """The causes, what is gained, what to measure next and what stays unseen."""
    said = result.get("diagnosis")
    title = "What the simulation gets wrong"
    if not said:
        return section_of(
            "diagnosis", title, [Text("This run did not search for effects the model lacks.")]
        )
    causes, poses = items(said, "causes"), items(said, "next_poses")
    gains = list(dict.fromkeys(" ".join(_gain_sentences(one)) for one in causes))
    shared = gains[0] if len(gains) == 1 and len(causes) > 1 else ""
    blocks: list[Block | None] = [_explained(said)]
    for number, one in enumerate(causes, 1):
        blocks += _cause(number, one, with_gain=not shared)
    blocks += [
        _alone(items(said, "alone")),
        Text(shared.replace("With it ", "With all causes ", 1)) if shared else None,
        *figures(("gain", "evidence", "separability"), result, tables),
        next_poses(poses),
        next_joint_values(poses, items(result, "stiffness")),
        blind_spots(items(said, "blind_spots")),
    ]
    return section_of("diagnosis", title, blocks)


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
        _unnamed_sentence(one),
        *_parameter_sentences(one),
        *(_gain_sentences(one) if with_gain else []),
        f"What would settle it: {one['needs']}." if one.get("needs") else "",
    ]
    blocks: list[Block] = [
        Text(f"Cause {number}: {said} ({words.label(name, where)}).", "finding"),
        Text(" ".join(fact for fact in facts if fact)),
    ]
    rivals = items(one, "rivals")
    return [*blocks, _rivals(number, rivals)] if rivals else blocks


def _alone(single: list[Any]) -> Table | None:
    """What each of the likeliest causes does if it is the only one."""
    rows = []
    for one in single:
        low, high = [*(one.get("ci95") or []), None, None][:2]
        name, where = str(one.get("name")), one.get("where")
        rows.append(
            (
                text_entry(words.cause(name, where)),
                text_entry(words.label(name, where)),
                entry(probability(one.get("probability")), one.get("probability")),
                entry(percent(one.get("reduction")), one.get("reduction")),
                text_entry(f"{percent(low)} to {percent(high)}"),
            )
        )
    columns = (
        Column("Cause"),
        Column("Name"),
        Column("Probability", numeric=True),
        Column("Left-out error falls by", numeric=True),
        Column("95 % interval"),
    )
    return Table("alone", "If it is one cause alone", columns, tuple(rows)) if rows else None


def _unnamed_sentence(one: Mapping[str, Any]) -> str:
    """How likely it is none of the known causes; said where it matters."""
    other = one.get("outside_catalogue") or {}
    chance = other.get("probability")
    if not known(chance) or chance < 0.01:
        return ""
    looks = words.cause(str(other.get("looks_like")), other.get("where"))
    return f"That it is none of the known causes has {probability(chance)}; it would be: {looks}."


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
        f"{p.get('name')} = {bracketed(with_std(p.get('value'), p.get('std')))} "
        f"{str(p.get('unit') or '').replace(' ', '·')}".rstrip()
        for p in items(one, "parameters")
    ]
    return [f"Its size: {', '.join(sizes)}."] if sizes else []


def _gain_sentences(one: Mapping[str, Any]) -> list[str]:
    gain = one.get("gain") or {}
    said = []
    before, after = gain.get("held_out_rms_before_mm"), gain.get("held_out_rms_after_mm")
    if known(before) and known(after) and after < before:
        low, high = [*(gain.get("ci95") or []), None, None][:2]
        sure = f", 95 % interval {percent(low)} to {percent(high)}" if known(low) else ""
        less = gain.get("reduction")
        share = f" ({percent(less)} less{sure})" if known(less) else ""
        how = "put right" if one.get("evidence") else "in the model"
        of = " of the unloaded positions" if gain.get("of") == "unloaded positions" else ""
        said.append(
            f"With it {how} the error{of} at poses that were left out falls from "
            f"{plain(before)} mm to {plain(after)} mm{share}."
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
