"""What each cause is called in front of a production engineer."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from pipeline.answer.contract import Answer, Data, Placed, Values, Which
from pipeline.base.language import Say
from pipeline.machine.effect import in_place
from pipeline.prediction.decision import Decision


@cache
def nouns() -> dict[str, str]:
    """Each cause as a noun, so that it fits into any sentence."""
    from pipeline.machine.effects import catalogue, payload, table, unlisted
    from pipeline.machine.robot import SHIPPED, load

    kinds = {tuple(j.prismatic for j in robot.joints): robot for robot in map(load, SHIPPED)}
    known = {e.name: e.noun for robot in kinds.values() for e in catalogue(robot)}
    known |= payload.NOUNS | table.NOUNS | {unlisted.NAME: "law outside the catalogue"}
    return known | _MISTAKES


_MISTAKES = {
    "outlier": "outlying reading",
    "unit_mixup": "mixed-up unit",
    "label_swap": "swapped names of targets",
    "exchanged": "exchanged groups or rows",
    "dead_sensor": "column that no sensor wrote",
    "tool_point": "wrong tool point",
    "sign_or_convention": "wrong sign or axis convention",
}
"""Mistakes in the data as nouns, by their names in result.json."""

VERDICTS = {
    "adequate": ("The model fits", "good"),
    "explained": ("A cause besides the joint springs is identified", "attention"),
    "ambiguous": ("Causes cannot be distinguished yet", "attention"),
    "unexplained": ("The model misses something unknown", "bad"),
    "bad_data": ("The data are wrong", "bad"),
}

UNUSABLE = "Do not use: the data are wrong"
CORRECTED = "The data are wrong: use corrected values only"
"""What is said of wrong data from which nothing, and from which the values may be used."""

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
"""What a tolerance decides, and its tone; second whether the verdict on data or model is bad."""

MODELS = {
    "joint_springs": "joint springs",
    "extended": "with the identified causes",
    "averaged": "averaged over the possible causes",
}
"""Whose values the answer gives."""


def cause(name: str, where: int | str | None, axis: str | None = None) -> str:
    """A cause in plain words with its place."""
    return nouns().get(name, name.replace("_", " ")) + in_place(where, name, axis)


def placed(one: Placed) -> str:
    """The same of a cause of the answer."""
    return cause(one.name, one.where, one.axis)


def by_axis(answer: Answer, say: Say) -> Say:
    """How a text is said with the controller's names alone: `axis A2` for `joint 3 (A2)`."""
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


def label(one: Placed) -> str:
    """The machine-readable name, `joint_tilt 2`."""
    return one.name if one.where is None else f"{one.name} {one.where}"


Axes = Mapping[int, str]
"""Axis of the controller by number of the joint; empty where the robot file maps none."""


def from_label(text: str, axes: Axes) -> str:
    """A cause in words from its label, `joint_tilt:2` or `joint_tilt`."""
    name, _, where = text.partition(":")
    return at(name, int(where) if where.isdigit() else where or None, axes)


def at(name: str, where: int | str | None, axes: Axes) -> str:
    """A cause in words with its place, which has the controller's name where there is one."""
    return cause(name, where, axes.get(where) if isinstance(where, int) else None)


def values_of(answer: Answer) -> str:
    """Which model and data the answer's values are of."""
    said = answer.recommended
    return MODELS[said.model] + (", data corrected" if said.data == Data.CORRECTED else "")


def beside(answer: Answer) -> tuple[str, Values] | None:
    """What the joint springs on the data as given are called, and their values.

    None where the answer stands for them.
    """
    said = answer.recommended
    names = ["joint springs alone"] if said.model != Which.JOINT_SPRINGS else []
    names += ["data as given"] if said.data == Data.CORRECTED else []
    return (", ".join(names), answer.joint_springs) if names else None
