"""Deflection at the test pose and over the workspace, and how far to trust it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.base.quantities import known, percent, plain, with_std
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import Column, Section, Table, Text, entry, text_entry
from pipeline.report.sections._tree import at, items, section_of
from pipeline.report.summaries import Result, Tables


def test_pose(result: Result, tables: Tables) -> Section | None:
    """Deflection at the test pose and over the workspace, and what joint springs alone say."""
    other = words.beside(result)
    springs = items(other[1], "test_pose_deflection") if other else []
    return section_of(
        "test-pose",
        "Deflection under load",
        [
            _deflections(
                "deflection",
                f"Predicted deflection at the test pose, {words.values_of(result)}",
                items(result, "test_pose_deflection"),
            ),
            _deflections(
                "deflection-joint-springs",
                f"The same, {other[0]}" if other else "",
                springs,
            ),
            *figures(("workspace", "workspace-joint-springs"), result, tables),
        ],
    )


def _deflections(name: str, title: str, points: list[Any]) -> Table | None:
    if not points:
        return None
    rows = []
    for point in points:
        values = [point.get(f"d{axis}_mm") for axis in "xyz"]
        stds = [*(point.get("std_mm") or []), None, None, None][:3]
        size = sum(v * v for v in values) ** 0.5 if all(known(v) for v in values) else None
        cells = [entry(with_std(v, s), v) for v, s in zip(values, stds, strict=True)]
        rows.append((text_entry(point.get("target")), *cells, entry(plain(size), size)))
    columns = (
        Column("Target"),
        *[Column(f"d{axis} [mm]", numeric=True) for axis in "xyz"],
        Column("Distance [mm]", numeric=True),
    )
    note = "Base frame; ± is one standard uncertainty from the full covariance of the estimate."
    if any(s is None for point in points for s in point.get("std_mm") or []):
        note += " A value without ± depends on a stiffness that these pulls do not determine."
    return Table(name, title, columns, tuple(rows), note)


def validation(result: Result, tables: Tables) -> Section | None:
    """Poses left out, and the error of Eq. (22); None when nothing was validated."""
    given = result.get("validation")
    if not given:
        return None
    return section_of(
        "validation",
        "How far predictions can be trusted",
        [
            _held_out(given),
            _mu_table(given),
            *figures(("prediction",), result, tables),
        ],
    )


def _held_out(given: Mapping[str, Any]) -> Text | None:
    value = given.get("held_out_rms_mm")
    if not known(value):
        return None
    return Text(
        f"At poses that were left out of the estimate, the model misses the readings by "
        f"{plain(value)} mm rms per coordinate."
    )


def _mu_table(given: Mapping[str, Any]) -> Table | None:
    kinds = [
        ("around the test pose", "full covariance", given.get("test_pose")),
        ("over the workspace", "full covariance", given.get("global")),
        ("around the test pose", "independent, Eq. (23)", at(given, "independent", "test_pose")),
        ("over the workspace", "independent, Eq. (23)", at(given, "independent", "global")),
    ]
    targets = list(dict.fromkeys(t for _, _, mu in kinds for t in mu or {}))
    if not targets:
        return None
    rows = [
        (
            text_entry(where),
            text_entry(draw),
            *[entry(percent(mu.get(t), 3), mu.get(t)) for t in targets],
        )
        for where, draw, mu in kinds
        if mu
    ]
    columns = (
        Column("Poses"),
        Column("Stiffnesses drawn"),
        *[Column(t, numeric=True) for t in targets],
    )
    number = given.get("poses")
    note = f"Mean over {number} poses each. " if known(number) else ""
    note += (
        "The paper draws the stiffnesses independently; the estimate has correlations, so the rows "
        "with the full covariance are the ones to rely on."
    )
    title = "Error of the predicted deflection from the uncertain stiffnesses, Eq. (22)"
    return Table("prediction-error", title, columns, tuple(rows), note)
