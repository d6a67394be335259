"""The paper's method, from its equations: numpy, nothing of the package.

Guerin, Caro, Garnier, Girin: dp = A x (Eq. 6, 7), f = |f| u along the chain (Eq. 10, 11), x = (B'
B)^-1 B' c (Eq. 19 to 21). About the frame of the tracker, the paper only says that quantities are
in F_b; here it is fitted to the base reflectors as a rigid body, with the mean of all their
readings.
"""

import csv
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.peers import arm as arms
from bench.peers.judge import laid


@dataclass(frozen=True)
class Pulls:
    """Pulls of a campaign, in F_b.

    Attributes:
        pose: Number of the pose, shape (m,).
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot [N], shape (m, 3).
        moved: Displacements of the reflectors [m], shape (m, t, 3).
        points: Reflectors in the flange frame [m], shape (t, 3).
        load: Load point in the flange frame [m], shape (3,).
    """

    pose: np.ndarray
    q: np.ndarray
    force: np.ndarray
    moved: np.ndarray
    points: np.ndarray
    load: np.ndarray


def rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file, by title."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def joint_values(path: Path, arm: arms.Arm) -> dict[int, np.ndarray]:
    """Joint values by pose [m] or [rad], from columns of joints or of the controller's axes."""
    out = {}
    for row in rows(path):
        named = {k: v for k, v in row.items() if k.endswith(("_m", "_deg", "_rad"))}
        values = [
            np.deg2rad(float(v)) if k.endswith("_deg") else float(v) for k, v in named.items()
        ]
        mapped = next(iter(named)).rpartition("_")[0] in arm.axes
        q = arm.by_axis @ values + arm.offset if mapped else np.array(values)
        out[int(row["pose"])] = q
    return out


def from_tracker(folder: Path, arm: arms.Arm) -> Pulls:
    """Pulls of tracker.csv and loads.csv, with groups named pose01_rep2_loaded."""
    said = tomllib.loads((folder / "campaign.toml").read_text("utf-8"))
    at: dict[str, dict[str, list[np.ndarray]]] = {}
    for row in rows(folder / "tracker.csv"):
        point = np.array([float(row[k]) for k in ("x_mm", "y_mm", "z_mm")]) / 1e3
        group = "base" if row["group"].startswith("base") else row["group"]
        at.setdefault(group, {}).setdefault(row["target"], []).append(point)
    known = said["base_frame"]
    seen = np.array([np.mean(at["base"][name], axis=0) for name in known])
    R, t = laid(seen, np.array([known[name] for name in known]))
    targets, q = said["naming"]["measured"], joint_values(folder / "joints.csv", arm)
    placed = {
        group: {name: np.mean(found, axis=0) @ R.T + t for name, found in here.items()}
        for group, here in at.items()
    }
    zero = {
        pose: np.mean(
            [[here[k] for k in targets] for group, here in placed.items()
             if group.startswith(f"pose{pose:02d}_") and group.endswith("_unloaded")], axis=0
        )
        for pose in q
    }  # fmt: skip
    pose, force, moved = [], [], []
    for row in rows(folder / "loads.csv"):
        number = int(row["pose"])
        here = placed[f"pose{number:02d}_rep{row['repeat']}_loaded"]
        along = here["Pl2"] - here["Pl1"]
        pose.append(number)
        force.append(float(row["force_n"]) * along / np.linalg.norm(along))
        moved.append(np.array([here[k] for k in targets]) - zero[number])
    points = np.array([said["tool"][k] for k in targets])
    return Pulls(
        np.array(pose), np.array([q[k] for k in pose]), np.array(force), np.array(moved), points,
        np.array(said["tool"]["load_point"]),
    )  # fmt: skip


def from_tables(folder: Path, arm: arms.Arm) -> Pulls:
    """Pulls of displacements.csv and forces.csv, which are already in F_b."""
    tool = tomllib.loads((folder / "campaign.toml").read_text("utf-8"))["tool"]
    q, moved = joint_values(folder / "joints.csv", arm), rows(folder / "displacements.csv")
    forces = rows(folder / "forces.csv")
    targets = list(dict.fromkeys(row["target"] for row in moved))
    by = {
        (row["pose"], row["repeat"], row["target"]): [float(row[f"d{k}_m"]) for k in "xyz"]
        for row in moved
    }
    pulled = [[by[row["pose"], row["repeat"], target] for target in targets] for row in forces]
    pose = np.array([int(row["pose"]) for row in forces])
    return Pulls(
        pose,
        np.array([q[k] for k in pose]),
        np.array([[float(row[f"f{k}_n"]) for k in "xyz"] for row in forces]),
        np.array(pulled),
        np.array([tool[target] for target in targets]),
        np.array(tool["load_point"]),
    )


def sensitivities(arm: arms.Arm, pulls: Pulls) -> np.ndarray:
    """A of Eq. (7) for every reflector, columns J_m,j (J_l,j' f), shape (m, t, 3, n)."""
    T = arms.frames(arm.table, arm.slides, pulls.q)
    axis, origin, flange = T[:, :, :3, 2], T[:, :, :3, 3], T[:, -1]

    def column(point: np.ndarray) -> np.ndarray:
        at = flange[:, :3, :3] @ point + flange[:, :3, 3]
        return np.where(arm.slides[:, None], axis, np.cross(axis, at[:, None] - origin))

    through = np.einsum("mjk,mk->mj", column(pulls.load), pulls.force)
    return np.stack(
        [np.einsum("mjk,mj->mkj", column(point), through) for point in pulls.points], axis=1
    )


def compliances(arm: arms.Arm, pulls: Pulls) -> np.ndarray:
    """Joint compliances [m/N] or [rad/(N m)] by Eq. (21), shape (n,)."""
    B = sensitivities(arm, pulls).reshape(-1, len(arm.table))
    return np.linalg.lstsq(B / np.linalg.norm(B, axis=0), pulls.moved.ravel())[0] / np.linalg.norm(
        B, axis=0
    )


def read(folder: Path, arm: arms.Arm) -> Pulls:
    """Pulls of a campaign's folder."""
    tracked = (folder / "tracker.csv").is_file()
    return from_tracker(folder, arm) if tracked else from_tables(folder, arm)


def main(robot: str, train: str, test: str, out: str) -> None:
    """Identify with one folder and predict the pulls of another."""
    arm = arms.read(Path(robot))
    x = compliances(arm, read(Path(train), arm))
    told = sensitivities(arm, read(Path(test), arm)) @ x
    np.savetxt(out, told.reshape(-1, 3), delimiter=",")


if __name__ == "__main__":
    main(*sys.argv[1:])
