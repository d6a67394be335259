"""What is known of a campaign after each pose: suspected readings, next poses, when to stop."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from pipeline.answer.contract import Answer, Cause, Tip, Tolerance
from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.faults.mistake import Mistake
from pipeline.library.campaign import Campaign, Result
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import Robot, axes
from pipeline.readers import logs

_CERTAIN = 3.0
"""Distance of the predicted deflection from the tolerance that is required to stop, in standard
uncertainties [1]: the decision is examined after each of some ten poses, with a probability of
1.4e-3 of a chance error each time."""

_FEWEST = 4
"""Number of poses before which measuring is never stopped: three determine six joints, the fourth
checks them."""

_LIKELY = 0.5
"""Probability from which a cause is reported while measuring [1]."""


@dataclass(frozen=True)
class _Suspect:
    """A reading, row or pull that does not agree with the others.

    Attributes:
        name: Kind of mistake, as in `diagnosis.causes`.
        where: Reading, pose or target.
        readings: `file:line` of all readings concerned.
        text: What is wrong, and what to do.
    """

    name: str
    where: str
    readings: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class _Open:
    """Estimate of one stiffness so far; value and std in `unit`, None if not determined."""

    name: str
    axis: str
    value: float | None
    std: float | None
    unit: str
    relative_std: float | None


@dataclass(frozen=True)
class _Next:
    """A pose to measure next.

    Attributes:
        pose: Its number in the joint log if it is planned, None if it is proposed.
        axes: Axis of the controller, value and unit, as to be typed.
        worth: Expected information [bit]: log2 of the ratio by which the volume of uncertainty
            shrinks; None if it determines a joint that is not determined so far.
        text: Reason.
    """

    pose: int | None
    axes: tuple[tuple[str, float, str], ...]
    worth: float | None
    text: str


@dataclass(frozen=True)
class _Stop:
    """Whether to stop, why, and how many planned poses that saves."""

    now: bool
    text: str
    saved_poses: int = 0


@dataclass(frozen=True)
class Update:
    """What is known after a pose.

    Attributes:
        pose: Number of the pose that is judged, None before the first.
        poses: Number of poses with readings.
        accepted: Whether nothing of that pose is suspected.
        complete: Whether it has been measured completely.
        suspects: All present suspects, of any pose.
        stiffness: Stiffness of each joint.
        warnings: Likely causes, as sentences: tracker drift, temperature, a wrong scale.
        next: Planned poses that remain, the most informative first, or a proposed one.
        stop: Whether to stop.
        verdict: Verdict on the data so far.
        searched: Whether causes were sought as by `run`; otherwise readings were tested against the
            last search, and the stiffnesses estimated from all of them.
        why: Why nothing can be said yet; then the other attributes are empty.
    """

    pose: int | None
    poses: int
    accepted: bool
    complete: bool = False
    suspects: tuple[_Suspect, ...] = ()
    stiffness: tuple[_Open, ...] = ()
    warnings: tuple[str, ...] = ()
    next: tuple[_Next, ...] = ()
    stop: _Stop = _Stop(now=False, text="")
    verdict: str | None = None
    searched: bool = False
    why: str | None = None

    def as_json(self) -> str:
        """The update as one line of JSON."""
        return json.dumps(asdict(self), ensure_ascii=False, allow_nan=False)


def update_of(
    campaign: Campaign, result: Result, pose: int | None = None, doubted: Sequence[Mistake] = ()
) -> Update:
    """Judge a campaign as far as it is measured.

    Args:
        campaign: The files so far.
        result: Result of identification from them.
        pose: Completely measured pose to be judged; None for the one that is being measured.
        doubted: What contradicts the earlier model; reported if no suspect explains it.
    """
    answer, readings = result.answer, result.tables["readings"]
    poses = list(dict.fromkeys(measured(result)))
    last = pose if pose is not None else poses[-1] if poses else None
    suspects = tuple(_suspects(answer))
    if not suspects and str(answer.diagnosis.verdict) in {"adequate", "unexplained"}:
        suspects = tuple(_suspect(one.name, one.where, one.at, one.evidence) for one in doubted)
    mine = _Of(readings[readings["pose"] == last])
    left = _left(campaign, result, poses)
    return Update(
        pose=last,
        poses=len(poses),
        complete=pose is not None,
        accepted=not any(mine.concerned(one) for one in suspects),
        suspects=suspects,
        stiffness=tuple(_stiffness(answer)),
        warnings=tuple(_warnings(answer, campaign.robot)),
        next=tuple(left) or tuple(_proposed(answer)),
        stop=_stop(answer, len(poses), len(left), bool(suspects)),
        verdict=str(answer.diagnosis.verdict),
    )


def measured(result: Result) -> list[int]:
    """Pose number of each reading that belongs to a pose, in the order of reading."""
    pose = result.tables["readings"]["pose"].to_numpy(dtype=float)
    return [int(one) for one in pose if np.isfinite(one) and one > 0]


class _Of:
    """Groups and lines of the readings of one pose, to find which suspects concern it."""

    def __init__(self, readings: pd.DataFrame) -> None:
        self._groups = set(readings["group"].astype(str))
        self._lines = set(readings["file"].astype(str) + ":" + readings["line"].astype(str))

    def concerned(self, one: _Suspect) -> bool:
        """Whether a suspect concerns the pose.

        Rejected readings are in no table, but other targets of their group are.
        """
        return one.where.rpartition("/")[0] in self._groups or bool(self._lines & {*one.readings})


def _suspects(answer: Answer) -> Iterator[_Suspect]:
    for one in answer.diagnosis.causes:
        if one.evidence is not None:
            where = str(one.where or "")
            yield _suspect(str(one.name), where, one.readings, one.evidence.sentence)


def _suspect(name: str, where: str, readings: Sequence[str], sentence: str) -> _Suspect:
    again = "Measure it again, or correct the file."
    return _Suspect(name, where, tuple(readings), f"{sentence[:1].upper()}{sentence[1:]}. {again}")


_ADVICE = {
    "tracker_knocked": "see that tracker and base stand firm, and read the base reflectors again",
    "reflectors_loose": "see that every nest holds, and that the effector is stiff",
    "tracker_drift": "let the tracker warm up, read the base reflectors again, and each zero anew",
    "tracker_wander": "read each zero shortly before its pulls, and again behind them",
    "tracker_noise": "look for vibration, draught, sun on the beam and dirty reflectors",
    "joint_offset": "read the base reflectors again, as the tracker may have moved",
    "base_moved": "see what holds robot and tracker, and read the base reflectors again",
    "base_growth": "read the temperature of the base, and check the tracker by a known length",
    "target_moved": "see whether its nest is loose, and measure the distances between the targets "
    "again before the next pose",
    "base_rotation": "read the base reflectors again, as the tracker may have moved",
    "scale_zero": "unload the scale and read it empty before the next pull",
    "scale_gain": "have the scale calibrated",
    "scale_curvature": "have the scale calibrated over its range",
    "scale_hysteresis": "pull up only, or have the scale checked: unloading it reads otherwise",
    "force_noise": "read the scale when the chain hangs still",
    "heavy_tails": "see that every reflector sits well and nothing cuts the beam",
    "scattered": "see that every reflector sits well and nothing cuts the beam",
    "beyond_noise": "look for vibration, draught, sun on the beam and dirty reflectors",
}
"""What to do at the robot, by cause or by finding of the diagnosis; of others it is said what would
settle them, and causes in the robot itself need no action."""

_OF_THE_ROBOT = ("rail", "base", "joint", "link", "tool", "shoulder", "wrist")
"""Places of causes in the robot itself."""


def _warnings(answer: Answer, robot: Robot) -> Iterator[str]:
    own = {str(one.name) for one in catalogue(robot) if one.place in _OF_THE_ROBOT}
    for one in answer.diagnosis.causes:
        if one.evidence is None and (one.probability or 0.0) >= _LIKELY:
            then = _advice(one, str(one.name) in own)
            yield f"{_named(one)}, probability {one.probability:.2f}{then}."
    for reason in answer.diagnosis.reasons:  # of these no cause is stated
        if done := _ADVICE.get(str(reason)):
            yield f"{str(reason).replace('_', ' ').capitalize()}: {done}."


def _named(cause: Cause) -> str:
    """`Joint tilt (4)`, and since when."""
    at = f" ({cause.where})" if cause.where is not None else ""
    at += f" {cause.form}" if (cause.form or "").startswith("since") else ""
    return str(cause.name).replace("_", " ").capitalize() + at


def _advice(cause: Cause, of_robot: bool) -> str:
    """What to do about a cause, or what would settle it."""
    of_scale = cause.where == "scale"  # a law of the scale that is not in the catalogue
    done = _ADVICE.get("scale_zero" if of_scale else str(cause.name))
    if done:
        return f": {done}"
    if of_robot:
        return ", of the robot itself"
    return f"; what would settle it: {cause.needs}" if cause.needs else ""


def _stiffness(answer: Answer) -> Iterator[_Open]:
    for one in answer.stiffness:
        axis = one.axis or one.joint_name
        yield _Open(one.name, axis, one.value, one.std, one.unit, one.relative_std)


# --- next poses -----------------------------------------------------------------------------------


def _left(campaign: Campaign, result: Result, done: Sequence[int]) -> list[_Next]:
    """Planned poses without readings, the most informative first."""
    log = campaign.raw.settings.joints
    if log.file not in campaign.files or not len(result.tables.get("forces", ())):
        return []
    robot = campaign.robot
    rows = logs.of_poses(logs.joints(log.file, campaign.files[log.file], robot, log))
    q = logs.joint_values(rows, robot)
    number = rows.number["pose"].astype(int)
    ahead = np.flatnonzero(~np.isin(number, list(done)))
    if not len(ahead):
        return []
    worth = _worth(result, q[ahead])
    return [
        _Next(
            pose=int(number[ahead[k]]),
            axes=_axes(campaign, q[ahead[k]]),
            worth=float(worth[k]) if np.isfinite(worth[k]) else None,
            text="planned; it determines a joint that nothing has determined"
            if not np.isfinite(worth[k])
            else f"planned; worth {worth[k]:.1f} bits",
        )
        for k in _first(worth)
    ]


def _first(worth: Array) -> Ints:
    """Order of poses by information, those that determine a further joint first."""
    return np.argsort(-np.where(np.isfinite(worth), worth, np.inf), kind="stable")


def _worth(result: Result, q: Array) -> Array:
    """Expected information of a pull in each pose, shape (m,) [bit].

    I = sum over three directions of 1/2 log2 det(1 + C / s^2), where C is the covariance of the
    deflection predicted under the largest force so far and s the noise of a coordinate; the
    direction of the chain is not yet known. Infinite if a joint acts that is not determined so far.
    """
    force = result.tables["forces"][["fx_n", "fy_n", "fz_n"]].to_numpy(dtype=float)
    most = float(np.linalg.norm(force, axis=1).max())
    fit = result.answer.fit
    noise = 1e-3 * float(fit.residual_std_mm or fit.rms_mm or 0.0) or np.inf
    model, bits = result.model.identified, np.zeros(len(q))
    for direction in np.eye(3):
        cov = model.predict(q, np.tile(most * direction, (len(q), 1)), None).cov
        known: Bools = np.asarray(np.isfinite(cov).reshape(len(q), -1).all(axis=1))
        shrunk = np.eye(3) + np.where(known[:, None, None], cov, 0.0) / noise**2
        bits += np.where(known, 0.5 * linear.log_det(shrunk) / np.log(2), np.inf)
    return bits


def _axes(campaign: Campaign, q: Array) -> tuple[tuple[str, float, str], ...]:
    """Joint values as the controller displays them."""
    of = axes.of(campaign.robot)
    values = of.values(q[None])[0]
    return tuple(
        (name, float(value if slides else np.rad2deg(value)), "m" if slides else "deg")
        for name, slides, value in zip(of.names, of.slides, values, strict=True)
    )


def _proposed(answer: Answer) -> Iterator[_Next]:
    """Poses proposed by the answer, if no planned ones remain."""
    for one in answer.diagnosis.next_poses:
        if not one.axes:
            continue
        at = tuple((axis.name, axis.value, axis.unit) for axis in one.axes)
        apart = " from ".join(one.separates)
        yield _Next(None, at, None, f"it tells {apart}")
    best = answer.diagnosis.best_pose
    if best is not None and best.axes and not answer.diagnosis.next_poses:
        at = tuple((axis.name, axis.value, axis.unit) for axis in best.axes)
        after = best.relative_std_after
        expected = "" if after is None else f", to {100 * after:.0f} %"
        yield _Next(None, at, None, f"it determines {best.name} best{expected}")


# --- when to stop ---------------------------------------------------------------------------------


def _stop(answer: Answer, poses: int, left: int, suspected: bool) -> _Stop:
    """Whether the decision about the tolerance is certain, so that measuring can stop."""
    asked = answer.tolerance
    if asked is None or asked.worst is None:
        return _Stop(now=False, text="campaign.toml states no tolerance: measure as planned")
    if suspected:
        return _Stop(now=False, text="first settle what is suspected")
    if poses < _FEWEST:
        earliest = f"pose {_FEWEST}"
        return _Stop(now=False, text=f"nothing is decided before {earliest}")
    if str(answer.diagnosis.verdict) not in {"adequate", "explained"}:
        return _Stop(now=False, text="the model does not explain the readings yet")
    decided = _decided(answer, asked)
    if decided is None:
        return _Stop(now=False, text="the tolerance is not decided with certainty yet")
    return _Stop(now=True, text=f"the tolerance is decided: {decided}", saved_poses=left)


def _decided(answer: Answer, asked: Tolerance) -> str | None:
    """Pass if d + 3 u <= T at every place asked, fail if d - 3 u > T at any place, else None."""
    tips: list[Tip] = [*asked.path.stretches] if asked.path else []
    if asked.test_pose and answer.test_pose:
        tips.append(answer.test_pose)
    d = np.array([tip.deflection_mm for tip in tips], dtype=float)  # None is nan
    u = np.nan_to_num(np.array([tip.std_mm for tip in tips], dtype=float), nan=np.inf)
    if (d - _CERTAIN * u > asked.deflection_mm).any():
        return "fail"
    return "pass" if len(d) and (d + _CERTAIN * u <= asked.deflection_mm).all() else None
