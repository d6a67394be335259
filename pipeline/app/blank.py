"""The folder of a campaign that is still to be measured, for people to fill in."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import jinja2

from pipeline.base import files
from pipeline.base.errors import InputError, UsageError
from pipeline.base.shown import printable
from pipeline.base.toml import quoted
from pipeline.machine.robot import SHIPPED, Robot, load
from pipeline.store.campaign import unfit

NAME = "a plain folder name that begins with no dot"

ASKED = {
    "sigma_mm": ("Standard uncertainty of one tracker reading per axis", "mm", 0.03),
    "sigma_n": ("Standard uncertainty of one scale reading", "N", 2.0),
}
"""What `init` asks on a terminal, with unit and default."""


def robots() -> str:
    """The robots that ship, for a sentence."""
    return ", ".join(SHIPPED)


def init(root: Path, name: str, robot: str, sigma_mm: float, sigma_n: float) -> Path:
    """Make the folder of a new campaign.

    Args:
        root: The project's root.
        name: Of the campaign and its folder.
        robot: A robot that ships, or a robot file.
        sigma_mm: Standard uncertainty of one tracker reading per axis [mm].
        sigma_n: Standard uncertainty of one scale reading [N].

    Raises:
        UsageError: The name is no folder name, the folder is there already, or there is no such
            robot.
    """
    folder, joints = vacant(root, name), known(root, name, robot).joints
    columns = [f"{j.name}_m" if j.prismatic else f"{j.name}_deg" for j in joints]
    template = (resources.files("pipeline.app") / "campaign.toml.jinja").read_text("utf-8")
    text = jinja2.Template(template, keep_trailing_newline=True).render(
        name=quoted(name),
        robot=quoted(robot),
        shipped=robots(),
        sigma_m=f"{1e-3 * sigma_mm:.3g}",
        sigma_n=f"{sigma_n:g}",
        q=", ".join("0" for _ in joints),
    )
    files.write(folder / "loads.csv", b"pose,repeat,force_n,branch\n")
    files.write(folder / "joints.csv", f"pose,{','.join(columns)},approach\n".encode())
    files.write(folder / "campaign.toml", text.encode())
    return folder


def vacant(root: Path, name: str) -> Path:
    """The folder that a campaign of this name gets.

    Raises:
        UsageError: The name is no folder name, or the folder is there already.
    """
    if why := unfit(name):
        raise UsageError(f'"{printable(name, 80)}" cannot name a campaign ({why}): use {NAME}')
    folder = root / "data" / "raw" / name
    if folder.exists():
        raise UsageError(f"{folder} is there already: choose another name")
    return folder


def known(root: Path, name: str, robot: str) -> Robot:
    """The robot that is meant, beside a campaign that is still to be written.

    Raises:
        UsageError: There is no such robot.
    """
    try:
        return load(robot, root / "data" / "raw" / name)
    except InputError as problem:
        if problem.file != "campaign.toml":
            raise
        raise UsageError(f"--robot: {problem.thing}; {problem.way_out}") from problem
