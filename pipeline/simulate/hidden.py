"""Hidden effects and blunders of a virtual campaign: by their words, and all of them listed."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Locked, Parameter
from pipeline.base.errors import UsageError
from pipeline.machine.effect import Effect
from pipeline.machine.effects import catalogue, table
from pipeline.machine.robot import Robot
from pipeline.simulate.blunders import BLUNDERS, PlantedBlunder, amounts, commit, parts


@dataclass(frozen=True, eq=False)
class Planted(Locked):
    """An effect that acts in a virtual cell.

    Attributes:
        effect: The effect.
        values: Its parameters, SI, shape (k,).
    """

    effect: Effect
    values: Array


def plant(text: str, robot: Robot) -> Planted | PlantedBlunder:
    """The effect or blunder that `text` names, at its size.

    Args:
        text: `rail_roll` (typical size), `joint_tilt:2=2x` (twice the typical size),
            `scale_zero=20` (SI), `joint_tilt:2=1e-7,2e-7` (one number per parameter),
            `tracker_drift(warm-up)` (a form of it; the first one where none is named),
            `outlier:pose03_rep1_loaded/P2=5e-4`, `unit_mixup:kgf`.
        robot: The robot that it acts on.

    Raises:
        UsageError: This robot has no such effect (similar ones or all are listed), or the size is
            not a number.
    """
    words, size = parts(text)
    if words.partition(":")[0] in BLUNDERS:
        return commit(text)
    known: dict[str, Effect] = {}
    for effect in (*catalogue(robot), *table.effects(robot)):
        known.setdefault(effect.label, effect)
        if effect.form:
            known[f"{effect.label}({effect.form})"] = effect
    if words not in known:
        raise UsageError(
            f'there is no effect "{words}" on {robot.name}; {_near(words, [*known, *BLUNDERS])}'
        )
    return Planted(known[words], amounts(size, known[words].parameters, text))


def _near(words: str, names: list[str]) -> str:
    """Names that may have been meant, or all names without their places and forms."""
    near = [name for name in names if "(" not in name and name.startswith(f"{words}:")]
    near = near or get_close_matches(words, names, 3)
    if near:
        return f"did you mean {' or '.join(near)}? `pipeline effects` lists all"
    plain = dict.fromkeys(name.partition("(")[0].partition(":")[0] for name in names)
    return f"choose from {', '.join(plain)}; `pipeline effects` lists their places"


def effects(texts: Iterable[str], robot: Robot) -> tuple[Planted, ...]:
    """The named effects that act in the cell."""
    return tuple(one for text in texts if isinstance(one := plant(text, robot), Planted))


def blunders(texts: Iterable[str], robot: Robot) -> tuple[PlantedBlunder, ...]:
    """The named blunders, which change the files."""
    return tuple(one for text in texts if isinstance(one := plant(text, robot), PlantedBlunder))


def _entries(robot: Robot) -> list[dict[str, Any]]:
    """One entry per cause and place, with all its forms."""
    out: dict[str, dict[str, Any]] = {}
    for effect in (*catalogue(robot), *table.effects(robot)):
        entry = out.setdefault(effect.label, _entry(effect))
        if effect.form:
            entry["forms"].append(effect.form)
    return list(out.values())


def _entry(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "where": effect.where,
        "acts_on": sorted({type(facet).__name__.lower() for facet in effect.facets}),
        "forms": [],
        "parameters": [_parameter(one) for one in effect.parameters],
        "signature": effect.signature,
        "needs": effect.needs,
        "source": effect.source,
    }


def _parameter(one: Parameter) -> dict[str, Any]:
    """A parameter; a bound that does not exist is null."""
    return {
        key: None if value in (np.inf, -np.inf) else value for key, value in asdict(one).items()
    }


def as_json(robot: Robot) -> str:
    """The catalogue as a JSON array."""
    return json.dumps(_entries(robot), allow_nan=False)


def as_text(robot: Robot) -> str:
    """One line per cause: argument of --effect, typical magnitude, signature."""
    rows = []
    for entry in _entries(robot):
        where = "" if entry["where"] is None else f":{entry['where']}"
        first = entry["parameters"][0]
        size = f"{first['name']} = {first['typical']:.2g} {first['unit']}"
        rows.append((f"{entry['name']}{where}", size, entry["signature"]))
    first_width, second_width = (2 + max(len(row[column]) for row in rows) for column in (0, 1))
    return "\n".join(
        f"{name:{first_width}}{size:{second_width}}{signature}" for name, size, signature in rows
    )
