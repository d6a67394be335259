"""The robot of a campaign as absolute positions have it, beside which pulls are estimated."""

from __future__ import annotations

from typing import Protocol

from pipeline.base.arrays import Array, Strings
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Elastic
from pipeline.machine.robot import Robot
from pipeline.machine.robot.dh_parameters import DhParameter


class KnownRobot(Protocol):
    """Geometry and compliance of a robot by its absolute positions; their outbuilding makes it."""

    @property
    def robot(self) -> Robot:
        """Robot with its table corrected."""

    @property
    def letters(self) -> tuple[DhParameter, ...]:
        """Uncertain entries of that table, k of them."""

    @property
    def points(self) -> dict[str, Array]:
        """Points of the tool [m], flange frame, by name, t of them."""

    @property
    def compliance(self) -> Array:
        """Compliance of each joint [m/N] or [rad/(N m)], shape (n,)."""

    @property
    def held(self) -> tuple[Elastic, ...]:
        """Elastic elements besides the joints, with e estimated parameters."""

    @property
    def parts(self) -> tuple[Array, Array, Array]:
        """F, K and W: errors of table and points are F a, those of springs and elements K a + W w.

        a and w are independent unit errors; shapes (k + 3 t, r), (n + e, r), (n + e, n + e).
        """

    @property
    def variants(self) -> tuple[tuple[Robot, dict[str, Array]], ...]:
        """Robot and points displaced by each of the errors a, by one standard uncertainty."""

    def joints(self, q: Array) -> Array:
        """Joint values of the robot [m] or [rad] where the controller has q, both (m, n)."""

    def moved(self, q: Array, names: Strings) -> Array:
        """Deviation of points from where the corrected table puts them [m], F_b, (m, 3).

        Args:
            q: Joint values [m] or [rad], shape (m, n).
            names: Name of one point each, shape (m,); a point that was not read has the mean
                deviation of the others.
        """

    def errors(self, q: Array, names: Strings) -> Array:
        """Motion of points, each by one standard error of what is estimated besides the table.

        Args:
            q: Joint values [m] or [rad], shape (m, n).
            names: Name of one point each, shape (m,).

        Returns:
            Motions [m], F_b, up to a rigid motion, shape (m, 3, r).
        """

    def on(self, cell: Cell) -> Cell:
        """The cell with these elements at their estimated values, and the weight moved by pulls."""
