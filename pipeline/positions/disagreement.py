"""Sentences on springs and tables by positions that differ from those by pulls."""

from __future__ import annotations

from pipeline.answer.words import capital, listed
from pipeline.base.quantities import p_value, plain, with_std
from pipeline.diagnosis.agreement import ChiSquare
from pipeline.diagnosis.facts import Facts
from pipeline.machine.effect import in_place


def tables_disagree(facts: Facts) -> str:
    """Unloaded reflectors of pulls off the table that the positions have identified."""
    assert facts.agreement is not None
    why = "an error in the data that is not completely corrected may do this."
    if not facts.mistakes:
        why = (
            "positions and pulls are not of one robot, or of one before and after a collision, "
            "repair or mastering."
        )
    return (
        "The unloaded reflectors of the pulls do not stand where the robot identified from the "
        f"positions has them ({plain(1e3 * facts.unloaded.miss_m, 2)} mm rms, "
        f"{p_value(facts.agreement.table_p)} beside its uncertainty): {why}"
    )


def springs_disagree(facts: Facts) -> str:
    """Springs by weight and by pulls that differ, and what would explain it."""
    assert facts.agreement is not None
    agreement = facts.agreement
    if agreement.elements.p < ChiSquare(agreement.chi2, agreement.dof).p:
        return (
            f"Under the arm's own weight yields what does not so under the pulls "
            f"({listed(list(agreement.held))}; chi-square {plain(agreement.elements.chi2, 3)} with "
            f"{agreement.elements.dof} degrees of freedom): the weight acts on something that the "
            "model lacks, a balancer or a law of the joint beside it. The stiffnesses are those of "
            "the pulls alone."
        )
    if agreement.common is not None:
        ratio, std = 1 / agreement.common.factor, agreement.common.std / agreement.common.factor**2
        why = (
            f"One factor explains it: links weigh {with_std(ratio, std)} times what the robot "
            "file states, or the scale reads so many times the force. Weigh a link or a payload, "
            "or have the scale calibrated."
        )
    else:
        joint, times = agreement.most
        where = capital(in_place(joint + 1).removeprefix(" in "))
        how = f"under the pulls it is {plain(times, 3)} times as compliant"
        if times <= 0:
            how = "the weight turns it against its own torque"
        why = f"{where} differs most: {how}. {_STATED if agreement.factor is None else _NOT_STATED}"
    return (
        "The springs by the arm's own weight are not those by the pulls (chi-square "
        f"{plain(agreement.chi2, 3)} with {agreement.dof} degrees of freedom, "
        f"{p_value(agreement.p)}). {why} The stiffnesses are those of the pulls alone."
    )


_STATED = "A balancer, masses of single links or a payload are not as the robot file states them."


_NOT_STATED = (
    "No masses that the links might have bring them together: a balancer or a law of the joint "
    "beside its spring acts under the weight alone."
)
"""Why springs by weight and by pulls may differ, with and without masses in the robot file."""
