"""The virtual cell: poses, pulls, schedule and true cell of a plan; random draws are readings.

All physics comes from `pipeline.machine.cell`; this file models the operator: choose an anchor,
tighten until the scale shows the step, read targets and chain, read the zeros again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.design.poses import default_anchors, draw_poses, nearest_in_reach
from pipeline.machine import cell as forward
from pipeline.machine.cell import Cell, Tool
from pipeline.machine.effect import Noise, Observation, Pulls
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.axes import from_log_units, in_log_units
from pipeline.simulate import noise
from pipeline.simulate.hidden import Planted, effects
from pipeline.simulate.loads import DOWN, PullLoads, run
from pipeline.simulate.plan import Plan, fitted

_CHAIN_POINTS_M = (0.1, 0.5)
"""Distance of Pl1 and Pl2 on the chain from the load point [m]."""


@dataclass(frozen=True, eq=False)
class _Schedule(Locked):
    """Times of all readings, in seconds after the first one.

    Attributes:
        base: Base reflectors at start and end, shape (2, b).
        zero: Targets unloaded, per pose before (and after) the pulls, shape (p, z, t).
        loaded: Targets, then the two points of the chain, per pull, shape (m, t + 2).
    """

    base: Array
    zero: Array
    loaded: Array


@dataclass(frozen=True, eq=False)
class Scene(Locked):
    """A virtual campaign without random errors, in F_b, SI.

    Attributes:
        plan: The plan.
        cell: The true cell: robot, true tool points, springs and planted effects.
        values: Parameters of all effects of `cell`, shape (k,).
        planted: The planted effects with their values.
        pulls: Nominal pulls, the force along the chain as the scale is intended to show it, m of
            them.
        stands: Each pose as its zero is read, p of them: its first pull, or no force where it is
            read unloaded only.
        run: The loads of the pulls.
        anchor: Anchor of each pose's chain [m], shape (p, 3).
        schedule: Times of the readings.
    """

    plan: Plan
    cell: Cell
    values: Array
    planted: tuple[Planted, ...]
    pulls: Pulls
    stands: Pulls
    run: PullLoads
    anchor: Array
    schedule: _Schedule

    def in_tracker(self, points: Array) -> Array:
        """Points of F_b (..., 3) in the frame of the tracker [m]."""
        return (points - np.array(self.plan.tracker.position)) @ axes(self.plan)


@dataclass(frozen=True, eq=False)
class Draws(Locked):
    """Readings of n campaigns of one scene, points in the frame of the tracker [m].

    Attributes:
        reading_n: Readings of the scale [N], shape (n, m).
        force_n: True force along the chain, as an exact scale would show it, F_b [N], shape
            (n, m, 3).
        gain_error: True relative gain error of the scale, shape (n,).
        base: Base reflectors at start and end, shape (n, 2, b, 3).
        zero: Unloaded targets, shape (n, p, z, t, 3).
        loaded: Loaded targets, shape (n, m, t, 3).
        chain: Pl1 and Pl2, shape (n, m, 2, 3).
    """

    reading_n: Array
    force_n: Array
    gain_error: Array
    base: Array
    zero: Array
    loaded: Array
    chain: Array


def build(
    plan: Plan, robot: Robot, rng: np.random.Generator, hidden: tuple[Planted, ...] = ()
) -> Scene:
    """Determine all true values of a campaign: poses, anchors, schedule, cell.

    Args:
        plan: The plan.
        robot: Its robot.
        rng: Draws poses, then deviations from nominal values.
        hidden: Effects in addition to those that the plan names.

    Raises:
        InputError: A pose, a load or an effect of the plan is impossible.
    """
    plan = fitted(plan, robot)
    for_poses, for_truth = rng.spawn(2)
    tool = Tool.of(plan.tool)
    q, anchor = _stand(plan, robot, tool, for_poses)
    planted = (*effects(plan.hidden.effects, robot), *hidden)
    stiffness, points = _true(plan, robot, np.vstack([tool.load_point, tool.points]), for_truth)
    truth = forward.paper_cell(robot, Tool(points[0], tool.targets, points[1:]))
    truth = replace(truth, equilibrium=plan.hidden.equilibrium)
    truth = truth.with_effects(*(one.effect for one in planted))
    values = np.concatenate([1 / stiffness, *(one.values for one in planted)])
    loads = run(plan, len(q), for_truth)
    schedule = _schedule(plan, loads.count)
    pose_of = np.repeat(np.arange(len(q)), loads.count)
    pulls = Pulls(
        pose=pose_of + 1,
        repeat=np.concatenate([np.arange(1, k + 1) for k in loads.count]),
        q=q[pose_of],
        force=np.zeros((len(pose_of), 3)),
        branch=loads.branch,
        approach=_approach(plan)[pose_of],
        time=schedule.loaded.mean(axis=1),
        time_zero=schedule.zero.mean(axis=(1, 2))[pose_of],
        by=loads.by,
        acts_at=loads.acts_at,
    )
    pulls = _along_chain(truth, values, pulls, loads.shown, anchor[pose_of])
    return Scene(
        plan=plan,
        cell=truth,
        values=values,
        planted=planted,
        pulls=pulls,
        stands=_stands(pulls, q, _approach(plan), schedule),
        run=loads,
        anchor=anchor,
        schedule=schedule,
    )


def _stands(pulls: Pulls, q: Array, approach: Array, schedule: _Schedule) -> Pulls:
    """Each pose as its zero is read, in order."""
    idle = np.setdiff1d(np.arange(len(q)), pulls.pose - 1)
    none, time = np.zeros(len(idle)), schedule.zero.mean(axis=(1, 2))[idle]
    alone = Pulls(
        pose=idle + 1,
        repeat=none.astype(np.int64),
        q=q[idle],
        force=np.zeros((len(idle), 3)),
        branch=none,
        approach=approach[idle],
        time=time,
        time_zero=time,
    )
    every = pulls.part(np.flatnonzero(pulls.repeat == 1)).and_then(alone)
    return every.part(np.argsort(every.pose, kind="stable"))


def draw(scene: Scene, rng: np.random.Generator, n: int = 1) -> Draws:
    """Readings of n campaigns with the same poses and truth, and independent random errors.

    The operator meets each step only approximately; the scale errs, so the acting force differs
    from its reading.
    """
    plan, m = scene.plan, len(scene.pulls)
    for_scale, for_tracker = rng.spawn(2)
    reading, gain_error, acting = _scale(scene, for_scale, n)
    pulls, load_point, loaded = _pulled(scene, acting)
    times = np.tile(scene.schedule.loaded, (n, 1))
    exact = [
        _base(scene)[None],
        _zeros(scene)[None],
        _observed(scene, pulls, loaded, times, plan.targets).reshape(n, m, -1, 3),
        _chain(scene, pulls, load_point, n).reshape(n, m, -1, 3),
    ]
    at = [scene.in_tracker(points) for points in exact]
    size = plan.tracker.noise_scale * _scaled(scene.cell, scene.values, "tracker")
    rigid = (False, *[plan.tracker.measures == "poses"] * 2, False)
    base, zero, loaded, chain = (
        _scattered(plan, np.broadcast_to(points, (n, *points.shape[1:])), size, part, pose)
        for points, part, pose in zip(at, for_tracker.spawn(4), rigid, strict=True)
    )
    return Draws(reading, pulls.force.reshape(n, m, 3), gain_error, base, zero, loaded, chain)


def _scattered(
    plan: Plan, points: Array, size: float, rng: np.random.Generator, pose: bool
) -> Array:
    """Points as read, each with its own error, or those of a pose with a common one."""
    if size == 0:
        return points
    if pose:
        middle = points.mean(axis=-2, keepdims=True)
        turn = plan.tracker.sigma_rad * rng.standard_normal(middle.shape)
        moved = noise.tracker_errors(plan.tracker.model, middle, rng)
        return points + size * (moved + np.cross(turn, points - middle))
    return points + size * noise.tracker_errors(plan.tracker.model, points, rng)


def _stand(plan: Plan, robot: Robot, tool: Tool, rng: np.random.Generator) -> tuple[Array, Array]:
    """Joint values (p, n) and anchor (p, 3) of every pose."""
    anchors = default_anchors(robot) if plan.pulls.anchors is None else np.array(plan.pulls.anchors)
    if plan.poses.q is None:
        which = _in_turn(plan, len(anchors))
        points = np.vstack([tool.load_point, tool.points])
        return draw_poses(robot, points, anchors, which, rng), anchors[which]
    q = _given(plan, robot)
    if plan.pulls.anchor is not None:
        return q, anchors[plan.pulls.anchor]
    at = configure(robot, q).points(tool.load_point[None])
    return q, anchors[nearest_in_reach(at[:, 0], anchors)]


def _in_turn(plan: Plan, anchors: int) -> Ints:
    """The anchor of each pose: as planned, else one after the other, cyclically."""
    if plan.pulls.anchor is not None:
        return np.array(plan.pulls.anchor)
    if plan.poses.count < anchors:
        return np.linspace(0, anchors - 1, plan.poses.count).round().astype(np.int64)
    return np.arange(plan.poses.count) % anchors


def _approach(plan: Plan) -> Array:
    """Alternating, shifted every sixth pose, so no anchor is approached from one side only."""
    if plan.poses.approach is not None:
        return np.array(plan.poses.approach, dtype=float)
    pose = np.arange(plan.poses.number)
    return np.where((pose + pose // 6) % 2 == 0, 1.0, -1.0)


def _given(plan: Plan, robot: Robot) -> Array:
    """The plan's own poses [m] or [rad], each checked against the robot.

    Raises:
        InputError: A pose has another number of joints, or is out of limits.
    """
    for number, row in enumerate(plan.poses.q or [], 1):
        if len(row) != robot.n:
            raise InputError(
                f"pose {number} has {len(row)} joint values, {robot.name} has {robot.n} joints",
                "give one value per joint",
                file="plan",
            )
    q = from_log_units(robot, np.array(plan.poses.q))
    outside = (q < robot.lower) | (q > robot.upper)
    if outside.any():
        pose, joint = np.argwhere(outside)[0]
        raise InputError(
            f"pose {pose + 1} puts joint {robot.joints[joint].name} at "
            f"{in_log_units(robot, q)[pose, joint]:g}, outside its limits",
            "move it inside",
            file="plan",
        )
    return q


def _true(plan: Plan, robot: Robot, points: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """True stiffnesses [N/m] or [N m/rad], (n,), and true points of the tool [m], (1 + t, 3).

    Raises:
        InputError: The plan states another number of stiffnesses.
    """
    wish = plan.hidden
    stiffness = 1 / robot.nominal_compliance if wish.stiffness is None else np.array(wish.stiffness)
    if len(stiffness) != robot.n:
        raise InputError(
            f"hidden.stiffness has {len(stiffness)} entries, {robot.name} has {robot.n} joints",
            "give one per joint",
            file="plan",
        )
    off, spread = wish.tool_sd_m, wish.stiffness_spread
    stiffness = stiffness * rng.uniform(1 - spread, 1 + spread, robot.n)
    return stiffness, points + off * rng.standard_normal(points.shape)


def _schedule(plan: Plan, count: Ints) -> _Schedule:
    """Lay out the readings in time: base, poses with zeros and `count` pulls each, base."""
    clock, t = plan.clock, len(plan.targets)
    zeros = 2 if plan.pulls.zero == "before_after" else 1
    one = clock.reading_s
    zero_s, pull_s = t * one, clock.pull_s + (t + 2) * one
    pose_s = clock.pose_s + count * pull_s + zeros * zero_s + (zeros - 1) * clock.pull_s
    before = np.cumsum(pose_s) - pose_s
    start = len(plan.base_frame) * one + before + clock.pose_s
    reading = one * np.arange(t + 2)
    pull = np.concatenate([np.arange(k) for k in count])
    loaded = np.repeat(start, count) + zero_s + clock.pull_s + pull_s * pull
    after = np.stack([np.zeros(len(count)), zero_s + count * pull_s + clock.pull_s], axis=1)
    zero = start[:, None, None] + after[:, :zeros, None] + reading[:t]
    ends = np.array([0.0, len(plan.base_frame) * one + pose_s.sum()])
    return _Schedule(
        base=ends[:, None] + one * np.arange(len(plan.base_frame)),
        zero=zero,
        loaded=loaded[:, None] + reading,
    )


def axes(plan: Plan) -> Array:
    """Axes of the tracker's frame in F_b as columns: yaw about z, pitch about y, roll about x."""
    at = [plan.tracker.yaw_deg, plan.tracker.pitch_deg, plan.tracker.roll_deg]
    return Rotation.from_euler("ZYX", at, degrees=True).as_matrix()


def _aimed(pulls: Pulls, size: Array, load_point: Array, anchor: Array) -> Pulls:
    """The pulls with forces of that size [N] from the load point to the anchor, both (m, 3).

    Weights pull down, wherever the load point is.
    """
    chain = np.where(pulls.pulled > 0, anchor - load_point, DOWN)
    unit = chain / np.linalg.norm(chain, axis=1, keepdims=True)
    return replace(pulls, force=size[:, None] * unit)


def _along_chain(cell: Cell, values: Array, pulls: Pulls, shown: Array, anchor: Array) -> Pulls:
    """Direct each force from the loaded (deflected) load point to the anchor."""
    at = configure(cell.robot, pulls.q).points(cell.tool.load_point[None])[:, 0]
    for _ in range(4):  # millimetres on metres of chain: three digits per iteration
        pulls = _aimed(pulls, shown, at, anchor)
        at = forward.predict(cell, pulls, values).load_point
    return pulls


def _pulled(scene: Scene, acting: Array) -> tuple[Pulls, Array, Array]:
    """True deflections under n campaigns' true chain forces (n, m) [N], without effects of reading.

    Returns:
        Pulls with the force along the chain, load point (n m, 3) and targets (n m, t, 3) in F_b.
    """
    n = len(acting)
    still, values = _still(scene)
    anchor = np.tile(scene.anchor[scene.pulls.pose - 1], (n, 1))
    nominal = np.linalg.norm(scene.pulls.force, axis=1)
    pulls = scene.pulls.under((acting / nominal)[..., None] * scene.pulls.force)
    at = forward.predict(still, pulls, values).load_point
    pulls = _aimed(pulls, acting.ravel(), at, anchor)
    moved = forward.predict(still, pulls, values)
    return pulls, moved.load_point, moved.loaded


def _scale(scene: Scene, rng: np.random.Generator, n: int) -> tuple[Array, Array, Array]:
    """Readings of the scale (n, m), its gain error (n,), forces along the chain (n, m)."""
    plan = scene.plan
    operator, gain, error = rng.spawn(3)
    nominal = np.linalg.norm(scene.pulls.force, axis=1)
    if plan.pulls.load != "chain":
        reading = np.tile(scene.run.shown, (n, 1))
        return reading, np.zeros(n), reading * scene.run.heavier
    reading = nominal + operator.normal(0.0, plan.pulls.setting_sd_n, (n, len(nominal)))
    reading = np.maximum(reading, 0.1 * nominal)
    if plan.tracker.decimals is not None:
        reading = np.round(reading, 2)
    drawn = gain.normal(0.0, plan.scale.gain_sigma, n)
    gain_error = drawn if plan.scale.gain_error is None else np.full(n, plan.scale.gain_error)
    size = plan.scale.noise_scale * _scaled(scene.cell, scene.values, "force_reading")
    zero = gain.normal(0.0, plan.scale.zero_sigma_n, (n, 1))
    acting = reading * (1 + gain_error[:, None]) + zero
    acting = acting + size * noise.scale_errors(plan.scale, reading, error)
    return reading, gain_error, acting


def _scaled(cell: Cell, values: Array, source: str) -> float:
    """Factor by which planted noise effects enlarge a source of error over the stated one."""
    factor = 1.0
    for effect, part in cell.split(values):
        if isinstance(effect, Noise) and source in effect.source_scaled:
            factor *= 1.0 + float(part.sum())
    return factor


def _still(scene: Scene) -> tuple[Cell, Array]:
    """The true cell without effects of reading: positions as they are, not as they are read."""
    parts = [(e, v) for e, v in scene.cell.split(scene.values) if not isinstance(e, Observation)]
    still = replace(scene.cell, effects=tuple(effect for effect, _ in parts))
    return still, np.concatenate([part for _, part in parts])


def _observed(
    scene: Scene,
    pulls: Pulls,
    points: Array,
    times: Array,
    names: list[str],
    instrument_only: bool = False,
) -> Array:
    """Points (m, t, 3) as they are read, each at its own time (m, >= t)."""
    seen = [
        (effect, part)
        for effect, part in scene.cell.split(scene.values)
        if isinstance(effect, Observation) and (effect.instrument or not instrument_only)
    ]
    if not seen:
        return points
    loaded = forward.load(scene.cell, pulls, scene.values)
    loaded = replace(loaded, targets=np.array(names, dtype=object), points=points)
    for effect, part in seen:
        read = [effect.observe(loaded, points, time, part) for time in times.T[: len(names)]]
        points = np.stack([at[:, k] for k, at in enumerate(read)], axis=1)
    return points


def _chain(scene: Scene, pulls: Pulls, load_point: Array, n: int) -> Array:
    """Pl1 and Pl2 as read, in F_b, shape (len(pulls), 2, 3).

    The force of a pull is by definition along the chain as read, so only the position is observed.
    """
    times = np.tile(scene.schedule.loaded[:, -2:].mean(axis=1, keepdims=True), (n, 1))
    at = _observed(scene, pulls, load_point[:, None], times, ["load_point"])
    unit = pulls.force / np.linalg.norm(pulls.force, axis=1, keepdims=True)
    return at + np.array(_CHAIN_POINTS_M)[:, None] * unit[:, None]


def _zeros(scene: Scene) -> Array:
    """Unloaded targets as read before and after the pulls, in F_b, shape (p, z, t, 3)."""
    still, values = _still(scene)
    pulls = scene.stands
    points = forward.predict(still, pulls, values).unloaded
    times = np.moveaxis(scene.schedule.zero, 1, 0)
    names = scene.plan.targets
    return np.stack([_observed(scene, pulls, points, time, names) for time in times], axis=1)


def _base(scene: Scene) -> Array:
    """Base reflectors as read at start and end, in F_b, shape (2, b, 3)."""
    points = np.array(list(scene.plan.base_frame.values())).reshape(-1, 3)
    pulls, names = scene.pulls.part(np.array([0, -1])), list(scene.plan.base_frame)
    both, times = np.stack([points, points]), scene.schedule.base
    return _observed(scene, pulls, both, times, names, instrument_only=True)
