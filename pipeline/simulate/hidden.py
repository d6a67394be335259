"""Hidden effects and blunders of a virtual campaign, from the words of the command line."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

from pipeline.base.arrays import Array, Locked
from pipeline.base.errors import UsageError
from pipeline.machine.effect import Effect
from pipeline.machine.effects import catalogue, table
from pipeline.machine.robot import Robot
from pipeline.simulate._words import amounts, parts
from pipeline.simulate.blunders import BLUNDERS, PlantedBlunder, commit


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
