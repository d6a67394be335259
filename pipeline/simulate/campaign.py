"""From a plan to the files of a complete raw campaign and the sealed truth."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import numpy as np

from pipeline.base import toml
from pipeline.base.arrays import Array, Parameter
from pipeline.base.errors import UsageError
from pipeline.base.strict import STANDARD_GRAVITY
from pipeline.machine.robot import SHIPPED, Robot
from pipeline.machine.robot import load as load_robot
from pipeline.machine.robot.axes import displayed, in_log_units
from pipeline.machine.robot.axes import of as axes_of
from pipeline.machine.surroundings import tooled
from pipeline.readers import OutgoingReadings, catalogue, text_of, writers
from pipeline.simulate.blunders import Notebook, controller_axes
from pipeline.simulate.hidden import Planted, blunders
from pipeline.simulate.noise import stated_covariance
from pipeline.simulate.plan import Plan, SpringScale
from pipeline.simulate.scene import Draws, Scene, axes, build, draw

_CHAIN = ["Pl1", "Pl2"]
"""Reflectors on the chain, which give the direction of the pull."""


@dataclass(frozen=True)
class RawCampaign:
    """The files that the operator takes home, and the truth that only the simulator knows.

    Attributes:
        name: Name of the campaign's folder.
        files: Content of every file of the raw folder, by name.
        truth: The true values, JSON-able; belongs outside the raw folder.
    """

    name: str
    files: Mapping[str, bytes]
    truth: Mapping[str, Any]


def simulate(
    plan: Plan,
    rng: np.random.Generator | None = None,
    robot: Robot | None = None,
    hidden: tuple[Planted, ...] = (),
) -> RawCampaign:
    """Run a virtual campaign.

    Args:
        plan: The measurements, and the true values.
        rng: Source of all draws; seeded by the plan when not given.
        robot: The robot, when it is not one that ships with the pipeline.
        hidden: Effects in addition to those that the plan names.

    Raises:
        InputError: A pose of the plan is out of limits, or no feasible one was found.
        UsageError: An effect or dialect has no such name.
    """
    for_scene, for_draw, for_blunders = (rng or np.random.default_rng(plan.seed)).spawn(3)
    robot = robot or load_robot(plan.robot)
    scene = build(plan, robot, for_scene, hidden)
    draws = draw(scene, for_draw)
    notes, done = _notebook(scene, draws), []
    for one in blunders(plan.hidden.effects, robot):
        notes, where = one.blunder.act(notes, one.where, one.size, for_blunders)
        done.append(
            _effect(one.blunder.called or one.blunder.name, where, one.blunder.size, one.size)
        )
    return RawCampaign(plan.name, _written(scene, notes), _truth(scene, draws, done))


_TO_FILL = b"""
[base_frame]
# B1 = ?                    # fixed reflectors, coordinates in F_b [m]: x, y, z; three or more
"""


def prepared(plan: Plan, robot: Robot) -> dict[str, bytes]:
    """The files of a campaign before it is measured; forces and tracker export are still missing.

    Args:
        plan: The measurements.
        robot: Its robot.

    Raises:
        InputError: A pose of the plan is out of limits, or no feasible one was found.
    """
    scene = build(plan, robot, np.random.default_rng(plan.seed))
    plan = scene.plan
    settings = _campaign_toml(plan, plan.robot, simulated=False)
    if "base_frame" not in plan.model_fields_set:
        bare = plan.model_copy(update={"base_frame": {}})
        settings = _campaign_toml(bare, plan.robot, simulated=False) + _TO_FILL
    files = {
        "campaign.toml": settings,
        "loads.csv": _loads(scene, [""] * len(scene.pulls)),
        "joints.csv": _axes(scene),
    }
    return files | ({} if plan.robot in SHIPPED else {"robot.toml": robot.text.encode()})


def raw_files(scene: Scene, draws: Draws, which: int = 0) -> dict[str, bytes]:
    """The files of one of the drawn campaigns, without blunders."""
    return _written(scene, _notebook(scene, draws, which))


def _notebook(scene: Scene, draws: Draws, which: int = 0) -> Notebook:
    """The data of one drawn campaign that the operator has to write down."""
    robot, q = scene.cell.robot, scene.stands.q
    return Notebook(
        robot=scene.plan.robot,
        robot_text=robot.text,
        targets=tuple(scene.plan.targets),
        tool=scene.plan.tool,
        readings=_readings(scene, draws, which),
        reading_n=draws.reading_n[which],
        prismatic=robot.prismatic,
        joints=in_log_units(robot, q),
        controller=controller_axes(robot, q),
    )


def _written(scene: Scene, notes: Notebook) -> dict[str, bytes]:
    """The files of a notebook.

    Raises:
        UsageError: There is no such dialect, or it cannot be written.
    """
    tracker = scene.plan.tracker
    reader = catalogue().get(tracker.dialect)
    if reader is None or reader.write is None:
        known = ", ".join(writers())
        raise UsageError(f'there is no dialect "{tracker.dialect}"; choose from {known}.')
    shown = _shown(scene, notes.reading_n)
    files = {
        "campaign.toml": _campaign_toml(
            scene.plan.model_copy(update={"tool": notes.tool}), notes.robot
        ),
        f"tracker{reader.suffix}": reader.write(notes.readings, tracker.unit, tracker.decimals),
        "loads.csv": _loads(scene, shown),
        "joints.csv": _joints(scene, notes.joints),
    }
    if not reader.says_names:
        files["assignment.csv"] = _assignment(notes.readings)
    if notes.robot not in SHIPPED:
        files["robot.toml"] = notes.robot_text.encode()
    return files


def _assignment(readings: OutgoingReadings) -> bytes:
    """Group and target of each reading, for exports that contain numbers only."""
    order = range(1, len(readings.group) + 1)
    return _csv("order,group,target", zip(order, readings.group, readings.target, strict=True))


def _csv(head: str, rows: Iterable[Iterable[object]]) -> bytes:
    lines = [head, *(",".join(map(str, row)) for row in rows), ""]
    return "\n".join(lines).encode()


def _readings(scene: Scene, draws: Draws, which: int = 0) -> OutgoingReadings:
    """All readings of one drawn campaign in chronological order."""
    plan = scene.plan
    named = _names(scene)
    ends = _ends(plan)
    loaded = np.concatenate([draws.loaded[which], draws.chain[which][:, : len(ends)]], axis=1)
    xyz = np.concatenate([a.reshape(-1, 3) for a in (draws.base[which], draws.zero[which], loaded)])
    until = len(plan.targets) + len(ends)
    times = (scene.schedule.base, scene.schedule.zero, scene.schedule.loaded[:, :until])
    time = np.concatenate([t.ravel() for t in times])
    order = np.argsort(time, kind="stable")
    stated = stated_covariance(plan.tracker.model, xyz[order]) if plan.tracker.stated else None
    return OutgoingReadings(
        group=[named[i][0] for i in order],
        target=[named[i][1] for i in order],
        position=xyz[order],
        time=[plan.clock.start + timedelta(seconds=float(t)) for t in time[order]],
        covariance=stated,
    )


def _names(scene: Scene) -> list[tuple[str, str]]:
    """Group and target of every reading, in the order of the draws.

    Groups read before the pulls have the number 0, those after them one more than the last pull.
    """
    base, targets, pulls = scene.plan.base_frame, scene.plan.targets, scene.pulls
    wide = max(2, len(str(len(scene.anchor))))
    after = np.bincount(pulls.pose, minlength=len(scene.anchor) + 1) + 1
    numbers = [(k, (0, after[k])[: scene.schedule.zero.shape[1]]) for k in scene.stands.pose]
    unloaded = [f"pose{k:0{wide}d}_rep{n}_unloaded" for k, both in numbers for n in both]
    each = zip(pulls.pose, pulls.repeat, strict=True)
    loaded = [f"pose{k:0{wide}d}_rep{n}_loaded" for k, n in each]
    return [
        *itertools.product(("base_start", "base_end"), base),
        *itertools.product(unloaded, targets),
        *itertools.product(loaded, [*targets, *_ends(scene.plan)]),
    ]


def _ends(plan: Plan) -> list[str]:
    """Reflectors on the chain, if there is one."""
    return _CHAIN if plan.pulls.load == "chain" else []


def _shown(scene: Scene, reading_n: Array) -> list[str]:
    """The operator's note of each load: newtons of a scale, kilograms of a weight."""
    pulls, digits = scene.plan.pulls, 2 if scene.plan.tracker.decimals is not None else None
    if pulls.load == "weights":  # the mass as stated, not a reading
        return [f"{mass:.9g}" for mass in reading_n / STANDARD_GRAVITY]
    return [text for (text,) in text_of(reading_n[:, None], digits)]


def _loads(scene: Scene, shown: Sequence[str]) -> bytes:
    pulls, load = scene.pulls, scene.plan.pulls.load
    branch = np.where(pulls.branch > 0, "up", "down")
    if load == "payloads":
        named = zip(pulls.pose, pulls.repeat, scene.run.what, strict=True)
        return _csv("pose,repeat,payload", named)
    if load == "weights":
        sigma = [scene.plan.pulls.mass_sigma_kg] * len(pulls)
        hung = zip(pulls.pose, pulls.repeat, shown, sigma, branch, strict=True)
        return _csv("pose,repeat,mass_kg,mass_sigma_kg,branch", hung)
    rows = zip(pulls.pose, pulls.repeat, shown, branch, strict=True)
    return _csv("pose,repeat,force_n,branch", rows)


def _joints(scene: Scene, logged: Array) -> bytes:
    joints, stands = scene.cell.robot.joints, scene.stands
    head = ["pose", *(f"{j.name}_{'m' if j.prismatic else 'deg'}" for j in joints), "approach"]
    q = text_of(logged, None if scene.plan.tracker.decimals is None else 6)
    rows = zip(stands.pose, q, stands.approach.astype(int), strict=True)
    return _csv(",".join(head), ((pose, *values, way) for pose, values, way in rows))


def _axes(scene: Scene) -> bytes:
    """The poses as the controller shows its axes, mm and degrees."""
    robot, stands = scene.cell.robot, scene.stands
    units = ["mm" if slide else "deg" for slide in axes_of(robot).slides]
    names = [f"{n}_{u}" for n, u in zip(axes_of(robot).names, units, strict=True)]
    rows = zip(
        stands.pose,
        text_of(displayed(robot, stands.q), 6),
        stands.approach.astype(int),
        strict=True,
    )
    head = ",".join(["pose", *names, "approach"])
    return _csv(head, ((pose, *values, way) for pose, values, way in rows))


def _campaign_toml(plan: Plan, robot: str, simulated: bool = True) -> bytes:
    reader = catalogue()[plan.tracker.dialect]
    content = {
        "format": 1,
        "name": plan.name,
        "robot": robot if robot in SHIPPED else "robot.toml",
        "simulated": simulated or None,
        "tracker": {
            "files": [f"tracker{reader.suffix}"],
            "unit": None if reader.says_unit else plan.tracker.unit,
            "assignment": None if reader.says_names else "assignment.csv",
            **(_stated(plan) if plan.tracker.stated else {"covariance": "none"}),
        },
        **_instrument(plan),
        "naming": {"measured": plan.targets, "chain": _ends(plan) or None},
        "base_frame": plan.base_frame,
        **_loaded_by(plan),
        "joints": {"file": "joints.csv"},
        **tooled(plan.tool, plan),
        "test_pose": plan.test_pose and plan.test_pose.model_dump(),
    }
    return toml.dumps(toml.given(content)).encode()


def _instrument(plan: Plan) -> dict[str, Any]:
    """Table [instrument], where it is not a laser tracker that measures points."""
    stated = plan.tracker.model_dump(include={"kind", "measures"}, exclude_defaults=True)
    if plan.tracker.measures == "poses" and plan.tracker.stated:
        stated["sigma_rad"] = plan.tracker.sigma_rad
    return {"instrument": stated} if stated else {}


def _loaded_by(plan: Plan) -> dict[str, Any]:
    """The tables of campaign.toml for the loads; weights have none."""
    if plan.pulls.load == "payloads":
        return {"payload": {name: one.model_dump() for name, one in plan.payload.items()}}
    if plan.pulls.load == "weights":
        return {}
    return {"scale": {"file": "loads.csv", **_certified(plan.scale)}}


def _certified(scale: SpringScale) -> dict[str, float]:
    """Values of the scale's certificate; the zero only if it is stated."""
    stated = scale.model_dump(include={"sigma_n", "sigma_rel", "gain_sigma", "zero_sigma_n"})
    return {key: value for key, value in stated.items() if value or key != "zero_sigma_n"}


def _stated(plan: Plan) -> dict[str, Any]:
    """Noise entries of [tracker]."""
    model = plan.tracker.model
    if isinstance(model, float):
        return {"sigma_m": model}
    return {"noise": model if isinstance(model, str) else model.model_dump()}


def _truth(scene: Scene, draws: Draws, done: list[dict[str, Any]]) -> dict[str, Any]:
    """The truth of the first drawn campaign and its blunders, in SI, JSON-able."""
    plan, robot = scene.plan, scene.cell.robot
    stiffness = 1 / scene.values[: robot.n]
    pulled = (scene.pulls.pose, scene.pulls.repeat, draws.force_n[0])
    return {
        "format": 1,
        "campaign": plan.name,
        "robot": plan.robot,
        "plan": plan.model_dump(mode="json"),
        "stiffness": [
            {"joint": i + 1, "name": f"k_{joint.name}", "unit": joint.stiffness_unit, "value": k}
            for i, (joint, k) in enumerate(zip(robot.joints, stiffness.tolist(), strict=True))
        ],
        "effects": [
            *(
                _effect(one.effect.name, one.effect.where, one.effect.parameters, one.values)
                for one in scene.planted
            ),
            *done,
        ],
        "equilibrium": scene.cell.equilibrium,
        "tool": {name: at.tolist() for name, at in scene.cell.tool.named.items()},
        "tracker": {
            "position_m": list(plan.tracker.position),
            "axes": axes(plan).tolist(),
            "noise_scale": plan.tracker.noise_scale,
        },
        "scale": {
            "gain_error": float(draws.gain_error[0]),
            "noise_scale": plan.scale.noise_scale,
        },
        "pulls": [
            {"pose": pose, "repeat": repeat, "force_n": force}
            for pose, repeat, force in zip(*(one.tolist() for one in pulled), strict=True)
        ],
    }


def _effect(
    name: str, where: int | str | None, parameters: tuple[Parameter, ...], values: Array
) -> dict[str, Any]:
    return {
        "name": name,
        "where": where,
        "parameters": [
            {"name": p.name, "unit": p.unit, "value": value}
            for p, value in zip(parameters, values.tolist(), strict=True)
        ],
    }
