"""Sections on the deflection at the test pose and over the workspace, and on its validation."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.annex.words import springs_alone
from pipeline.answer.conformity import DECIDED, expanded
from pipeline.answer.contract import (
    Answer,
    PerTarget,
    Stretch,
    TargetDeflection,
    TestPose,
    Tolerance,
    Validation,
)
from pipeline.base.quantities import percent, plain
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import (
    Cells,
    Paragraph,
    ReportTable,
    Section,
    measured_column,
    number_column,
    roughly,
    section_of,
    table_of,
    word_column,
)
from pipeline.report.summaries import Tables


def test_pose(answer: Answer, tables: Tables) -> Section | None:
    """Deflection at the test pose and over the workspace, also by joint springs alone."""
    title = f"Predicted deflection at the test pose, {words.values_of(answer)}"
    return section_of(
        "test-pose",
        "Deflection under load",
        [
            _asked(answer.test_pose),
            _tolerance(answer.tolerance),
            *figures(("path",), answer, tables),
            _deflections("deflection", title, answer.test_pose_deflection),
            _beside(answer),
            *figures(("workspace", "workspace-joint-springs"), answer, tables),
        ],
    )


def _asked(pose: TestPose | None) -> Paragraph | None:
    """Deflection of the load point with U, and what U includes."""
    if pose is None:
        return None
    return Paragraph(
        f"At the load point, where the force acts: {expanded(pose)}. U includes the uncertainty of "
        "the model and is never less than twice the cross-validation error, which includes the "
        "noise of the readings."
    )


def _tolerance(asked: Tolerance | None) -> ReportTable | None:
    """Conformity of the path with the tolerance, stretch by stretch."""
    if asked is None or asked.path is None:
        return None
    columns: list[Cells[Stretch]] = [
        number_column("First pose", lambda one: one.first, str),
        number_column("Last pose", lambda one: one.last, str),
        number_column("Points", lambda one: one.points, str),
        word_column("Decision", lambda one: DECIDED[one.decision]),
        number_column("Largest deflection [mm]", lambda one: one.deflection_mm, plain),
        number_column("U (k = 2) [mm]", lambda one: one.expanded_mm, roughly),
        number_column("At pose", lambda one: one.at, str),
    ]
    note = (
        f"T = {asked.deflection_mm:g} mm. ISO 14253-1: pass where d + 1.65 u is at most T, fail "
        "where d - 1.65 u is above T, undecided between; d is the deflection, u = U/2."
    )
    title = f"Stretches of {asked.path.file}"
    return table_of("stretches", title, columns, asked.path.stretches, note)


def _beside(answer: Answer) -> ReportTable | None:
    """Prediction by joint springs on the data as given; None if the answer gives the same."""
    other = springs_alone(answer)
    if other is None:
        return None
    name, springs = other
    title = f"The same, {name}"
    return _deflections("deflection-joint-springs", title, springs.test_pose_deflection)


def _deflections(name: str, title: str, points: Sequence[TargetDeflection]) -> ReportTable | None:
    columns: list[Cells[TargetDeflection]] = [
        word_column("Target", lambda point: point.target),
        measured_column("dx [mm]", lambda point: (point.dx_mm, point.std_mm[0])),
        measured_column("dy [mm]", lambda point: (point.dy_mm, point.std_mm[1])),
        measured_column("dz [mm]", lambda point: (point.dz_mm, point.std_mm[2])),
        number_column("Distance [mm]", lambda point: point.size_mm),
    ]
    note = "Base frame; ± is one standard uncertainty from the full covariance of the estimate."
    if any(None in point.std_mm for point in points):
        note += " A value without ± depends on a stiffness that these pulls do not determine."
    return table_of(name, title, columns, points, note)


def validation(answer: Answer, tables: Tables) -> Section | None:
    """Cross-validation error and the relative error of Eq. (22); None without validation."""
    given = answer.validation
    if given is None:
        return None
    return section_of(
        "validation",
        "How do you tell that it is good?",
        [
            _held_out(given),
            *figures(("held-out", "models"), answer, tables),
            _mu_table(given),
            *figures(("measured", "prediction"), answer, tables),
        ],
    )


def _held_out(given: Validation) -> Paragraph | None:
    if given.held_out_rms_mm is None:
        return None
    return Paragraph(
        f"Cross-validation error: {plain(given.held_out_rms_mm)} mm rms per coordinate, each pose "
        "predicted from all the others; the noise of its readings is in it."
    )


def _mu_table(given: Validation) -> ReportTable | None:
    near, far = "around the test pose", "over the workspace"
    full, alone = "full covariance", "each stiffness by itself"
    kinds = [
        (near, full, given.test_pose),
        (far, full, given.global_),
        (near, alone, given.independent.test_pose),
        (far, alone, given.independent.global_),
    ]
    columns: list[Cells[tuple[str, str, PerTarget]]] = [
        word_column("Poses", lambda kind: kind[0]),
        word_column("Stiffnesses drawn", lambda kind: kind[1]),
        *(_of_target(target) for target in given.test_pose),
    ]
    note = (
        f"Mean over {given.poses} poses each of |predicted - true| / |true|, the stiffnesses drawn "
        "from their uncertainty. The estimate has correlations, so the rows with the full "
        "covariance are the ones to rely on; Guérin et al. draw each stiffness by itself."
    )
    title = "Relative error of the predicted deflection from the uncertain stiffnesses"
    return table_of("prediction-error", title, columns, kinds, note)


def _of_target(target: str) -> Cells[tuple[str, str, PerTarget]]:
    return number_column(target, lambda kind: kind[2][target], lambda mu: percent(mu, 3))
