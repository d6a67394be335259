"""What somebody may have meant: ways out of errors in campaign.toml and in other files of ours.

Asked for by the readers of these files, once something is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import Literal, get_args, get_origin

import numpy as np
from pydantic import AliasChoices, BaseModel

from pipeline.base.strict import apart, records
from pipeline.base.toml import quoted
from pipeline.machine.robot import Robot, axes
from pipeline.reduction.settings import AskedPose, beyond_limits


def key(kind: type[BaseModel], path: Sequence[str | int]) -> str | None:
    """Suggestion for an unknown key: a similar one of its table, or the table it belongs to."""
    *table, last = (one for one in path if isinstance(one, str))
    every = list(_known(kind))
    here = {name.lower(): name for where, name in every if _same(where, table)}
    if near := get_close_matches(last.lower(), here, 1):
        return f"did you mean {here[near[0]]}?"
    return _belongs(last, table, sorted({where for where, name in every if name == last}))


def _belongs(key: str, table: Sequence[str], homes: Sequence[tuple[str, ...]]) -> str | None:
    """Suggestion for a key of some other tables, the homes; None if there is none."""
    if inside := [one[-1] for one in homes if [*one[:-1]] == table and table]:
        return f"it belongs into {inside[0]} = {{ {key} = ... }}"
    named = [f"[{'.'.join(one)}]" if one else "the top of the file" for one in homes]
    return f"it belongs to {' or '.join(named)}" if named else None


def _same(where: Sequence[str], table: Sequence[str]) -> bool:
    """Whether a table matches a place, in which `_ANY` stands for any name."""
    pairs = zip(where, table, strict=False)
    return len(where) == len(table) and all(a in (b, _ANY) for a, b in pairs)


_ANY = "NAME"
"""Placeholder for the name of a table chosen by the author of a file."""


def _known(
    kind: type[BaseModel], path: Sequence[str] = ()
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Every key of a file with the path of its table."""
    for field, info in kind.model_fields.items():
        spelt = info.validation_alias
        first = spelt.choices[0] if isinstance(spelt, AliasChoices) else spelt
        *above, name = map(str, apart(first if isinstance(first, str) else field))
        yield (*path, *above), name
        words = get_args(info.annotation)[:1] if get_origin(info.annotation) is dict else ()
        yield from (((*path, *above, name), one) for word in words for one in _literals(word))
        for inner, called in records(info.annotation):
            yield from _known(inner, (*path, *above, name, *[_ANY] * called))


def _literals(kind: object) -> tuple[str, ...]:
    """The words of a literal type; none for another."""
    return get_args(kind) if get_origin(kind) is Literal else ()


def pose(asked: AskedPose, robot: Robot) -> str:
    """A pose beyond limits: values in other units, or of the other sign; empty for neither."""
    return "; or ".join([*_as_axes(asked, robot), *_with_other_sign(asked, robot)])


def _with_other_sign(asked: AskedPose, robot: Robot) -> Iterator[str]:
    for k, name in enumerate(asked.names(robot)):
        turned = [-one if i == k else one for i, one in enumerate(asked.said)]
        other = asked.model_copy(update={asked.key: turned})
        if not beyond_limits(robot, other.joint_values(robot)).any():
            yield f"is {name} = {turned[k]:g} meant, with the other sign?"


def _as_axes(asked: AskedPose, robot: Robot) -> Iterator[str]:
    stated, names = np.array(asked.said), axes.of(robot).names
    if asked.axes is not None or len(names) != len(stated):
        return
    shown = np.where(axes.of(robot).slides, 1e3 * stated, stated)
    if not beyond_limits(robot, robot.from_controller(shown)).any():
        yield (
            f"are these what the controller shows for {', '.join(names)}? Then write "
            f"axes = [{', '.join(f'{x:g}' for x in shown)}] (mm and degrees)"
        )


def state(word: str) -> str:
    """How to add a word for a state to [naming], after the way out of its own."""
    known = next((f'"{one}"' for one, own in _STATE_WORDS.items() if word.lower() in own), "...")
    ask = ' with "unloaded" or "loaded"' if known == "..." else ""
    line = f"states = {{ {quoted(word)} = {known} }}{ask}"
    return f", or write {line} into [naming], beside what is there"


_STATE_WORDS = {
    "unloaded": {"unbelastet", "leer", "ohne last", "frei", "no load", "free", "zero", "null",
                 "vide", "à vide", "a vide", "sans charge", "u", "scarico"},
    "loaded": {"belastet", "last", "laststufe", "zug", "voll", "load", "pull", "pulled", "charge",
               "chargé", "traction", "l", "carico"},
}  # fmt: skip
"""What others call the states."""
