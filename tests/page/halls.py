"""Halls as their programs write: KUKA in workbooks, FANUC in inches, ABB, SpatialAnalyzer, Yaskawa.

The numbers are simulated; what a file looks like is a program's of somebody else.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from workbooks import workbook

from pipeline import simulate_campaign
from pipeline.machine.robot import axes, load

INCH, POUND = 0.0254, 4.4482216152605


@dataclass(frozen=True)
class Hall:
    """What comes from a hall.

    Attributes:
        robot: As `pipeline robot --list` has it.
        files: Dropped, by path in the folder.
        said: What somebody knows and types: key of campaign.toml, answer.
        unit: Of the coordinates that are typed.
        places: Points of tool and base [m].
    """

    robot: str
    files: dict[str, bytes]
    said: dict[str, str]
    unit: str
    places: dict[str, tuple[float, float, float]]


def _made(robot: str, seed: int) -> tuple[list[list[str]], list[list[str]], np.ndarray, dict]:
    """Rows of the export [mm] and of the scale [N], axes of the controller and places."""
    made = simulate_campaign(seed=seed, name="hall", robot=robot, poses=8)
    files = made.campaign.files
    tracker, loads, joints = (
        [line.split(",") for line in files[name].decode().splitlines()[1:]]
        for name in ("tracker.csv", "loads.csv", "joints.csv")
    )
    one = load(robot)
    q = np.array([[float(x) for x in row[1 : one.n + 1]] for row in joints])
    shown = axes.of(one).values(np.where(one.prismatic, q, np.deg2rad(q)))
    shown = np.where(axes.of(one).slides, shown, np.rad2deg(shown))
    settings = made.campaign.raw.settings
    return tracker, loads, shown, {**settings.tool, **settings.base_frame}


def _renamed(rows: list[list[str]], form: Callable[[int, int, bool], str]) -> list[list[str]]:
    """The groups by another name, of pose, pull and whether it is loaded."""
    out = []
    for group, target, *rest in rows:
        found = re.fullmatch(r"pose(\d+)_rep(\d+)_(\w+)", group)
        name = form(int(found[1]), int(found[2]), found[3] == "loaded") if found else group
        out.append([name, target, *rest])
    return out


def german() -> Hall:
    """KUKA; three workbooks with German titles, dates as they are written there."""
    tracker, loads, shown, places = _made("kr210_r2700_2", 21)
    rows = _renamed(tracker, lambda p, k, pull: f"Pose {p} {'Last' if pull else 'leer'} {k}")
    return Hall(
        "kr210_r2700_2",
        {
            "Messung Halle 3.xlsx": workbook(
                Punkte=[["Gruppe", "Punkt", "X [mm]", "Y [mm]", "Z [mm]"],
                        *[[g, t, float(x), float(y), float(z)] for g, t, x, y, z, _ in rows]]
            ),
            "Kraftmessung.xlsx": workbook(
                Kraft=[["Pose", "Wiederholung", "Kraft [N]"],
                       *[[int(p), int(k), float(f)] for p, k, f, *_ in loads]]
            ),
            "Achswerte.xlsx": workbook(
                Achsen=[["Pose", *(f"A{k} [°]" for k in range(1, 7))],
                        *[[i, *map(float, np.round(row, 4))] for i, row in enumerate(shown, 1)]]
            ),
        },
        {"sigma_n": "2,0", "sigma_m": "0,00003"}, "mm", places,
    )  # fmt: skip


def american() -> Hall:
    """FANUC; inches, pounds, a blank line and a remark above the titles."""
    tracker, loads, shown, places = _made("fanuc_r2000ic_165f", 22)
    rows = _renamed(tracker, lambda p, k, pull: f"P{p:02d}-{k}-{'LOAD' if pull else 'ZERO'}")
    inch = [[g, t, *(f"{float(x) / 1e3 / INCH:.6f}" for x in xyz)] for g, t, *xyz, _ in rows]
    return Hall(
        "fanuc_r2000ic_165f",
        {
            "points.csv": "\r\n".join(
                ["Group,Point,X (in),Y (in),Z (in)", *(",".join(row) for row in inch), ""]
            ).encode(),
            "pull log.csv": "\r\n".join(
                ["Pose,Pull,Force (lbf)",
                 *(f"{p},{k},{float(f) / POUND:.3f}" for p, k, f, *_ in loads), ""]
            ).encode(),
            "joints.csv": "\r\n".join(
                ["Pose,J1 (deg),J2 (deg),J3 (deg),J4 (deg),J5 (deg),J6 (deg)",
                 *(",".join([str(i), *(f"{x:.4f}" for x in row)])
                   for i, row in enumerate(shown, 1)), ""]
            ).encode(),
        },
        {"sigma_n": "2.0", "sigma_m": "0.00003"}, "in", places,
    )  # fmt: skip


def french() -> Hall:
    """ABB; semicolons and decimal commas, in the code page of an older Windows."""
    tracker, loads, shown, places = _made("irb6700_200_260", 23)
    rows = _renamed(tracker, lambda p, k, pull: f"pose {p} {'charge' if pull else 'vide'} {k}")

    def comma(x: float, digits: int) -> str:
        return f"{x:.{digits}f}".replace(".", ",")

    return Hall(
        "irb6700_200_260",
        {
            "relevé tracker.csv": "\r\n".join(
                ["groupe;cible;X [mm];Y [mm];Z [mm]",
                 *(";".join([g, t, *(comma(float(x), 4) for x in xyz)]) for g, t, *xyz, _ in rows),
                 ""]
            ).encode("cp1252"),
            "efforts.csv": "\r\n".join(
                ["pose;répétition;force [N]",
                 *(f"{p};{k};{comma(float(f), 2)}" for p, k, f, *_ in loads), ""]
            ).encode("cp1252"),
            "axes.csv": "\r\n".join(
                ["pose;" + ";".join(f"axe {k} [°]" for k in range(1, 7)),
                 *(";".join([str(i), *(comma(x, 4) for x in row)])
                   for i, row in enumerate(shown, 1)), ""]
            ).encode("cp1252"),
        },
        {"sigma_n": "2,0", "sigma_m": "0,00003"}, "mm", places,
    )  # fmt: skip


def analyzer() -> Hall:
    """SpatialAnalyzer; a folder with one file for each pose, the rail on seven axes."""
    tracker, loads, shown, places = _made("kr500_rail_kuka", 24)
    files: dict[str, list[str]] = {}
    head = ["// SpatialAnalyzer 2024.1.0321.6", "// Frame: A::WORLD", "// Cartesian, Millimeters",
            "// Collection::Group::Target, X, Y, Z"]  # fmt: skip
    for group, target, x, y, z, _ in tracker:
        where = group.partition("_")[0] if group.startswith("pose") else group
        line = f"A::{group}::{target}, {x}, {y}, {z}"
        files.setdefault(f"SA/{where}.txt", [*head]).append(line)
    return Hall(
        "kr500_rail_kuka",
        {
            **{name: "\r\n".join([*lines, ""]).encode() for name, lines in files.items()},
            "SA/loads.csv": "\n".join(
                ["pose,repeat,force_n", *(",".join(row[:3]) for row in loads), ""]
            ).encode(),
            "SA/axes.csv": "\n".join(
                ["pose,E1 [m],A1 [deg],A2 [deg],A3 [deg],A4 [deg],A5 [deg],A6 [deg]",
                 *(",".join([str(i), *(f"{x:.5f}" for x in row)])
                   for i, row in enumerate(shown, 1)), ""]
            ).encode(),
        },
        {"sigma_n": "2.0", "sigma_m": "0.00003"}, "m", places,
    )  # fmt: skip


def japanese() -> Hall:
    """Yaskawa; points in place of poses, axes by their letters, kilonewtons."""
    tracker, loads, shown, places = _made("gp180", 25)
    rows = _renamed(tracker, lambda p, k, pull: f"Point {p} {'pull' if pull else 'free'} {k}")
    return Hall(
        "gp180",
        {
            "tracker.csv": "\n".join(
                ["Pt Group,Pt Name,X (mm),Y (mm),Z (mm)", *(",".join(row[:5]) for row in rows), ""]
            ).encode(),
            "force.csv": "\n".join(
                ["point,pull,force (kN)",
                 *(f"{p},{k},{float(f) / 1e3:.5f}" for p, k, f, *_ in loads), ""]
            ).encode(),
            "axes.csv": "\n".join(
                ["point,S,L,U,R,B,T",
                 *(",".join([str(i), *(f"{x:.4f}" for x in row)])
                   for i, row in enumerate(shown, 1)), ""]
            ).encode(),
        },
        {"sigma_n": "2.0", "sigma_m": "0.00003"}, "mm", places,
    )  # fmt: skip


HALLS = {
    "german": german,
    "american": american,
    "french": french,
    "analyzer": analyzer,
    "japanese": japanese,
}
