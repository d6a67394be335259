"""What is to be known of a stiffness, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pipeline.answer.contract import JointType, Odd, Remark, Stiffness
from pipeline.answer.words import listed
from pipeline.base.quantities import with_std


def finding(joint: Stiffness) -> str | None:
    """All that is to be known of one stiffness; None where nothing is."""
    return " ".join(_sentence(remark, [joint]) for remark in joint.remarks) or None


def told(joints: Iterable[Stiffness]) -> list[str]:
    """The same of several; what holds of some of them alike is said once."""
    alike: dict[Any, tuple[Remark, list[Stiffness]]] = {}
    for joint in joints:
        for remark in joint.remarks:
            alike.setdefault((remark, _own(remark, joint)), (remark, []))[1].append(joint)
    return [_sentence(remark, those) for remark, those in alike.values()]


def _own(remark: Remark, joint: Stiffness) -> object:
    """What of a joint its sentence depends on beside the name: its numbers, its kind, nothing."""
    if remark.cause is not None:
        return None
    return joint.joint_type if remark.odd is Odd.MIXED else joint.joint


def _sentence(remark: Remark, joints: Sequence[Stiffness]) -> str:
    """One remark on one joint, or on several of which it holds alike."""
    first = joints[0]
    if remark.odd is Odd.NEGATIVE:
        return f"The compliance of {first.joint_name} is negative {_negative(first)}"
    each = "Each of " if len(joints) > 1 else ""
    return f"{each}{listed([joint.name for joint in joints])} {_predicate(remark, first)}"


def _negative(joint: Stiffness) -> str:
    return (
        f"({_compliance(joint)}), which no spring can be: the model misses something that acts "
        "there, so no stiffness is stated."
    )


def _predicate(remark: Remark, joint: Stiffness) -> str:
    if remark.cause is not None:
        return _beside_causes(remark.odd, remark.cause, " or ".join(remark.others))
    work, compliance = _work(joint), _compliance(joint)
    return {
        Odd.NO_LEVER: "is not identifiable: in every pose the line of pull has no lever about "
        f"joint {joint.joint_name}; attach the chain off that joint's axis.",
        Odd.MIXED: f"is not identifiable: these poses mix it with another joint; add {work}.",
        Odd.UNCERTAIN: f"is not identifiable: its compliance is {compliance}; add {work}, or pull "
        "harder.",
        Odd.ZERO_BESIDE_A_CAUSE: f"has no upper limit: its compliance is {compliance}, but beside "
        "one of the possible causes it may be zero.",
        Odd.MAY_BE_ZERO: f"has no upper limit: its compliance of {compliance} may be zero; add "
        f"{work}, or pull harder.",
    }[remark.odd]


def _beside_causes(odd: Odd, cause: str, others: str) -> str:
    """What to say of a spring that depends on which of two causes is true."""
    return {
        Odd.LOST: f"is not identifiable: the data do not exclude {others} in the place of {cause}, "
        "and beside it these poses do not tell it from the joint.",
        Odd.SCATTERED: "is not identifiable: how large it is depends on whether the cause is "
        f"{cause} or {others}, which the data do not exclude.",
        Odd.DEPENDS: f"depends on whether the cause is {cause} or {others}, which the data do not "
        "exclude; its interval holds for each.",
    }[odd]


def _work(joint: Stiffness) -> str:
    """The pulls that would determine a joint better."""
    if joint.joint_type is JointType.PRISMATIC:
        return "pulls along the rail"
    return "pulls with a lever about its axis"


def _compliance(joint: Stiffness) -> str:
    return f"{with_std(joint.compliance, joint.compliance_std)} {joint.compliance_unit}"
