"""Bounds on noise and misfit that a sound campaign must keep, whatever causes were found in it.

What no other mechanism explains becomes noise; these bounds limit how much of it is possible.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pipeline.system import alarms
from pipeline.system.outlying import OutlyingReadings

FAULTY = 10.0
"""Scatter over the stated one above which an instrument is not in order [1]. A tracker that is
twice as noisy as its certificate is usual; stating an MPE, an expanded uncertainty or the noise at
short range for that at the far end errs by a factor of 2 or 3 (see `variance.FAR`). With a factor
of 2 for one standard deviation of its logarithm, ten times is one instrument in two thousand."""

UNSTATED_M = 1e-4
"""Substitute for the stated noise where none is stated [m]: what cameras and measuring arms in a
workshop reach."""

_LEFT = 0.25
"""Maximum fraction of the squared displacements that a model may leave beyond the stated noise [1];
one that leaves more predicts less than half of a deflection."""


@dataclass(frozen=True)
class Bounds:
    """Noise and misfit of a campaign, to be compared with their bounds.

    Attributes:
        tracker: Scatter of the readings in use over the stated one, tails and wander included;
            where none is stated, over a tenth of a millimetre.
        stated: Whether a noise of the tracker is stated.
        force: Scatter of the scale over the stated one.
        left: Fraction of the squared displacements that the model leaves beyond the stated noise.
        determined: Whether the model explains more than chance does.
        far: Readings in use that are farther off than noise explains.
        worst_pose: Pose with the largest residual.
        worst_target: Its target.
        worst_m: Residual there, rms [m].
        turn_rad: The same as a rotation, where that is a pose's rotation [rad]; None for a
            position.
        doubted: Readings that deviate by more than `AWAY` from all others and stay in use, since
            the tails of the noise explain as many: `file:line`.
        unit_m: Substitute for the noise where none is stated, or where unmodelled errors of the
            machine are to be included [m].
    """

    tracker: float = 1.0
    stated: bool = True
    force: float = 1.0
    left: float = 0.0
    determined: bool = True
    far: OutlyingReadings = field(default_factory=OutlyingReadings.none)
    worst_pose: int = 0
    worst_target: str = ""
    worst_m: float = 0.0
    turn_rad: float | None = None
    doubted: tuple[str, ...] = ()
    unit_m: float = UNSTATED_M

    @property
    def faulty(self) -> bool:
        """Whether tracker or scale scatter more than an instrument in order can."""
        return max(self.tracker, self.force) > FAULTY

    @property
    def scattered(self) -> bool:
        """Whether too many readings are too far off for any tails.

        One of a pose is tolerated, since it changes little. One of the base is not: a single wrong
        one would have been found, so it is the least evidence that several are wrong.
        """
        return self.far.count > (self.far.base == 0) and self.far.p_value < alarms.READING

    @property
    def predicts(self) -> bool:
        """Whether the model predicts the measured displacements to any useful extent."""
        return self.determined and self.left <= _LEFT
