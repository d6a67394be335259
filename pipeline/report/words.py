"""Names of causes, verdicts and models for a production engineer."""

from __future__ import annotations

from functools import cache

from pipeline.answer.contract import Answer, Data, Placed
from pipeline.answer.words import MISTAKES
from pipeline.base.language import Say
from pipeline.machine.effect import in_place
from pipeline.prediction.decision import Decision


@cache
def nouns() -> dict[str, str]:
    """Noun of each cause by its name, so that it fits into any sentence."""
    from pipeline.machine.effects import base_growth, catalogue, payload, table, unlisted
    from pipeline.machine.robot import SHIPPED, load

    kinds = {tuple(j.prismatic for j in robot.joints): robot for robot in map(load, SHIPPED)}
    known = {e.name: e.noun for robot in kinds.values() for e in catalogue(robot)}
    known |= payload.NOUNS | table.NOUNS | {unlisted.NAME: "law outside the catalogue"}
    return known | {"base_growth": base_growth.NOUN} | MISTAKES


VERDICTS = {
    "adequate": ("The model fits", "good"),
    "explained": ("A cause besides the joint springs is identified", "attention"),
    "ambiguous": ("Causes cannot be distinguished yet", "attention"),
    "unexplained": ("The model misses something unknown", "bad"),
    "bad_data": ("The data are wrong", "bad"),
}

UNUSABLE = "Do not use: the data are wrong"
CORRECTED = "The data are wrong: use corrected values only"
"""Headlines for wrong data if no values may be used, and if the corrected ones may."""

_OUT = ("Deflection out of tolerance", "bad")
_OPEN = ("Conformity with the tolerance undecided", "attention")

JUDGED = {
    (Decision.PASS, False): ("Deflection within tolerance", "good"),
    (Decision.PASS, True): (
        "Deflection within tolerance only if the model below holds",
        "attention",
    ),
    **{(Decision.UNDECIDED, doubtful): _OPEN for doubtful in (False, True)},
    **{(Decision.FAIL, doubtful): _OUT for doubtful in (False, True)},
}
"""Headline and tone by decision on the tolerance and by whether the verdict on data or model is
bad."""

MODELS = {
    "joint_springs": "joint springs",
    "extended": "with the identified causes",
    "averaged": "averaged over the possible causes",
}
"""The models whose values the answer may give, in words."""


def cause(name: str, where: int | str | None, axis: str | None = None) -> str:
    """A cause in plain words with its place."""
    return nouns().get(name, name.replace("_", " ")) + in_place(where, name, axis)


def placed(one: Placed) -> str:
    """A cause of the answer in plain words with its place."""
    return cause(one.name, one.where, one.axis)


def by_axis(answer: Answer, say: Say) -> Say:
    """Extend `say` to use the controller's names alone: `axis A2` for `joint 3 (A2)`."""
    short = {
        long: name
        for one in answer.stiffness
        if one.axis
        for long, name in (
            (f"joint {one.joint} ({one.axis})", f"axis {one.axis}"),
            (one.called, one.axis),
        )
    }

    def told(text: str) -> str:
        for long, name in short.items():
            text = text.replace(long, name)
        return say(text)

    return told


def values_of(answer: Answer) -> str:
    """Model and data from which the answer's values are taken."""
    recommended = answer.recommended
    return MODELS[recommended.model] + (
        ", data corrected" if recommended.data == Data.CORRECTED else ""
    )
