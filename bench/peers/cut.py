"""Campaigns split into training and held-out data, for the package and for its peers."""

import csv
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.peers import arm as arms
from bench.peers import springs
from bench.peers.urdf import urdf

HERE = Path(__file__).parents[2]
RAW, ROBOTS = HERE / "data/raw", HERE / "pipeline/machine/robot"
FIFTH, RUN = 5, 10
"""Every fifth pose is held out. Ten held-out poses in the order of measurement form a cluster:
their errors come from neighbouring hours, and resampling them individually would hide that."""
POSE = ("x1", "y1", "z1", "phix1", "phiy1", "phiz1")
"""FIGAROH's names of the measured quantities [m], [rad, roll, pitch and yaw]."""


@dataclass(frozen=True)
class Positions:
    """Positions of targets, split in two.

    Attributes:
        name: Name of the trial.
        said: Training and held-out data, in words.
        campaign: Folder under data/raw.
        robot: Its robot file.
        teaches: Which rows of each file are for training, by file; other files are left out.
        held: The file whose other rows are held out.
    """

    name: str
    said: str
    campaign: str
    robot: Path
    teaches: dict[str, Callable[[int], bool]]
    held: str


@dataclass(frozen=True)
class Loads:
    """Pulls of a campaign, with poses held out in turn.

    Attributes:
        name: Name of the campaign under data/raw.
        said: Description.
        robot: Its robot file.
        folds: Number of parts; a pose belongs to the part of its number's remainder.
    """

    name: str
    said: str
    robot: Path
    folds: int


SERIES_B, SERIES_C = "series_b_joint_configurations.csv", "series_c_random_poses.csv"
TRIALS = (
    Positions(
        "ur5_fifth", "UR5, every fifth pose of the grid", "ur5_tsinghua",
        RAW / "ur5_tsinghua/ur5.toml", {"positions.csv": lambda row: row % FIFTH != 0},
        "positions.csv",
    ),
    Positions(
        "ur10_fifth", "UR10, every fifth pose of series C", "ur10_ipa", ROBOTS / "ur10.toml",
        {SERIES_C: lambda row: row % FIFTH != 0}, SERIES_C,
    ),
    Positions(
        "ur10_series", "UR10, series C by series B", "ur10_ipa", ROBOTS / "ur10.toml",
        {SERIES_B: lambda row: True}, SERIES_C,
    ),
)  # fmt: skip
KR500 = ROBOTS / "kr500_rail.toml"
LOADS = (
    Loads("kr500_demo", "KR500 on a rail, simulated, no cause hidden", KR500, 4),
    Loads("kr500_first", "KR500 on a rail, simulated, a rolling carriage", KR500, 4),
    Loads("fanuc_r2000ic", "FANUC R-2000iC, measured", ROBOTS / "fanuc_r2000ic.toml", 5),
)


def lines(path: Path) -> tuple[bytes, list[bytes]]:
    """Head and rows of a file, byte for byte."""
    head, *rest = path.read_bytes().splitlines(keepends=True)
    return head, rest


def positions(trial: Positions, root: Path, folder: Path) -> np.ndarray:
    """Write a trial: a campaign under `root`, poses to predict, and the same for the peers.

    Args:
        trial: The trial.
        root: Root of a project, for `pipeline`.
        folder: For train.csv, test.csv and robot.urdf of the peers, and poses.csv of `pipeline`.

    Returns:
        Positions measured at the held-out poses [m], shape (m, 3).
    """
    raw, arm = RAW / trial.campaign, arms.read(trial.robot)
    there = root / "data/raw" / trial.name
    there.mkdir(parents=True, exist_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    for file, keeps in trial.teaches.items():
        head, rest = lines(raw / file)
        (there / file).write_bytes(head + b"".join(r for k, r in enumerate(rest) if keeps(k)))
    said = (raw / "campaign.toml").read_text("utf-8")
    for path in raw.glob("*.toml"):
        (there / path.name).write_bytes(path.read_bytes())
    (there / "campaign.toml").write_text(_of_files(said, set(trial.teaches)), "utf-8")
    train = np.vstack([_table(raw / file, arm)[_kept(raw / file, keeps)]
                       for file, keeps in trial.teaches.items()])  # fmt: skip
    other = trial.teaches.get(trial.held, lambda row: False)
    test = _table(raw / trial.held, arm)[~_kept(raw / trial.held, other)]
    for name, rows in (("train.csv", train), ("test.csv", test)):
        _write(folder / name, (*POSE, *arm.axes), rows)
    _write(folder / "poses.csv", [f"{name}_rad" for name in arm.axes], test[:, 6:])
    (folder / "robot.urdf").write_text(urdf(arm), "utf-8")
    return test[:, :3]


def _of_files(said: str, files: set[str]) -> str:
    """campaign.toml without the files that are not used for training."""
    named = re.search(r"^files = \{(.*)\}$", said, re.MULTILINE)
    if named is None:
        return said
    kept = [one for one in named[1].split(",") if any(file in one for file in files)]
    return said.replace(named[0], f"files = {{{','.join(kept)} }}")


def _kept(path: Path, keeps: Callable[[int], bool]) -> np.ndarray:
    return np.array([keeps(k) for k in range(len(lines(path)[1]))])


def _table(path: Path, arm: arms.Arm) -> np.ndarray:
    """Positions [m], roll, pitch, yaw [rad] (NaN if not measured) and joint values [rad]."""
    tracker = path.read_text("utf-8-sig").partition("\n")[0].count(";") > 0
    with path.open(encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file, delimiter=";" if tracker else ","))
    if not tracker:
        at = [[float(row[f"{k}_mm"]) / 1e3 for k in "xyz"] for row in rows]
        q = [[np.deg2rad(float(row[f"{name}_deg"])) for name in arm.axes] for row in rows]
        return np.hstack([at, np.full((len(rows), 3), np.nan), q])
    number = {
        k: [float(row[k].replace(",", ".")) for row in rows] for k in rows[0] if k != "Timestamp"
    }
    at = np.column_stack([number[f"measurement_{k}"] for k in "xyz"]) / 1e3
    turn = np.column_stack([number[f"measurement_r{k}"] for k in "xyz"])
    rpy = Rotation.from_euler("XYZ", turn, degrees=True).as_euler("xyz")
    return np.hstack([at, rpy, np.column_stack([number[name] for name in arm.axes])])


def _write(path: Path, names: tuple[str, ...] | list[str], rows: np.ndarray) -> None:
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=",".join(names), comments="")


def clusters(trial: Positions, held: int) -> np.ndarray:
    """Cluster of each held-out pose, in the order of measurement."""
    return np.arange(held) // RUN


def loads(trial: Loads, fold: int, root: Path, folder: Path) -> springs.Pulls:
    """Write one part of a campaign of pulls: training data under `root`, all data for the peers.

    Returns:
        The held-out pulls.
    """
    raw, name = RAW / trial.name, f"{trial.name}_{fold}"
    for out, mine in ((root / "data/raw" / name, False), (folder / f"{name}_test", True)):
        out.mkdir(parents=True, exist_ok=True)
        (out / "campaign.toml").write_bytes((raw / "campaign.toml").read_bytes())
        for path in raw.glob("*.csv"):
            head, rest = lines(path)
            kept = (r for r in rest if _of(path, r, fold, trial.folds) in (mine, None))
            (out / path.name).write_bytes(head + b"".join(kept))
    arm = arms.read(trial.robot)
    held = springs.read(folder / f"{name}_test", arm)
    pulled = np.hstack([np.repeat(held.q, 2, axis=0), np.zeros((2 * len(held.q), 3))])
    pulled[1::2, -3:] = held.force
    slides = [
        f"{one['name']}_{'m' if s else 'rad'}" for one, s in zip(arm.rows, arm.slides, strict=True)
    ]
    _write(folder / f"{name}.csv", [*slides, "fx_n", "fy_n", "fz_n"], pulled)
    return held


def _of(path: Path, row: bytes, fold: int, folds: int) -> bool | None:
    """Whether a row belongs to a held-out pose; None if it belongs to all (base readings)."""
    first = row.split(b",")[0].decode()
    if path.name == "tracker.csv":
        found = re.match(r"pose(\d+)_", first)
        return None if found is None else (int(found[1]) - 1) % folds == fold
    return (int(first) - 1) % folds == fold if first.isdigit() else None
