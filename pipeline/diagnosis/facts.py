"""The record that a diagnosis leaves behind."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.base.arrays import Array, Locked, Parameter
from pipeline.diagnosis.average import Hypothesis
from pipeline.diagnosis.blindspots import BlindSpot
from pipeline.diagnosis.improvement import Alone, Gain
from pipeline.diagnosis.nextpose import Proposal
from pipeline.machine.effects import Effect
from pipeline.system.noise import Scatter
from pipeline.system.system import Estimate


@dataclass(frozen=True)
class Amplitude:
    """One parameter of a named cause.

    Attributes:
        parameter: Name, unit, typical size and bounds.
        value: Estimate, SI.
        std: Its standard uncertainty.
        ci95: 95 % interval.
    """

    parameter: Parameter
    value: float
    std: float
    ci95: tuple[float, float]

    @classmethod
    def symmetric(
        cls, parameter: Parameter, value: float, std: float, quantile: float = 1.96
    ) -> Amplitude:
        """One whose interval reaches `quantile` standard uncertainties to either side."""
        return cls(parameter, value, std, (value - quantile * std, value + quantile * std))


@dataclass(frozen=True)
class Named:
    """A cause that could stand in some place, with its probability."""

    effect: Effect
    probability: float


@dataclass(frozen=True, eq=False)
class Cause(Locked):
    """A cause that the data call for.

    Attributes:
        effect: What it is.
        probability: Against the others of the catalogue that could stand in its place.
        amplitudes: Its parameters.
        p_value: Chance of so much evidence if it were absent.
        rivals: The others, likeliest first.
        unnamed: What has no name and would stand there instead, and how likely something without
            a name does; None where nothing was asked.
        twins: Labels of rivals that no pose tells from it.
        gain: Left-out error without and with all named causes; None for causes of scatter and for a
            drift that the base reflectors show.
        test_pose_change_m: By how much the predicted deflection at the test pose changes [m]; None
            where that is not known.
    """

    effect: Effect
    probability: float
    amplitudes: tuple[Amplitude, ...]
    p_value: float
    rivals: tuple[Named, ...] = ()
    unnamed: Named | None = None
    twins: tuple[str, ...] = ()
    gain: Gain | None = None
    test_pose_change_m: float | None = None


@dataclass(frozen=True)
class Clue:
    """What the data say of one suspect beside the joint springs alone, for the evidence bars.

    Attributes:
        effect: The suspect, in its best form.
        p_value: F test.
        log_evidence: Natural log, with physical priors.
        absorbed: Fraction of its signature that the joint springs hide.
        smallest_visible: Multiple of its typical size that is found in 80 % of the cases.
    """

    effect: Effect
    p_value: float
    log_evidence: float
    absorbed: float
    smallest_visible: float


@dataclass(frozen=True)
class Misfit:
    """Where what is left sits: drop of chi-square when all suspects of one place join."""

    place: str
    share: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Diagnosis(Locked):
    """What the model gets wrong.

    Attributes:
        verdict: adequate | explained | ambiguous | unexplained | bad_data.
        why: One sentence for it.
        causes: The named causes.
        alone: What the likeliest causes do each by itself.
        blind_spots: What would have gone unnoticed.
        next_poses: What to measure next.
        refused: Labels that fit best only at a physically impossible size.
        clues: Every suspect.
        threshold: p below which one suspect is a detection.
        lack_of_fit: p of the tests of lack of fit with the joint springs alone.
        remainder: The same with the causes, and the smallest p of a further suspect.
        rough: What is left with the causes over what the readings scatter; None if unknown.
        misfits: Where in the cell the misfit sits, the largest share first.
        scatter: Scatter found over scatter stated.
        equilibrium: `deformed` where the second order in the load fits better.
        apart: Sigmas between suspects at typical size as this campaign sees them, (n, n).
        apart_labels: Labels of its rows.
        hypotheses: Springs estimated together with the identified causes, then with each likely
            set of causes in their place; empty where nothing changes the springs.
        left_out_before_m: Left-out residuals of the joint springs [m], shape (M,).
        left_out_after_m: Of the extended model [m], shape (M,); the same without causes.
        noise_floor_m: Root mean square that the scatter of the readings alone makes.
        stood_off_m: How far the unloaded reflectors stand from the table, rms [m], and the same
            with the named causes; NaN where that is not known.
    """

    verdict: str
    why: str
    causes: tuple[Cause, ...]
    alone: tuple[Alone, ...]
    blind_spots: tuple[BlindSpot, ...]
    next_poses: tuple[Proposal, ...]
    refused: tuple[str, ...]
    clues: tuple[Clue, ...]
    threshold: float
    lack_of_fit: tuple[float, float]
    remainder: tuple[float, float, float]
    rough: float | None
    misfits: tuple[Misfit, ...]
    scatter: Scatter
    equilibrium: str
    apart: Array
    apart_labels: tuple[str, ...]
    hypotheses: tuple[Hypothesis, ...]
    left_out_before_m: Array
    left_out_after_m: Array
    noise_floor_m: float
    stood_off_m: tuple[float, float]

    @property
    def estimate(self) -> Estimate | None:
        """Springs and identified causes estimated together, None where nothing changes them."""
        return self.hypotheses[0].estimate if self.hypotheses else None

    @property
    def modelled(self) -> tuple[Effect, ...]:
        """The named causes that are estimated together with the springs."""
        known = {p.name for p in self.estimate.parameters} if self.estimate else set()
        return tuple(c.effect for c in self.causes if c.effect.parameters[0].name in known)
