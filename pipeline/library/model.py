"""The identified model for users of the library: arguments checked, results with units."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pipeline.base import files
from pipeline.base.arrays import Array, Locked
from pipeline.base.errors import InputError, listed
from pipeline.library import compensate as offsets
from pipeline.library import compliance, model_file
from pipeline.library.compensate import Compensation
from pipeline.library.compliance import CartesianStiffness
from pipeline.library.joints import as_asked, loaded, point
from pipeline.machine.robot import Robot
from pipeline.prediction.model import IdentifiedModel as Identified
from pipeline.prediction.path import Path as JointPath

if TYPE_CHECKING:
    from pipeline.library.kinematic_model import KinematicModel


@dataclass(frozen=True, eq=False)
class Deflection(Locked):
    """Displacement of the loaded point of the tool, in F_b; for a single pose without axis m.

    Attributes:
        displacement_m: Loaded minus unloaded [m], shape (m, 3).
        cov_m2: Covariance of each [m^2], shape (m, 3, 3); infinite on the diagonal where a spring
            acts that the campaign did not determine.
        left_out_rms_m: Held-out error of the model, rms per axis [m], noise of the readings
            included; None if nothing was left out.
    """

    displacement_m: Array
    cov_m2: Array
    left_out_rms_m: float | None = None

    @property
    def std_m(self) -> Array:
        """Standard uncertainty per axis, k = 1 [m], shape (m, 3)."""
        return np.sqrt(np.einsum("...ii->...i", self.cov_m2))

    @property
    def expanded_m(self) -> Array:
        """Expanded uncertainty U per axis, k = 2 [m], shape (m, 3)."""
        return 2 * self.std_m


@dataclass(frozen=True, eq=False)
class Positions(Locked):
    """Positions of the targets of a campaign, in F_b; for a single pose without axis m.

    Attributes:
        targets: Their names, t of them.
        position_m: Positions [m], shape (m, t, 3).
        rotation: Orientation of each, shape (m, t, 3, 3).
        std_m: Standard uncertainty of the true position per axis [m], shape (m, t, 3).
        std_rad: Standard uncertainty of a rotation about the axes of F_b [rad], shape (m, t, 3).
    """

    targets: tuple[str, ...]
    position_m: Array
    rotation: Array
    std_m: Array
    std_rad: Array


@dataclass(frozen=True, eq=False)
class Model:
    """An identified robot: its joints and other elastic causes under load.

    Joint values q are in m for prismatic and in rad for revolute joints, shape (n,) or (m, n);
    `robot.from_degrees` converts. A value beyond the limits of the robot file, or one that can only
    be in degrees or mm, is rejected.

    Attributes:
        identified: Content of model.toml, including hypotheses with weights and covariances.
    """

    identified: Identified

    @property
    def robot(self) -> Robot:
        """The robot with its joints, limits and geometry."""
        return self.identified.robot

    @property
    def compliance(self) -> Array:
        """Compliance of each joint [m/N] or [rad/(N m)], shape (n,)."""
        return self.identified.value

    @property
    def compliance_cov(self) -> Array:
        """Its covariance, shape (n, n); infinite on the diagonal where undetermined."""
        return self.identified.cov

    def predict(
        self, q: npt.ArrayLike, force_n: npt.ArrayLike, point_m: npt.ArrayLike | None = None
    ) -> Deflection:
        """Deflection of a point of the tool under a force that acts at it: c = B(q, f) x.

        Args:
            q: Joint values [m] or [rad], shape (n,) or (m, n).
            force_n: Force on the robot [N], F_b, shape (3,) or (m, 3).
            point_m: The point in the flange frame [m], shape (3,); the campaign's load point when
                not given.

        Raises:
            InputError: Invalid shape, unit or joint limit; states which joint.
        """
        rows, force = loaded(self.robot, q, force_n)
        found = self.identified.predict(rows, force, point("point_m", point_m))
        made = Deflection(found.displacement, found.cov, self.identified.held_out_m)
        return as_asked(made, q, force_n)

    def cartesian_stiffness(
        self,
        q: npt.ArrayLike,
        point_m: npt.ArrayLike | None = None,
        force_n: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> CartesianStiffness:
        """K(q) at a point of the tool, 6 x 6 with its uncertainty, in F_b.

        Args:
            q: Joint values [m] or [rad], shape (n,) or (m, n).
            point_m: The point in the flange frame [m], shape (3,); the campaign's load point when
                not given.
            force_n: Working load [N], F_b, about which nonlinear laws are linearised, shape (3,) or
                (m, 3); none when not given.

        Raises:
            InputError: Invalid shape, unit or joint limit; states which joint.
        """
        rows, force = loaded(self.robot, q, force_n)
        at = point("point_m", point_m)
        found = compliance.cartesian_stiffness(self.identified, rows, force, at)
        return as_asked(found, q, force_n)

    def compensate(
        self, q: npt.ArrayLike, force_n: npt.ArrayLike, tip_m: npt.ArrayLike | None = None
    ) -> Compensation:
        """Offsets that move the loaded tip to where the unloaded robot would have it.

        Args:
            q: Joint values of each point of a path [m] or [rad], shape (n,) or (m, n).
            force_n: Force on the robot at the tip [N], F_b, shape (3,) or (m, 3).
            tip_m: The tip in the flange frame [m], shape (3,); the campaign's load point when not
                given.

        Raises:
            InputError: Invalid shape, unit or joint limit; states which joint.
        """
        rows, force = loaded(self.robot, q, force_n)
        path = JointPath(np.arange(1, len(rows) + 1), rows, force, controller=False)
        return offsets.compensate(self.identified, path, point("tip_m", tip_m))


@dataclass(frozen=True, eq=False)
class PositionModel:
    """Model of a robot's positions, from a campaign of absolute positions.

    Attributes:
        standing: Content of positions.npz.
    """

    standing: KinematicModel

    @property
    def robot(self) -> Robot:
        """The robot with its table as delivered."""
        return self.standing.mechanism.table

    def predict(
        self,
        q: npt.ArrayLike,
        force_n: npt.ArrayLike = (0.0, 0.0, 0.0),
        payload: str | None = None,
        temperature_c: float = np.nan,
    ) -> Positions:
        """Predict the targets, with the uncertainty of the true position.

        Args:
            q: Joint values [m] or [rad], shape (n,) or (m, n).
            force_n: Force at the load point, or at the first target if nothing was pulled [N], F_b,
                shape (3,) or (m, 3).
            payload: Name of a payload defined in campaign.toml; None for no payload.
            temperature_c: Temperature of the air [degC]; NaN if unknown.

        Raises:
            InputError: Invalid shape, unit or joint limit, or an unknown payload.
        """
        from pipeline.library import target_model  # of the positions, which pulls need not have

        rows, force = loaded(self.robot, q, force_n)
        carried = np.full(len(rows), self._number(payload), dtype=np.int64)
        warm = np.full(len(rows), float(temperature_c))
        found = target_model.predict(self.standing, rows, force, carried, warm)
        names = tuple(str(name) for name in self.standing.targets)
        std = found.std
        made = Positions(names, found.at, found.turn, std[..., :3], std[..., 3:])
        return as_asked(made, q, force_n)

    def _number(self, payload: str | None) -> int:
        if payload is None:
            return 0
        if payload not in self.standing.payloads:
            known = listed(self.standing.payloads)
            raise InputError(f'payload "{payload}" is not known', f"the campaign knows {known}")
        return self.standing.payloads.index(payload) + 1


def load_model(path: Path | str) -> Model:
    """Load the model from a model.toml, as `pipeline run` writes it with the report.

    Raises:
        InputError: There is no such file, or it is not a model.
    """
    return Model(model_file.load(path))


def load_position_model(path: Path | str) -> PositionModel:
    """Load a positions.npz, as `pipeline run` writes it for a campaign of positions.

    Raises:
        InputError: There is no such file, or it is not a model.
    """
    from pipeline.library import target_model

    missing = InputError(
        "there is no such file", "give the path of a positions.npz", file=str(path)
    )
    return position_model(
        files.read(Path(path), str(path), target_model.LARGEST_MODEL, missing), str(path)
    )


def position_model(data: bytes, name: str = "positions.npz") -> PositionModel:
    """Load the model from the bytes of a positions.npz.

    Raises:
        InputError: They are not a model.
    """
    from pipeline.library import target_model

    return PositionModel(target_model.loads(data, name))
