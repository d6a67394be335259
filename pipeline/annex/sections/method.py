"""Section on method, assumptions, inputs and versions."""

from __future__ import annotations

from pipeline.answer.contract import Answer, Equilibrium, Input, Which
from pipeline.base.quantities import plain, typeset
from pipeline.report.record import (
    Cells,
    Paragraph,
    ReportTable,
    Section,
    number_column,
    section_of,
    table_of,
    word_column,
)
from pipeline.report.summaries import Tables

_LEFT_OUT = (
    " and is left out of c = B x; where the noise is stated or estimated from repeats, the "
    "uncertainties include it."
)

_METHOD = (
    "Loaded minus unloaded reflector positions c are explained by one linear spring per joint, c = "
    "B x with the compliances x: the elastostatic model of Guérin, Caro, Garnier and Girin, "
    '"Optimal Measurement Pose Selection for Joint Stiffness Identification of an Industrial Robot '
    'Mounted on a Rail". The compliances come from '
    "generalised least squares with the full covariance of c: tracker noise per reading, the zero "
    "shared by all pulls of a pose, {load} and the registration. {force} Validation leaves out one "
    "pose with all its pulls at a time."
)

_OF_POSITIONS = (
    "Readings of the targets are explained by the robot's DH parameters, its tool, one frame of "
    "the "
    "instrument per series, springs of the joints under the weight of the arm, and laws of the "
    "transmission errors of the joints; all are estimated at once by generalised least "
    "squares about the robot where it stands. In addition to the noise of the instrument each "
    "joint "
    "has an error at each pose that no model describes; both are found by restricted maximum "
    "likelihood. "
    "The prior standard deviations of its lengths and of its angles are estimated from all of "
    "them together."
)
"""Model and estimator of absolute positions, as a paragraph."""

_PULLED = {
    "load": "the force reading that moves all coordinates of a pull together, the direction of "
    "the chain",
    "force": "The force acts along the chain: the line through its two reflectors, or from the "
    "load point to the stated anchor.",
}
_WEIGHED = {
    "load": "the mass that moves all coordinates of a pull together, its centre",
    "force": "The force is the weight of what hangs or is mounted, in its centre of mass.",
}
_BOTH = {key: f"{one} {_WEIGHED[key]}" for key, one in _PULLED.items()} | {
    "load": f"{_PULLED['load']}, or of a weight {_WEIGHED['load']}",
}


def method(answer: Answer, tables: Tables) -> Section | None:
    """How the results were computed, and from which data."""
    blocks = [Paragraph(_told(answer)), _assumptions(answer), _inputs(answer), _versions(answer)]
    return section_of("method", "Method, assumptions, versions, inputs", blocks)


def _told(answer: Answer) -> str:
    if answer.of_positions:
        return _OF_POSITIONS
    deformed = answer.model.equilibrium is Equilibrium.DEFORMED
    lines = [
        _METHOD.format(**_loads(answer)),
        "The force acts on the deflected robot (second order in the load)."
        if deformed
        else "The geometry is that of the unloaded robot.",
    ]
    recommended = answer.recommended
    if recommended.model != Which.JOINT_SPRINGS and not recommended.reason.unseen:
        lines.append(
            "In addition to the joint springs the model includes what was identified, "
            "c = B x + Z z."
        )
    if answer.position_steps:
        lines.append(_OF_POSITIONS)
    size = plain(answer.fit.second_order_rms_mm, 2)
    lines.append(f"The second order in the load amounts to {size} mm rms")
    return " ".join(lines) + ("." if deformed else _LEFT_OUT)


def _loads(answer: Answer) -> dict[str, str]:
    """Phrases on the load, chosen by the sources of error in the budget: pulls, weights or both."""
    sources = {row["source"] for row in answer.budget}
    pulled = any(one.startswith(("direction", "force")) for one in map(str, sources))
    weighed = bool(answer.payloads or "payload mass" in sources)
    if pulled:
        return _BOTH if weighed else _PULLED
    return _WEIGHED


def _assumptions(answer: Answer) -> ReportTable | None:
    return table_of(
        "assumptions", "Assumptions", [word_column("Assumed", typeset)], answer.assumptions
    )


def _inputs(answer: Answer) -> ReportTable | None:
    columns: list[Cells[Input]] = [
        word_column("File", lambda one: one.file, code=True),
        number_column("Bytes", lambda one: one.bytes, str),
        word_column("SHA-256", lambda one: one.sha256, code=True),
    ]
    return table_of("inputs", "Input files", columns, answer.inputs)


def _versions(answer: Answer) -> Paragraph:
    with_ = ", ".join(f"{name} {version}" for name, version in answer.versions.items())
    return Paragraph(f"Computed with {with_}.")
