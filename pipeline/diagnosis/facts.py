"""The record that a diagnosis leaves behind, and how result.json words it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.base.arrays import Array, Locked, Parameter
from pipeline.base.linear import rms
from pipeline.base.tails import NORMAL_95
from pipeline.diagnosis.average import Hypothesis
from pipeline.diagnosis.bounds import Bounds
from pipeline.diagnosis.joined import Agreement
from pipeline.faults.mistake import Mistake
from pipeline.geometry.roughness import Cells
from pipeline.machine.effect import Effect, Observation
from pipeline.readers.known import GROSS_M
from pipeline.system.linearised import Linearised
from pipeline.system.system import Estimate, ScatterRatio

APART = 4.6
"""Sigmas between two causes from which the right one leads by 20 to 1 in 95 % of the cases."""

DETECTED = 5.0
"""Sigmas from which detection of a cause is nearly certain."""


MANY = 10.0
"""A cause so many times its typical size is said to be [1]: typical sizes are estimates and hold to
a factor of a few (`Effect.source`), so what is beyond an order of magnitude is no usual cause."""


@dataclass(frozen=True, eq=False)
class CrossValidation(Locked):
    """Cross-validation error without and with the causes.

    Attributes:
        before: Cross-validation residuals without the causes [m], shape (M,).
        after: The same with the causes chosen in each fold [m], shape (M,).
        reduction: Fraction by which the rms falls.
        ci95: Its interval by bootstrap over poses.
        chosen: Labels chosen when each pose was left out.
        of: What is predicted, `displacements` or `unloaded positions`.
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
    """What one cause does by itself, identified or not.

    Attributes:
        effect: The cause, in its best form.
        probability: Given that exactly one cause of the catalogue is at work.
        reduction: Fraction by which the cross-validation rms falls.
        ci95: Its interval by bootstrap over poses.
    """

    effect: Effect
    probability: float
    reduction: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class NamelessEqual:
    """Something without a name that predicts left-out poses as well as a cause in its place.

    Attributes:
        effect: What it is like.
        reduction: Fraction by which it lets the cross-validation rms fall, beside the other causes.
        ci95: Its interval by bootstrap over poses.
        times_typical: Its largest parameter over the usual size of that.
    """

    effect: Effect
    reduction: float
    ci95: tuple[float, float]
    times_typical: float


@dataclass(frozen=True)
class Unnoticed:
    """One cause that would have gone unnoticed at its typical size.

    Attributes:
        effect: The cause.
        why: What hides it.
        smallest_visible: Size of its first parameter that is found in 80 % of the cases, SI; None
            when no size is.
        times: The same over the typical size.
    """

    effect: Effect
    why: str
    smallest_visible: float | None
    times: float


@dataclass(frozen=True, eq=False)
class Pose(Locked):
    """One pose to measure, pulled in the usual load steps.

    Attributes:
        q: Joint values [m] or [rad], shape (n,).
        anchor: Where to attach the chain [m], F_b, shape (3,).
        force: The largest of the load steps on the robot [N], F_b, shape (3,); all have its
            direction.
        steps: How many load steps.
        approach: How the carriage comes, 1 with rising rail position, -1 with falling.
    """

    q: Array
    anchor: Array
    force: Array
    steps: int
    approach: float

    @property
    def force_n(self) -> float:
        """Size of the largest load step [N]."""
        return float(np.linalg.norm(self.force))


@dataclass(frozen=True, eq=False)
class Proposal(Locked):
    """One pose that would tell causes apart.

    Attributes:
        separates: Labels of the two causes that stay closest, or of a cause and `_SPRINGS`.
        at: The pose.
        before: Sigmas between the two now.
        after: Sigmas expected with the poses up to this one.
        poses: How many poses are proposed up to here.
    """

    separates: tuple[str, str]
    at: Pose
    before: float
    after: float
    poses: int


@dataclass(frozen=True, eq=False)
class Determining(Locked):
    """The pose that would make one joint's compliance most certain.

    Attributes:
        at: The pose.
        before: Standard uncertainty of the compliance now, in typical sizes [1].
        after: The same with the pose.
    """

    at: Pose
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Drift(Locked):
    """What the base reflectors show of the tracker.

    Attributes:
        effect: The law that fits best, `needs` saying what would separate it from others.
        velocity: Its parameters at the centre of the effector's readings: [m/s], or [m] for a
            tracker that settles, shape (3,).
        std: Their standard uncertainties, shape (3,).
        turn: The rotation about that centre [rad/s] or [rad], F_b, shape (3,).
        turn_std: Its standard uncertainties, shape (3,).
        moved_m: How far the base reflectors moved from the first to the last reading, rms [m].
        hours: Time between them [h].
        p_value: Probability of so much rigid motion by chance.
        named: Whether it is called a drift.
        undecided: Whether a tracker that was knocked once would look the same.
        visible: Multiple of the typical size that would be named in 80 % of the cases.
        knocked: The rounds between which it moved most, by `moved_m` then, where it moved by
            more than noise of any kind moves it, and no law in time says how; None else.
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


@dataclass(frozen=True)
class EffectSize:
    """One parameter of an identified cause.

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

    @property
    def times_typical(self) -> float:
        """|value| over the typical size [1]."""
        return abs(self.value) / self.parameter.typical

    @property
    def at_least_typical(self) -> float:
        """The same at the end of the interval that is nearer to zero; 0 where that holds it."""
        low, high = self.ci95
        return max(low, -high, 0.0) / self.parameter.typical

    @classmethod
    def symmetric(
        cls, parameter: Parameter, value: float, std: float, quantile: float = NORMAL_95
    ) -> EffectSize:
        """One whose interval reaches `quantile` standard uncertainties to either side."""
        return cls(parameter, value, std, (value - quantile * std, value + quantile * std))


@dataclass(frozen=True)
class PossibleCause:
    """A cause that could stand in some place, with its probability."""

    effect: Effect
    probability: float


@dataclass(frozen=True, eq=False)
class TableCause(Locked):
    """A cause that the unloaded positions call for.

    Attributes:
        effect: What it is.
        value: Its parameters, SI, shape (k,).
        std: Their standard uncertainties, shape (k,).
        p_value: Chance of so much in a robot without, as many causes being looked for as are.
        probability: Of it, or of a twin, against all that could stand in its place.
        rivals: What else could, likeliest first.
        twins: What makes the same robot: offsets along parallel axes.
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
    """What the unloaded positions show.

    Attributes:
        miss_m: Their deviation from the table, tool and base estimated as well, rms [m]; NaN
            where too few were read.
        left_m: The same from the estimated table, with the causes.
        visible: Multiple of its typical size from which each cause would be found, by label.
        cells: The estimated table, None where too few positions were read.
        causes: What is off by far more than the rest of the table.
        gain: What the estimate is worth at poses that were left out, against the table as it is.
        rough: The table is off by more than is stated, beyond chance.
        tool_m: How far the targets are from their places in [tool], the farthest [m].
    """

    miss_m: float
    left_m: float
    visible: Mapping[str, float]
    cells: Cells | None = None
    causes: tuple[TableCause, ...] = ()
    gain: CrossValidation | None = None
    rough: bool = False
    tool_m: float = 0.0

    @property
    def useless(self) -> bool:
        """The causes predict where the robot stands in left-out poses no better than none."""
        return bool(self.causes) and self.gain is not None and self.gain.reduction <= 0

    @property
    def believed(self) -> bool:
        """Causes were found, and the robot stands where they put it."""
        return bool(self.causes) and not self.useless and not self.refuted

    @property
    def refuted(self) -> bool:
        """The robot is nowhere near where its table puts it, whatever single entry is wrong.

        Then the joint log or the whole table is wrong in a way that nobody listed. The same where
        all targets are nowhere near their places in [tool].
        """
        left = self.left_m if self.causes else self.miss_m
        return max(left, self.tool_m) >= GROSS_M

    @property
    def corrects(self) -> bool:
        """Whether displacements are analysed on the estimated table.

        They are where causes are believed, or where the table is rough beyond chance and the
        estimated one predicts better where the robot stands in left-out poses. The second alone
        does not do: of four poses all are better by chance in one campaign of sixteen.
        """
        better = self.gain is not None and self.gain.ci95[0] > 0
        return self.believed or (self.rough and better and not self.refuted)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The causes."""
        return tuple(one.effect for one in self.causes)


NOTHING = UnloadedFacts(np.nan, np.nan, {})


@dataclass(frozen=True, eq=False)
class FoundCause(Locked):
    """A cause that the data call for.

    Attributes:
        effect: What it is.
        probability: Against the others of the catalogue that could stand in its place, if one of
            them does.
        amplitudes: Its parameters.
        p_value: Chance of so much evidence if it were absent.
        rivals: The others, likeliest first.
        unnamed: What has no name and would stand there instead, and how likely something without
            a name does; None where nothing was asked.
        as_good: What has no name and predicts as well in its place, the best first.
        twins: Labels of rivals that no pose separates from it.
        same_robot: Those of them that make the same robot: offsets along parallel axes.
        gain: Cross-validation error without and with all identified causes; None for causes of
            scatter and for a drift that the base reflectors show.
        test_pose_change_m: By how much the predicted deflection at the test pose changes [m]; None
            where that is not known.
        height: Amplitude of a law that nobody listed; None for causes of the catalogue.
        each_way: Compliance of the joint where the torque is positive, and where it is negative,
            of a cause that gives it two; empty for others.
        either: Laws of its place that the readings do not tell apart, itself first, each with its
            probability if one of its place acts; empty where it leads by 20 to 1.
        missing: Probability that something acts which the model with the causes does not hold, by
            what it leaves; 0 where that is no more than chance.
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

    @property
    def outside(self) -> float:
        """Probability that what looks like it is none of the catalogue."""
        return max(self.missing, self.unnamed.probability if self.unnamed else 0.0)

    def stated(self, share: float) -> float:
        """Probability of one of the catalogue, of its share if one of them stands there."""
        return (1.0 - self.outside) * share

    @property
    def told(self) -> tuple[EffectSize, ...]:
        """What is told of its size: its parameters, or what these mean."""
        return (self.height,) if self.height else self.each_way or self.amplitudes

    @property
    def largest(self) -> EffectSize:
        """Its parameter that is largest in typical sizes."""
        return max(self.amplitudes, key=lambda one: one.times_typical)

    @property
    def enormous(self) -> EffectSize | None:
        """Its parameter that is certainly `MANY` times its typical size; None where none is."""
        most = max(self.amplitudes, key=lambda one: one.at_least_typical)
        return most if most.at_least_typical > MANY else None


@dataclass(frozen=True)
class SuspectStatistics:
    """Statistics of one suspect added to the joint springs alone, for the evidence bars.

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
class Facts:
    """All that the verdict depends on, with what its sentences state.

    Attributes:
        detected: The joint springs alone do not explain the displacements.
        explains: The causes leave nothing but scatter.
        causes: What the displacements call for, whether or not it predicts better.
        gain: What these are worth at poses that were left out.
        outside: The likeliest outside the catalogue, in the place of a cause.
        refused: Causes that explain best, but at a size that physics does not allow.
        remainder: What is left with the causes over what the readings scatter; None if unknown.
        loose_p: Chance that the reflectors only seem to move against each other under load.
        scale_ratio: Scatter of the scale found over stated, relative to the tracker's, where only
            this makes the remainder scatter; else 1.
        scatter_told: The scatter of the readings is known from more than what the model leaves:
            stated, or found in contrasts that no model of the robot can make.
        tracker_ratio: Scatter of the tracker found over the noise in use, which is not the stated
            one where repeats have corrected it.
        scatter: Causes of scatter.
        beyond_certificate: The residuals are larger than any error of a certificate.
        beyond_a_tracker: No noise is stated, and the residuals are larger than a tracker's.
        stated_p: Probability of what the model leaves, by the noise in use; None where none is
            stated.
        misfit_p: The same by the noise found in contrasts, if that is more likely.
        unloaded: What the unloaded positions show.
        moved: Causes that these call for.
        base: What the base reflectors show of the tracker, where they show anything.
        drift: The same where they call for a drift.
        mistakes: Mistakes in the data, corrected for all the rest.
        bounds: Noise and misfit against what they can be.
        positions: What absolute positions in a campaign of pulls show; None without any.
        agreement: Springs by the arm's weight against those by the pulls, where both tell.
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
    scatter: tuple[FoundCause, ...] = ()
    beyond_certificate: bool = False
    beyond_a_tracker: bool = False
    stated_p: float | None = None
    misfit_p: float = 1.0
    unloaded: UnloadedFacts = NOTHING
    moved: tuple[FoundCause, ...] = ()
    base: Drift | None = None
    drift: Drift | None = None
    mistakes: tuple[Mistake, ...] = ()
    bounds: Bounds = field(default_factory=Bounds)
    positions: Facts | None = None
    agreement: Agreement | None = None

    @property
    def helps(self) -> bool:
        """The causes predict left-out poses better than the joint springs alone do.

        For certain, where only what the model leaves tells how the readings scatter: a test that
        rests on its own residuals takes for granted that these are normal and all of one size.
        """
        if self.gain is None:
            return True
        return (self.gain.reduction if self.scatter_told else self.gain.ci95[0]) > 0


@dataclass(frozen=True, eq=False)
class Diagnosed(Locked):
    """What the model gets wrong.

    Attributes:
        facts: What the verdict follows from.
        causes: The identified causes.
        alone: What the likeliest causes do each by itself.
        blind_spots: What would have gone unnoticed.
        next_poses: What to measure next, where a cause is in question.
        determining: The best pose for each joint, where none is; empty where no pose was found.
        refused: Labels that fit best only at a physically impossible size.
        clues: Statistics of every suspect.
        threshold: p below which one suspect is a detection.
        lack_of_fit: p of the tests of lack of fit with the joint springs alone.
        remainder: The same with the causes, and the smallest p of a further suspect.
        rough: Remainder ratio: what is left with the causes over the scatter; None if unknown.
        misfits: Where in the cell the misfit sits, the largest share first.
        scatter: Scatter found over scatter stated.
        equilibrium: `deformed` where the second order in the load fits better.
        apart: Sigmas between suspects at typical size as this campaign sees them, (n, n).
        apart_labels: Labels of its rows.
        apart_found: The same between an identified cause, as large as found here, and the others,
            NaN elsewhere, (n, n).
        hypotheses: Springs estimated together with the identified causes, then with each likely
            set of causes in their place; empty where nothing changes the springs.
        too_small: Springs estimated together with each cause that may act but is too small to name,
            by its probability beside the joint springs alone; empty where something was detected.
        left_out_before_m: Cross-validation residuals of the joint springs [m], shape (M,).
        left_out_after_m: Of the extended model [m], shape (M,); the same without causes.
        noise_floor_m: Root mean square that the scatter of the readings alone makes.
        seen: The campaign linearised at the joint springs and all accepted causes.
        settled: The model leaves nothing but scatter, so that noise can be seen beside it.
        stood_off_m: How far the unloaded reflectors are from the table, rms [m], and the same
            with the identified causes; NaN where that is not known.
    """

    facts: Facts
    causes: tuple[FoundCause, ...]
    alone: tuple[SoleCause, ...]
    blind_spots: tuple[Unnoticed, ...]
    next_poses: tuple[Proposal, ...]
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
    apart: Array
    apart_labels: tuple[str, ...]
    apart_found: Array
    hypotheses: tuple[Hypothesis, ...]
    left_out_before_m: Array
    left_out_after_m: Array
    noise_floor_m: float
    seen: Linearised
    settled: bool
    stood_off_m: tuple[float, float]
    too_small: tuple[Hypothesis, ...] = ()

    @property
    def estimate(self) -> Estimate | None:
        """Springs and identified causes estimated together, None where nothing changes them."""
        return self.hypotheses[0].estimate if self.hypotheses else None

    @property
    def modelled(self) -> tuple[Effect, ...]:
        """The identified causes that are estimated together with the springs."""
        known = {p.name for p in self.estimate.parameters} if self.estimate else set()
        return tuple(c.effect for c in self.causes if c.effect.parameters[0].name in known)
