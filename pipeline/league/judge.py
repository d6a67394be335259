"""The judge: raw files through the pipeline's own stages, and the verdict beside the truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.cell import Cell, Tool, paper_cell
from pipeline.diagnosis.isolability import Twins, twins
from pipeline.diagnosis.verdict import Diagnosis, location
from pipeline.robot import Robot
from pipeline.settings import Settings, parse
from pipeline.stages.assemble import Measured, measured
from pipeline.stages.diagnose import diagnose
from pipeline.stages.displacements import displacements
from pipeline.stages.estimate import identify
from pipeline.stages.forces import forces
from pipeline.stages.ingest import ingest
from pipeline.stages.register import place, register
from pipeline.stages.validate import place_of_interest


def reduced(robot: Robot, files: dict[str, bytes]) -> tuple[Settings, Cell, Measured]:
    """The stages before the estimate, on the files of a raw folder."""
    settings = parse(files["campaign.toml"].decode())
    got = ingest(settings, robot, files)
    readings = _frame(got.readings)
    registration = register(settings, readings)
    placed = _frame(place(registration, readings))
    names = settings.measured
    tool = Tool(
        np.array(settings.tool["load_point"]),
        np.array(names, dtype=object),
        np.array([settings.tool[name] for name in names]),
    )
    data = measured(
        robot,
        tool.targets,
        _frame(got.joints),
        _frame(forces(settings, placed, _frame(got.loads))),
        _frame(displacements(settings, placed)),
        registration.cov[:3, :3],
        settings.scale.gain_sigma if settings.scale else 0.0,
    )
    return settings, paper_cell(robot, tool), data


def _frame(table: Any) -> Any:
    return table.to_pandas() if hasattr(table, "to_pandas") else table


def diagnosed(robot: Robot, files: dict[str, bytes]) -> Diagnosis:
    """Diagnose the files of a raw folder."""
    settings, cell, data = reduced(robot, files)
    _, estimate = identify(cell, data, robot.nominal_compliance)
    where = place_of_interest(settings.test_pose, robot, data.pulls)
    return diagnose(cell, data, estimate, where, np.random.default_rng(20261103))


@dataclass(frozen=True)
class Score:
    """What came of one game.

    Attributes:
        truth: Labels of the secrets.
        places: Their places.
        known: Whether the catalogue has all of them.
        verdict: The verdict.
        named: Labels of the causes, without those of scatter.
        listed: Labels of causes and rivals.
        named_places: Places of the causes.
        single: Causes named without an open rival (certain).
        scatter: Causes of scatter.
        right: All secrets named (twins as one), nothing else.
        in_list: All secrets among causes and rivals.
        gain: Reduction and its interval.
        amplitude: Value, low and high of the first cause's first parameter.
        fit_over_floor: Root of chi2 per degree of freedom of the extended model.
        next_pose: Sigmas before and after the first proposal.
    """

    truth: tuple[str, ...]
    places: tuple[str, ...]
    known: bool
    verdict: str
    named: tuple[str, ...]
    listed: tuple[str, ...]
    named_places: tuple[str, ...]
    single: bool
    scatter: tuple[str, ...]
    right: bool
    in_list: bool
    gain: tuple[float, float, float] | None
    amplitude: tuple[float, float, float] | None
    fit_over_floor: float
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def detected(self) -> bool:
        """Anything but a clean bill."""
        return self.verdict != "adequate"

    @property
    def confident(self) -> bool:
        """A name without reservation."""
        return self.verdict == "explained" and bool(self.named)

    @property
    def wrong_place(self) -> bool:
        """A name without reservation, in the wrong part of the cell."""
        true = {place for places in self.places for place in places.split(" | ")}
        return self.confident and not set(self.named_places) & true


def same(label: str, known: Twins) -> str:
    """One name for twins."""
    for pair in known.pairs:
        if label in pair:
            return " = ".join(sorted(pair))
    return label


def score(
    robot: Robot, truth: dict[str, Any], found: Diagnosis, known: Twins | None = None
) -> Score:
    """Open the sealed truth beside the diagnosis."""
    known = known or twins(robot)
    causes = [c for c in found.causes if c.effect.name not in ("tracker_noise", "force_noise")]
    secrets = [s["label"] for s in truth["secrets"]]
    want = {same(label, known) for label in secrets}
    got = {same(c.effect.label, known) for c in causes}
    rivals = {same(r.effect.label, known) for c in causes for r in c.rivals if r.probability > 0.01}
    worth = causes[0].gain if causes else None
    size = causes[0].amplitudes[0] if causes else None
    fit = found.estimate
    return Score(
        truth=tuple(secrets),
        places=tuple(s["place"] for s in truth["secrets"]),
        known=all(s["known"] for s in truth["secrets"]),
        verdict=found.verdict,
        named=tuple(c.effect.label for c in causes),
        listed=tuple(sorted(got | rivals)),
        named_places=tuple(location(c.effect) for c in causes),
        single=all(c.probability >= 0.95 and not c.twins for c in causes),
        scatter=tuple(c.effect.name for c in found.causes if c not in causes),
        right=want == got,
        in_list=want <= got | rivals,
        gain=None if worth is None else (worth.reduction, *worth.ci95),
        amplitude=None if size is None else (size.value, *size.ci95),
        fit_over_floor=float(np.sqrt(fit.chi2 / fit.dof)) if fit else np.nan,
    )
