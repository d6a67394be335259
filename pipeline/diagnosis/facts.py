"""The record of a diagnosis, from which result.json is worded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.base.arrays import Array, Locked, Parameter
from pipeline.base.linear import rms
from pipeline.base.tails import NORMAL_95
from pipeline.diagnosis.agreement import SpringAgreement
from pipeline.diagnosis.average import Hypothesis
from pipeline.diagnosis.bounds import FAULTY, Bounds
from pipeline.faults.mistake import Mistake
from pipeline.geometry.roughness import ScaleGrid
from pipeline.machine.effect import Effect, Elastic, Observation
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.course import Course
from pipeline.system.linearised import CurrentModel, Linearised
from pipeline.system.system import Estimate, ScatterRatio

SEPARATED = 4.6
"""Separation of two causes in standard deviations [1] at which the right one leads by 20 to 1 in 95
% of the cases."""

DETECTED = 5.0
"""Separation from the joint springs in standard deviations [1] at which detection is nearly
certain."""


ALL_SPRINGS = "joint_springs"
"""Label of all joint springs together as the twin of a law."""


@dataclass(frozen=True, eq=False)
class CrossValidation(Locked):
    """Cross-validation error without and with the causes.

    Attributes:
        before: Cross-validation residuals without the causes [m], shape (M,).
        after: The same with the causes chosen in each fold [m], shape (M,).
        reduction: Fraction by which the rms falls.
        ci95: Its 95 % interval by bootstrap over poses.
        chosen: Labels chosen when each pose was left out.
        of: Predicted quantity, `displacements` or `unloaded positions`.
    """

    before: Array
    after: Array
    reduction: float
    ci95: tuple[float, float]
    chosen: tuple[tuple[str, ...], ...]
    of: str = "displacements"

    @property
    def rms_before_m(self) -> float:
        """Root mean square over coordinates [m]."""
        return rms(self.before)

    @property
    def rms_after_m(self) -> float:
        """Root mean square over coordinates [m]."""
        return rms(self.after)


@dataclass(frozen=True)
class SoleCause:
    """Effect of one cause by itself, identified or not.

    Attributes:
        effect: The cause, in its best form.
        probability: Probability given that exactly one cause of the catalogue is present.
        reduction: Fraction by which the cross-validation rms falls.
        ci95: Its 95 % interval by bootstrap over poses.
    """

    effect: Effect
    probability: float
    reduction: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class NamelessEqual:
    """A nameless effect that predicts left-out poses as well as a cause when put in its place.

    Attributes:
        effect: The nameless effect.
        reduction: Fraction by which the cross-validation rms falls with it and the other causes.
        ci95: Its 95 % interval by bootstrap over poses.
        times_typical: Its largest parameter over its typical magnitude.
    """

    effect: Effect
    reduction: float
    ci95: tuple[float, float]
    times_typical: float


@dataclass(frozen=True)
class Unnoticed:
    """A cause that would have gone unnoticed at its typical magnitude.

    Attributes:
        effect: The cause.
        why: What hides it.
        smallest_visible: Magnitude of its first parameter that is detected in 80 % of the cases,
            SI; None if none is.
        times: The same over the typical magnitude.
    """

    effect: Effect
    why: str
    smallest_visible: float | None
    times: float


@dataclass(frozen=True, eq=False)
class ProposedPose(Locked):
    """One pose to measure, pulled in the usual load steps.

    Attributes:
        q: Joint values [m] or [rad], shape (n,).
        anchor: Anchor point of the chain [m], F_b, shape (3,).
        force: Largest load step on the robot [N], F_b, shape (3,); all have its direction.
        steps: Number of load steps.
        approach: Approach of the carriage, 1 with rising rail position, -1 with falling.
    """

    q: Array
    anchor: Array
    force: Array
    steps: int
    approach: float

    @property
    def force_n(self) -> float:
        """Magnitude of the largest load step [N]."""
        return float(np.linalg.norm(self.force))


@dataclass(frozen=True, eq=False)
class SeparatingPose(Locked):
    """One pose that would separate causes.

    Attributes:
        separates: Labels of the two causes that stay closest, or of a cause and `joint_springs`.
        at: The pose.
        before: Present separation of the two [standard deviations].
        after: Expected separation with the poses up to this one.
        poses: Number of poses proposed up to here.
    """

    separates: tuple[str, str]
    at: ProposedPose
    before: float
    after: float
    poses: int


@dataclass(frozen=True, eq=False)
class Determining(Locked):
    """The pose that would reduce the uncertainty of one joint's compliance most.

    Attributes:
        at: The pose.
        before: Present standard uncertainty of the compliance, in typical magnitudes [1].
        after: The same with the pose.
    """

    at: ProposedPose
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Drift(Locked):
    """Motion of the tracker that the base reflectors show.

    Attributes:
        effect: The law that fits best, `needs` saying what would separate it from others.
        velocity: Its parameters at the centre of the effector's readings: [m/s], or [m] for a
            tracker that settles, shape (3,).
        std: Their standard uncertainties, shape (3,).
        turn: Rotation about that centre [rad/s] or [rad], F_b, shape (3,).
        turn_std: Its standard uncertainties, shape (3,).
        moved_m: Motion of the base reflectors between first and last reading, rms [m].
        hours: Time between them [h].
        p_value: Probability of as much rigid motion by chance.
        named: Whether it is called a drift.
        undecided: Whether a tracker that was knocked once would look the same.
        visible: Multiple of the typical magnitude that would be named in 80 % of the cases.
        knocked: The two rounds between which the tracker moved most, then by `moved_m`, if it moved
            by more than any noise and no law in time describes it; else None.
        deformed_m: Changes of the reflectors' places between the rounds that no motion of the
            tracker explains, rms per axis [m]; 0 where chance explains them. Where the base frame
            grew, standard uncertainty of what is corrected.
        grown: How it grew in F_b, which is corrected; None if it did not.
    """

    effect: Observation
    velocity: Array
    std: Array
    turn: Array
    turn_std: Array
    moved_m: float
    hours: float
    p_value: float
    named: bool
    undecided: bool
    visible: float
    knocked: tuple[str, str] | None = None
    deformed_m: float = 0.0
    grown: Course | None = None


@dataclass(frozen=True)
class EffectSize:
    """One parameter of an identified cause.

    Attributes:
        parameter: Name, unit, typical magnitude and bounds.
        value: Estimate, SI.
        std: Its standard uncertainty.
        ci95: 95 % interval.
    """

    parameter: Parameter
    value: float
    std: float
    ci95: tuple[float, float]

    @property
    def times_typical(self) -> float:
        """|value| over the typical magnitude [1]."""
        return abs(self.value) / self.parameter.typical

    @classmethod
    def symmetric(
        cls, parameter: Parameter, value: float, std: float, quantile: float = NORMAL_95
    ) -> EffectSize:
        """A magnitude whose interval is `value` +- `quantile` standard uncertainties."""
        return cls(parameter, value, std, (value - quantile * std, value + quantile * std))


@dataclass(frozen=True)
class PossibleCause:
    """A possible cause and its probability."""

    effect: Effect
    probability: float


@dataclass(frozen=True, eq=False)
class TableCause(Locked):
    """A cause that the unloaded positions call for.

    Attributes:
        effect: The cause.
        value: Its parameters, SI, shape (k,).
        std: Their standard uncertainties, shape (k,).
        p_value: Probability that any of the causes tested appears as large in a robot without them.
        probability: Probability of the cause, or of a twin, against all that could replace it.
        rivals: Causes that could replace it, likeliest first.
        twins: Causes that result in the same robot: offsets along parallel axes.
    """

    effect: Effect
    value: Array
    std: Array
    p_value: float
    probability: float
    rivals: tuple[PossibleCause, ...]
    twins: tuple[Effect, ...]


@dataclass(frozen=True, eq=False)
class UnloadedFacts(Locked):
    """Result of the unloaded positions.

    Attributes:
        miss_m: Their deviation from the table, tool and base estimated, rms [m]; NaN where too few
            were read.
        left_m: Their deviation from the estimated table with the causes, rms [m].
        yields_m: What is left of that where a cause in the displacements yields under the weight,
            too, by as much as it may at each pose, rms [m]; infinite without such a cause.
        visible: Multiple of its typical magnitude from which each cause would be found, by label.
        cells: The estimated table, None where too few positions were read.
        causes: Parameters that are off by far more than the rest of the table.
        gain: Cross-validation of the estimated against the nominal table.
        rough: Whether the table is off by significantly more than stated.
        tool_m: Largest distance of a target from its position in [tool] [m].
        noise_m: Noise of their readings, rms [m].
        usual_m: The same with what the joints of a robot usually err by at a pose, and their zeros
            as stated.
        down: Direction of gravity along an axis of F_b with which the arm's weight explains them,
            as opposed to the stated one, and what is then left of the deviation, rms [m]; else
            None.
    """

    miss_m: float
    left_m: float
    visible: Mapping[str, float]
    cells: ScaleGrid | None = None
    causes: tuple[TableCause, ...] = ()
    gain: CrossValidation | None = None
    rough: bool = False
    tool_m: float = 0.0
    noise_m: float = np.nan
    usual_m: float = np.nan
    down: tuple[str, float] | None = None
    yields_m: float = np.inf

    @property
    def weighs(self) -> bool:
        """Whether they show that the arm sags under the weight of its links."""
        return self.cells is not None and self.cells.zeros.weighs

    @property
    def remains_m(self) -> float:
        """Deviation from the table in use, rms [m]."""
        return self.left_m if self.corrects else self.miss_m

    @property
    def unexplained(self) -> bool:
        """Whether they deviate by more than any noise, and than joints usually err by."""
        left = min(self.remains_m, self.yields_m)
        return bool(left > max(FAULTY * self.noise_m, _DOUBLE * self.usual_m))

    @property
    def useless(self) -> bool:
        """Whether the causes fail to improve the predicted positions of left-out poses."""
        return bool(self.causes) and self.gain is not None and self.gain.reduction <= 0

    @property
    def since(self) -> bool:
        """Whether all causes set in during the campaign, as a tracker's drift also looks like."""
        return all(one.effect.since for one in self.causes)

    @property
    def off(self) -> bool:
        """Whether they deviate by more than their noise."""
        return bool(self.remains_m > _DOUBLE * self.noise_m)

    @property
    def believed(self) -> bool:
        """Whether causes were found that improve predictions and explain the unloaded positions."""
        return bool(self.causes) and not self.useless and not self.refuted

    @property
    def refuted(self) -> bool:
        """Whether the robot is far from its table, whatever single entry is wrong.

        Then the joint log or the whole table is wrong in an unlisted way. Also true where targets
        are far from their positions in [tool].
        """
        return max(self.left_m if self.causes else self.miss_m, self.tool_m) >= GROSS_DISTANCE_M

    @property
    def corrects(self) -> bool:
        """Whether displacements are analysed with the estimated table.

        They are where causes are believed, or where the table is significantly rough and the
        estimated one certainly predicts left-out poses better. The latter alone is not sufficient:
        with four poses, all improve by chance in one campaign of sixteen.
        """
        better = self.gain is not None and self.gain.ci95[0] > 0
        return self.believed or ((self.rough or self.weighs) and better and not self.refuted)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The causes."""
        return tuple(one.effect for one in self.causes)


_DOUBLE = 2.0
"""Errors of the joints at a pose, over the usual size, up to which a robot is an ordinary one [1]:
one standard deviation of the logarithm, as of a tracker's noise (`bounds.FAULTY`)."""

NO_UNLOADED = UnloadedFacts(np.nan, np.nan, {})


@dataclass(frozen=True, eq=False)
class FoundCause(Locked):
    """A cause that the data call for.

    Attributes:
        effect: The cause.
        probability: Probability against the others of the catalogue that could replace it, given
            that one of them is present.
        amplitudes: Its parameters.
        p_value: Probability of as much evidence if it were absent.
        rivals: The others, likeliest first.
        unnamed: The likeliest nameless effect in its place, with the probability of any; None where
            this was not tested.
        as_good: Nameless effects that predict as well in its place, the best first.
        twins: Labels of rivals that no pose separates from it.
        same_robot: Those of them that result in the same robot: offsets along parallel axes.
        gain: Cross-validation error without and with all identified causes; None for causes of
            scatter and for a drift that the base reflectors show.
        test_pose_change_m: Change of the predicted deflection at the test pose [m]; None where
            unknown.
        height: Amplitude of a law outside the catalogue; None for causes of the catalogue.
        each_way: Compliance of the joint for positive and for negative torque, for a two-sided
            cause; empty for others.
        either: Laws of its place that the readings do not distinguish, itself first, each with its
            probability given that one of its place is present; empty where it leads by 20 to 1.
        missing: Probability that something is present which the model with the causes lacks, from
            the residuals; 0 where these are explained by chance.
        unproven: Probability that the model without it predicts left-out poses as well; 0 where
            with it these are certainly predicted better.
    """

    effect: Effect
    probability: float
    amplitudes: tuple[EffectSize, ...]
    p_value: float
    rivals: tuple[PossibleCause, ...] = ()
    unnamed: PossibleCause | None = None
    as_good: tuple[NamelessEqual, ...] = ()
    twins: tuple[str, ...] = ()
    same_robot: tuple[Effect, ...] = ()
    gain: CrossValidation | None = None
    test_pose_change_m: float | None = None
    height: EffectSize | None = None
    each_way: tuple[EffectSize, ...] = ()
    either: tuple[PossibleCause, ...] = ()
    missing: float = 0.0
    unproven: float = 0.0

    @property
    def outside(self) -> float:
        """Probability that the apparent cause is not of the catalogue."""
        return max(self.missing, self.unproven, self.unnamed.probability if self.unnamed else 0.0)

    @property
    def of_one_driver(self) -> float:
        """Share of the laws of its place that depend on the same as the stated one [1]."""
        drivers = [
            (one.effect.law and one.effect.law.driver, one.probability) for one in self.either
        ]
        return 1.0 - sum(share for driver, share in drivers if driver != drivers[0][0])

    def stated(self, share: float) -> float:
        """Probability of a cause of the catalogue, from its share given that one is present."""
        return (1.0 - self.outside) * share

    @property
    def told(self) -> tuple[EffectSize, ...]:
        """Magnitudes to report: its amplitude, compliances each way, or parameters."""
        return (self.height,) if self.height else self.each_way or self.amplitudes

    @property
    def largest(self) -> EffectSize:
        """Its largest parameter relative to the typical magnitude."""
        return max(self.amplitudes, key=lambda one: one.times_typical)


@dataclass(frozen=True)
class SuspectStatistics:
    """Statistics of one suspect added to the joint springs alone, for the evidence bars.

    Attributes:
        effect: The suspect, in its best form.
        p_value: P-value of the F test.
        log_evidence: Natural logarithm of the evidence with physical priors.
        absorbed: Fraction of its signature that the joint springs absorb.
        smallest_visible: Multiple of its typical magnitude that is detected in 80 % of the cases.
    """

    effect: Effect
    p_value: float
    log_evidence: float
    absorbed: float
    smallest_visible: float


@dataclass(frozen=True)
class Misfit:
    """Share of one place in the misfit: drop of chi-square with all suspects of the place."""

    place: str
    share: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Facts:
    """All that the verdict depends on, with the values that its sentences state.

    Attributes:
        detected: The joint springs alone do not explain the displacements.
        explains: The causes leave nothing but scatter.
        causes: Causes of the displacements, whether or not they improve predictions.
        gain: Cross-validation error without and with them.
        outside: The likeliest cause outside the catalogue, in the place of a cause.
        refused: Causes that explain best, but at a physically impossible magnitude.
        remainder: Remainder ratio with the causes; None if unknown.
        loose_p: P-value of the reflectors' apparent motion against each other under load.
        scale_ratio: Scatter of the scale found over stated, relative to the tracker's, where only
            this explains the remainder as scatter; else 1.
        scatter_told: Whether the scatter of the readings is known from more than the residuals:
            stated, or found in contrasts that no model of the robot can make.
        noisy: Whether the readings scatter significantly more than stated.
        tracker_ratio: Scatter of the tracker found over the noise in use, which is not the stated
            one where repeats have corrected it.
        scatter: Causes of scatter.
        beyond_certificate: The residuals are larger than any error of a certificate.
        beyond_a_tracker: No noise is stated, and the residuals are larger than a tracker's.
        stated_p: P-value of the residuals with the noise in use; None where none is stated.
        misfit_p: The same with the noise found in contrasts, if that is larger.
        unloaded: Result of the unloaded positions.
        moved: Causes that these call for.
        base: Motion of the tracker that the base reflectors show, if any.
        drift: The same where it is named as a drift.
        mistakes: Mistakes in the data, corrected in all other results.
        bounds: Noise and misfit against their bounds.
        positions: Facts of the absolute positions in a campaign of pulls; None without any.
        agreement: Comparison of the springs by the arm's weight and by the pulls.
    """

    detected: bool = False
    explains: bool = False
    causes: tuple[FoundCause, ...] = ()
    gain: CrossValidation | None = None
    outside: PossibleCause | None = None
    refused: tuple[Effect, ...] = ()
    remainder: float | None = None
    loose_p: float = 1.0
    scale_ratio: float = 1.0
    tracker_ratio: float = 1.0
    scatter_told: bool = True
    noisy: bool = False
    scatter: tuple[FoundCause, ...] = ()
    beyond_certificate: bool = False
    beyond_a_tracker: bool = False
    stated_p: float | None = None
    misfit_p: float = 1.0
    unloaded: UnloadedFacts = NO_UNLOADED
    moved: tuple[FoundCause, ...] = ()
    base: Drift | None = None
    drift: Drift | None = None
    mistakes: tuple[Mistake, ...] = ()
    bounds: Bounds = field(default_factory=Bounds)
    positions: Facts | None = None
    agreement: SpringAgreement | None = None

    @property
    def hopeless(self) -> bool:
        """Whether a mistake in the data cannot be corrected, so that nothing else can be judged."""
        return any(one.hopeless for one in self.mistakes)

    @property
    def changed(self) -> tuple[FoundCause, ...]:
        """Causes among `moved` that set in during the campaign."""
        return tuple(one for one in self.moved if one.effect.since)

    @property
    def misdescribed(self) -> tuple[FoundCause, ...]:
        """Causes among `moved` that are errors of the robot's file or base frame.

        What acts on the deflections too, the sag under the arm's weight, is the machine's own, and
        what changed during the campaign is no error of a file.
        """
        return tuple(
            one
            for one in self.moved
            if one not in self.changed
            and not any(isinstance(facet, Elastic) for facet in one.effect.facets)
        )

    @property
    def helps(self) -> bool:
        """Whether the causes predict left-out poses better than the joint springs alone do.

        They must do so with certainty where the scatter is known from the residuals only: such a
        test presumes that the residuals are normal and of equal variance. With fewer than four
        poses the stated noise alone confirms a cause, which it cannot where readings scatter more.
        """
        if self.gain is None:
            return not self.noisy
        return (self.gain.reduction if self.scatter_told else self.gain.ci95[0]) > 0


@dataclass(frozen=True, eq=False)
class Diagnosed(Locked):
    """Result of the diagnosis.

    Attributes:
        facts: Facts from which the verdict follows.
        causes: The identified causes.
        alone: Effect of each of the likeliest causes by itself.
        blind_spots: Causes that would have gone unnoticed.
        not_found: Causes that were not found and would have shown at their typical magnitude.
        next_poses: Poses to measure next, where a cause is in question.
        determining: The best pose for each joint, where no cause is in question; empty where none
            was found.
        refused: Labels of suspects that fit best only at a physically impossible magnitude.
        clues: Statistics of every suspect.
        threshold: P-value below which a single suspect is detected.
        lack_of_fit: P-values of the tests of lack of fit with the joint springs alone.
        remainder: The same with the causes, and the smallest p-value of a further suspect.
        rough: Remainder ratio with the causes; None if unknown.
        misfits: Places of the misfit in the cell, the largest share first.
        scatter: Scatter found over scatter stated.
        equilibrium: `deformed` where the second order in the load fits better.
        hypotheses: Springs estimated together with the identified causes, then with each likely set
            of causes in their place; empty where nothing changes the springs.
        too_small: Springs estimated together with each cause that may be present but is too small
            to name, with its probability; empty where something was detected.
        left_out_before_m: Cross-validation residuals of the joint springs [m], shape (M,).
        left_out_after_m: Those of the extended model [m], shape (M,); the same without causes.
        noise_floor_m: Rms error expected from the scatter of the readings alone [m].
        seen: The campaign linearised at the joint springs and all accepted causes.
        settled: Whether the model leaves nothing but scatter, so that the noise can be estimated.
        stood_off_m: Deviation of the unloaded reflectors from the table, rms [m], and the same with
            the identified causes; NaN where unknown.
        as_stated: What comes nearest with the scale's stated scatter, where a larger one is used.
        apart: Separation of suspects of typical magnitude in this campaign [standard deviations],
            (n, n); empty without the outbuilding `design`.
        apart_labels: Labels of its rows.
        apart_found: Separation of an identified cause, with its magnitude, from the others; NaN
            elsewhere, (n, n).
    """

    facts: Facts
    causes: tuple[FoundCause, ...]
    alone: tuple[SoleCause, ...]
    blind_spots: tuple[Unnoticed, ...]
    not_found: tuple[Unnoticed, ...]
    next_poses: tuple[SeparatingPose, ...]
    determining: tuple[Determining, ...]
    refused: tuple[str, ...]
    clues: tuple[SuspectStatistics, ...]
    threshold: float
    lack_of_fit: tuple[float, float]
    remainder: tuple[float, float, float]
    rough: float | None
    misfits: tuple[Misfit, ...]
    scatter: ScatterRatio
    equilibrium: str
    hypotheses: tuple[Hypothesis, ...]
    left_out_before_m: Array
    left_out_after_m: Array
    noise_floor_m: float
    seen: Linearised
    settled: bool
    stood_off_m: tuple[float, float]
    too_small: tuple[Hypothesis, ...] = ()
    as_stated: CurrentModel | None = None
    apart: Array = field(default_factory=lambda: np.zeros((0, 0)))
    apart_labels: tuple[str, ...] = ()
    apart_found: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def estimate(self) -> Estimate | None:
        """Springs and identified causes estimated together, None if nothing changes the springs."""
        return self.hypotheses[0].estimate if self.hypotheses else None

    @property
    def modelled(self) -> tuple[Effect, ...]:
        """The identified causes that are estimated together with the springs."""
        known = {p.name for p in self.estimate.parameters} if self.estimate else set()
        return tuple(c.effect for c in self.causes if c.effect.parameters[0].name in known)
