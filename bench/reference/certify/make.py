"""How the data of the reference campaigns were drawn: `python -m bench.reference.certify.make`.

Kept as a record of the origin of the files; drawing again gives the same files. Seed k belongs to
case k. What is drawn here does not enter the certified values, which depend on the files alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpmath import mpf

from bench.reference.certify import kinematics as kin
from bench.reference.certify.campaign import ROBOTS

CASES = Path(__file__).parents[1] / "cases"

TOOL = {
    "load_point": (0.15, 0.0, 0.25),
    "P1": (0.20, 0.05, 0.12),
    "P2": (-0.12, 0.19, 0.10),
    "P3": (-0.10, -0.18, 0.22),
}
KR500, FANUC = "kr500_rail", "fanuc_r2000ic"
RANGES = {
    KR500: ((1, 17), (-60, 60), (0, 90), (0, 120), (-150, 150), (-100, 100), (-150, 150)),
    FANUC: ((-90, 90), (-40, 40), (-50, 50), (-150, 150), (-100, 100), (-150, 150)),
}
"""Ranges from which joint values are drawn, metres and degrees."""

STIFF = {
    KR500: (8.0e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5),
    FANUC: (1.1e6, 9.0e5, 8.0e5, 4.0e5, 3.0e5, 2.0e5),
}
"""True stiffnesses before they are varied by a quarter [N/m or N m/rad]."""

TRACKER = '[tracker]\nfiles = ["tracker.csv"]\nsigma_m = 3e-5'
CHAIN = (0.1, 0.5)
"""Distance of both chain reflectors from the load point along the chain [m]."""


@dataclass(frozen=True)
class Draw:
    """Parameters of a case.

    Attributes:
        robot: Name of the robot file.
        poses: Number of poses.
        pulls: Number of pulls of each pose.
        noise_m: Standard deviation of a reading, or of a displacement [m].
        digits: Decimals of a displacement in metres.
        narrow: Half width of a joint's range about zero, by its number from 0 [deg].
        force_n: Range of the force, log-uniform [N].
        softer: Divisor of the stiffnesses.
        spread: Powers of ten by which compliances are varied.
    """

    robot: str = KR500
    poses: int = 8
    pulls: int = 1
    noise_m: float = 3e-5
    digits: int = 7
    narrow: tuple[tuple[int, float], ...] = ()
    force_n: tuple[float, float] = (800.0, 3000.0)
    softer: float = 1.0
    spread: float = 0.0


class _Case:
    """A random machine and its campaign."""

    def __init__(self, draw: Draw, seed: int) -> None:
        self.draw, self.rng = draw, np.random.default_rng(seed)
        self.robot = kin.read(ROBOTS / f"{draw.robot}.toml")
        ranges = np.array(RANGES[draw.robot], dtype=float)
        for joint, half in draw.narrow:
            ranges[joint] = -half, half
        low, high = ranges.T
        q = self.rng.uniform(low, high, (draw.poses, len(low)))
        self.shown = np.round(q, 6)
        n = len(low)
        factor = 10 ** self.rng.uniform(-draw.spread, draw.spread, n)
        x = factor * draw.softer / (np.array(STIFF[draw.robot]) * self.rng.uniform(0.75, 1.25, n))
        self.x = [mpf(float(v)) for v in x]

    def q(self, pose: int) -> list[mpf]:
        pairs = zip(self.robot.rows, self.shown[pose].tolist(), strict=True)
        return [mpf(v) if row.slides else kin.degrees(v) for row, v in pairs]

    def force(self) -> np.ndarray:
        u = self.rng.normal(size=3)
        size = np.exp(self.rng.uniform(*np.log(self.draw.force_n)))
        return np.round(size * u / np.linalg.norm(u), 4)

    def points(self, pose: int, force: np.ndarray) -> dict[str, np.ndarray]:
        """All points of the tool under a force, F_b [m]."""
        f = [mpf(float(v)) for v in force]
        load_point = [mpf(v) for v in TOOL["load_point"]]
        flange = kin.at_rest(self.robot, self.q(pose), self.x, load_point, f)[-1]
        return {
            name: np.array([float(v) for v in kin.at(flange, [mpf(v) for v in place])])
            for name, place in TOOL.items()
        }

    def noisy(self, point: np.ndarray) -> np.ndarray:
        return point + self.rng.normal(0, self.draw.noise_m, 3)


def _joints(case: _Case) -> str:
    names = [f"{row.name}_{'m' if row.slides else 'deg'}" for row in case.robot.rows]
    body = [",".join([str(k + 1), *(f"{v:.6f}" for v in row)]) for k, row in enumerate(case.shown)]
    return "\n".join([",".join(["pose", *names]), *body]) + "\n"


def _toml(name: str, robot: str, *parts: str) -> str:
    points = [f"{point} = {list(place)}" for point, place in TOOL.items()]
    head = ["format = 1", f'name = "{name}"', f'robot = "{robot}"']
    return "\n".join([*head, *parts, "[tool]", *points]) + "\n"


def reduced(name: str, draw: Draw, seed: int, *parts: str, stated: str = "") -> dict[str, str]:
    """Files with displacements and forces."""
    case = _Case(draw, seed)
    moved, forces = ["pose,repeat,target,dx_m,dy_m,dz_m"], ["pose,repeat,fx_n,fy_n,fz_n"]
    for pose in range(draw.poses):
        rest = case.points(pose, np.zeros(3))
        for pull in range(1, draw.pulls + 1):
            force = case.force()
            bent = case.points(pose, force)
            forces.append(f"{pose + 1},{pull}," + ",".join(f"{v:.4f}" for v in force))
            for target in list(TOOL)[1:]:
                d = case.noisy(bent[target] - rest[target])
                values = ",".join(f"{v:.{draw.digits}f}" for v in d)
                moved.append(f"{pose + 1},{pull},{target},{values}")
    files = '[displacements]\nfile = "displacements.csv"\nforces = "forces.csv"' + stated
    return {
        "campaign.toml": _toml(name, draw.robot, *parts, files),
        "joints.csv": _joints(case),
        "displacements.csv": "\n".join(moved) + "\n",
        "forces.csv": "\n".join(forces) + "\n",
    }


def read_in_base(name: str, draw: Draw, seed: int, scale: str, weights: bool) -> dict[str, str]:
    """Files with readings in F_b and the scale's log; with weights, every other load is one."""
    case = _Case(draw, seed)
    tracker = ["group,target,x_mm,y_mm,z_mm"]
    loads = ["pose,repeat,force_n,branch" + (",mass_kg,mass_sigma_kg" if weights else "")]

    def shoot(group: str, points: dict[str, np.ndarray]) -> None:
        for target, point in points.items():
            at = 1e3 * case.noisy(point)
            tracker.append(f"{group},{target}," + ",".join(f"{v:.4f}" for v in at))

    for pose in range(draw.poses):
        head, rest = f"pose{pose + 1:02d}_rep", case.points(pose, np.zeros(3))
        shoot(f"{head}0_unloaded", _targets(rest))
        for pull in range(1, draw.pulls + 1):
            kg = (120, 250)[pose % 2] if weights and pull % 2 == 0 else 0
            force = np.array([0, 0, -9.80665 * kg]) if kg else case.force()
            bent = case.points(pose, force)
            size = float(np.linalg.norm(force))
            ends = {
                f"Pl{k + 1}": bent["load_point"] + far * force / size for k, far in enumerate(CHAIN)
            }
            shoot(f"{head}{pull}_loaded", _targets(bent) | ({} if kg else ends))
            shown = "" if kg else f"{size + case.rng.normal(0, 2.0):.2f}"
            more = (f",{kg},0.05" if kg else ",,") if weights else ""
            loads.append(f"{pose + 1},{pull},{shown},{'' if kg else 'up'}{more}")
        shoot(f"{head}{draw.pulls + 1}_unloaded", _targets(rest))
    return {
        "campaign.toml": _toml(name, draw.robot, TRACKER, scale),
        "joints.csv": _joints(case),
        "tracker.csv": "\n".join(tracker) + "\n",
        "loads.csv": "\n".join(loads) + "\n",
    }


def _targets(points: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: point for name, point in points.items() if name != "load_point"}


BASE = {
    "B1": (0.6, -0.5, -0.30),
    "B2": (0.6, 18.5, -0.30),
    "B3": (-0.6, 18.5, -0.28),
    "B4": (-0.6, -0.5, -0.28),
    "B5": (1.4, 9.0, 0.35),
}
BEAM = {"range_m": 8e-6, "range_per_m": 0.3e-6, "transverse_m": 7.5e-6, "transverse_per_m": 3e-6}


def placing(name: str, seed: int) -> dict[str, str]:
    """Base reflectors read three times from a station beside the rail, and three poses."""
    case = _Case(Draw(poses=3), seed)
    u, _, v = np.linalg.svd(case.rng.normal(size=(3, 3)))
    axes = u @ v * np.linalg.det(u @ v)
    origin = np.array([6.5, 8.0, 0.7]) + case.rng.normal(0, 0.5, 3)
    lines = ["group,target,x_mm,y_mm,z_mm"]

    def shoot(group: str, target: str, point: np.ndarray) -> None:
        local = axes.T @ (point - origin)
        far = np.linalg.norm(local)
        beam = local / far
        e = case.rng.normal(0, BEAM["transverse_m"] + BEAM["transverse_per_m"] * far, 3)
        along = case.rng.normal(0, BEAM["range_m"] + BEAM["range_per_m"] * far)
        at = 1e3 * (local + e - beam * (beam @ e) + beam * along)
        lines.append(f"{group},{target}," + ",".join(f"{v:.4f}" for v in at))

    for turn in ("base_start", "base_mid", "base_end"):
        for target, place in BASE.items():
            shoot(turn, target, np.array(place))
    loads = ["pose,repeat,force_n,branch"]
    for pose in range(3):
        force = case.force()
        size = float(np.linalg.norm(force))
        bent = case.points(pose, force)
        for target, point in _targets(case.points(pose, np.zeros(3))).items():
            shoot(f"pose{pose + 1:02d}_rep0_unloaded", target, point)
        ends = {f"Pl{k + 1}": bent["load_point"] + f * force / size for k, f in enumerate(CHAIN)}
        for target, point in (_targets(bent) | ends).items():
            shoot(f"pose{pose + 1:02d}_rep1_loaded", target, point)
        loads.append(f"{pose + 1},1,{size:.2f},up")
    beam = ", ".join(f"{k} = {v}" for k, v in BEAM.items())
    frame = "\n".join(["[base_frame]", *(f"{k} = {list(v)}" for k, v in BASE.items())])
    tracker = f'[tracker]\nfiles = ["tracker.csv"]\nnoise = {{ {beam} }}'
    return {
        "campaign.toml": _toml(name, KR500, tracker, frame, "[scale]\nsigma_n = 2.0"),
        "joints.csv": _joints(case),
        "tracker.csv": "\n".join(lines) + "\n",
        "loads.csv": "\n".join(loads) + "\n",
    }


POSES = '[instrument]\nmeasures = "poses"\nsigma_rad = 3e-5'
DEFORMED = '[model]\nequilibrium = "deformed"'
STATED = "\nsigma_m = 2e-5"
PLAIN_SCALE = "[scale]\nsigma_n = 2.0\nsigma_rel = 0.001"
SCALE = PLAIN_SCALE + "\ngain_sigma = 0.005\nzero_sigma_n = 3.0"

DRAWN: dict[str, Callable[[str, int], dict[str, str]]] = {
    "plain": lambda n, k: reduced(n, Draw(poses=12), k),
    "few": lambda n, k: reduced(n, Draw(poses=3), k),
    "drowned": lambda n, k: reduced(n, Draw(noise_m=3e-2), k),
    "collinear": lambda n, k: reduced(n, Draw(noise_m=1e-9, digits=12, narrow=((5, 0.01),)), k),
    "scales": lambda n, k: reduced(
        n, Draw(noise_m=1e-7, digits=10, force_n=(0.5, 20000.0), spread=2.0, poses=12), k
    ),
    "floor": lambda n, k: reduced(n, Draw(FANUC, force_n=(200.0, 1500.0)), k),
    "poses": lambda n, k: reduced(n, Draw(pulls=2, noise_m=2e-5), k, POSES, stated=STATED),
    "zeros": lambda n, k: read_in_base(n, Draw(poses=4, pulls=3), k, PLAIN_SCALE, False),
    "common": lambda n, k: read_in_base(n, Draw(poses=4, pulls=3), k, SCALE, False),
    "weights": lambda n, k: read_in_base(n, Draw(poses=4, pulls=3), k, SCALE, True),
    "soft": lambda n, k: reduced(n, Draw(poses=6, softer=30.0), k, DEFORMED),
    "placing": placing,
}
"""The cases in order, each with the function that draws it."""


def main() -> None:
    """Draw all cases."""
    for k, (name, draw) in enumerate(DRAWN.items(), 1):
        for file, text in draw(name, k).items():
            path = CASES / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
