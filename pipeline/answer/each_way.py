"""A joint with a stiffness for each sign of its torque, by the controller's name of the axis."""

from __future__ import annotations

from pipeline.answer.contract import OneWay, Stiffness
from pipeline.base.quantities import common_prefix, prefixed, scaled, with_std


def both_stiffnesses(joint: Stiffness) -> str:
    """`A3 (k_theta4) is 2.40 ± 0.02 MN·m/rad where the pull turns A3 towards plus, 1.50 ...`.

    Empty for a joint with one stiffness.
    """
    both = joint.by_sign
    if both is None:
        return ""
    load = "load with the arm's own weight" if both.of == "total" else "pull"
    first, other = sorted((both.positive, both.negative), key=lambda one: one.axis_turns != "plus")
    held = both.positive if both.value_of == "positive" else both.negative
    return (
        f"{joint.called} is {_size(first, joint)} where the {load} turns {_way(first, joint)}, and "
        f"{_size(other, joint)} where it turns {_way(other, joint)}; at the test pose it turns "
        f"{_way(held, joint)}."
    )


def beside(joint: Stiffness) -> str:
    """`; 1.500 ± 0.010 MN·m/rad the other way`, to follow the stiffness at the test pose."""
    both = joint.by_sign
    if both is None:
        return ""
    other = both.negative if both.value_of == "positive" else both.positive
    return f"; {_size(other, joint)} the other way"


def _size(one: OneWay, joint: Stiffness) -> str:
    """`2.400 ± 0.020 MN·m/rad`, or `not determined`."""
    if one.value is None:
        return "not determined"
    factor, letter = common_prefix([one.value])
    shown = with_std(scaled(one.value, factor), scaled(one.std, factor))
    return f"{shown} {prefixed(joint.unit, letter)}"


def _way(one: OneWay, joint: Stiffness) -> str:
    """`A3 towards plus`, or `joint 4 in its positive sense` without an axis of the controller."""
    if one.axis_turns is not None:
        return f"{joint.axis} towards {one.axis_turns}"
    assert joint.by_sign is not None
    sense = "positive" if one is joint.by_sign.positive else "negative"
    return f"joint {joint.joint} in its {sense} sense"
