"""Remarks on stiffnesses and payloads, and stiffnesses by sign of the torque, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.answer.contract import Body, JointType, Odd, OneWay, Payload, Remark, Stiffness
from pipeline.answer.words import listed
from pipeline.base.quantities import common_prefix, plain, prefixed, scaled, with_std

_CONTRADICTS = 0.001
"""p-value below which mass and centre contradict the stated ones [1]."""


def finding(joint: Stiffness) -> str | None:
    """All remarks on one stiffness; None without any."""
    return " ".join(sentence(remark, [joint]) for remark in joint.remarks) or None


def contradicted(payloads: Sequence[Payload], by: str = "joint torques") -> list[str]:
    """A sentence on each payload for which the readings contradict campaign.toml."""
    return [
        f"The {by} contradict the payload {one.name}: by {one.poses} poses it has "
        f"{_of(one.found)}, and campaign.toml says {_of(one.stated)} (p = {one.p_value:.1g}); "
        "weigh it, or check how it is mounted."
        for one in payloads
        if one.found is not None and one.p_value is not None and one.p_value < _CONTRADICTS
    ]


def _of(body: Body) -> str:
    """Mass and centre in words."""
    places = zip(body.center_m, body.center_std_m, strict=True)
    center = ", ".join(with_std(1e3 * at, 1e3 * std) for at, std in places)
    return f"{with_std(body.mass_kg, body.mass_std_kg)} kg at ({center}) mm"


_SENTENCES = {
    Odd.NO_LEVER: "{those} is not identifiable: {idle}.",
    Odd.MIXED: "{those} is not identifiable: these poses mix it with another joint; add {work}.",
    Odd.TOGETHER: "{those} is not identifiable by itself: these poses mix it with {others}.",
    Odd.NEGATIVE: "The compliance of {joint} is negative ({compliance}), which no spring can be: "
    "the model misses something that acts there, so no stiffness is stated.",
    Odd.UNCERTAIN: "{those} is not identifiable: its compliance is {compliance}; add {work}, or "
    "pull harder.",
    Odd.ZERO_BESIDE_A_CAUSE: "{those} has no upper limit: its compliance is {compliance}, but "
    "beside one of the possible causes it may be zero.",
    Odd.MAY_BE_ZERO: "{those} has no upper limit: its compliance of {compliance} may be zero; add "
    "{work}, or pull harder.",
    Odd.LOST: "{those} is not identifiable: the data do not exclude {others} instead of {cause}, "
    "and beside that these poses cannot distinguish it from the compliance of the joint.",
    Odd.SCATTERED: "{those} is not identifiable: how large it is depends on whether the cause is "
    "{cause} or {others}, which the data do not exclude.",
    Odd.DEPENDS: "{those} depends on whether the cause is {cause} or {others}, which the data do "
    "not exclude; its interval covers each of them.",
}

WORK = {
    JointType.PRISMATIC: "pulls along the rail",
    JointType.REVOLUTE: "pulls with a lever about its axis",
}
"""Pulls that would determine a joint better, by its type."""

_IDLE = {
    JointType.PRISMATIC: "no pull of the campaign has a part along the joint; add pulls along the "
    "rail",
    JointType.REVOLUTE: "no pull of the campaign puts a torque on the joint; load the effector "
    "sideways, off that joint's axis",
}
"""Explanation that a joint is never loaded, and what to do, by its type."""


def sentence(remark: Remark, joints: Sequence[Stiffness]) -> str:
    """A remark on one joint, or on several to which it applies alike."""
    first, each = joints[0], "Each of " if len(joints) > 1 else ""
    return _SENTENCES[remark.odd].format(
        those=each + listed([joint.called for joint in joints]),
        joint=first.joint_name,
        work=WORK[first.joint_type],
        idle=_IDLE[first.joint_type],
        compliance=f"{with_std(first.compliance, first.compliance_std)} {first.compliance_unit}",
        cause=remark.cause,
        others=_others(remark),
    )


def _others(remark: Remark) -> str:
    """List of the joints that are determined together, or of the alternative causes."""
    if remark.odd is Odd.TOGETHER:
        return listed(remark.others)
    return " or ".join(remark.others)


def both_stiffnesses(joint: Stiffness) -> str:
    """`A3 (k_theta4) is 2.40 ± 0.02 MN·m/rad where the pull turns A3 towards plus, 1.50 ...`.

    Empty for a joint with one stiffness.
    """
    both = joint.by_sign
    if both is None:
        return ""
    load = "load with the arm's own weight" if both.of == "total" else "pull"
    first, other = sorted((both.positive, both.negative), key=lambda one: one.axis_turns != "plus")
    at_pose = both.positive if both.value_of == "positive" else both.negative
    one, two = (stiffness_text(way, joint.unit) for way in (first, other))
    return (
        f"{joint.called} is {one} where the {load} turns {_way(first, joint)}, and "
        f"{two} where it turns {_way(other, joint)}; at the test pose it turns "
        f"{_way(at_pose, joint)}."
    )


def other_way(joint: Stiffness, k: float = 1.0) -> str:
    """`; 1.500 ± 0.010 MN·m/rad the other way`, to follow the stiffness at the test pose.

    ± is k standard uncertainties.
    """
    both = joint.by_sign
    if both is None:
        return ""
    other = both.negative if both.value_of == "positive" else both.positive
    return f"; {stiffness_text(other, joint.unit, k)} the other way"


def stiffness_text(one: Stiffness | OneWay, unit: str, k: float = 1.0) -> str:
    """`2.400 ± 0.020 MN·m/rad`, ± k standard uncertainties; a lower limit if it may be rigid."""
    if one.value is None:
        return "not determined"
    (least, most), (factor, letter) = one.ci95, common_prefix([one.value])
    if most is None and least:
        return f"above {plain(least / factor, 2)} {prefixed(unit, letter)} (95 %)"
    shown = with_std(scaled(one.value, factor), scaled(one.std, factor / k))
    return f"{shown} {prefixed(unit, letter)}"


def _way(one: OneWay, joint: Stiffness) -> str:
    """`A3 towards plus`, or `joint 4 in its positive sense` without an axis of the controller."""
    if one.axis_turns is not None:
        return f"{joint.axis} towards {one.axis_turns}"
    assert joint.by_sign is not None
    sense = "positive" if one is joint.by_sign.positive else "negative"
    return f"joint {joint.joint} in its {sense} sense"
