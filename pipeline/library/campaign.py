"""Campaigns in Python: loaded, identified in memory, or run as `pipeline run` does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline import run as stages
from pipeline.answer import archive
from pipeline.answer.contract import Answer, Stiffness
from pipeline.base import files
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.base.quantities import with_std
from pipeline.library.folders import replace_folder
from pipeline.library.model import (
    Model,
    PositionModel,
    load_model,
    load_position_model,
    position_model,
)
from pipeline.machine.robot import Robot
from pipeline.store.campaign import Raw, find, in_memory, unfit

_POSITIONS = "positions.npz"


class _Stiffnesses(tuple[Stiffness, ...]):
    """The stiffness of each joint in the order of the robot file, also by name."""

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """Stiffness by index, or by axis, joint or name: `A3`, `theta4`, `k_theta4`.

        Raises:
            InputError: There is none of that name.
        """
        if not isinstance(key, str):
            return super().__getitem__(key)
        for one in self:
            if key in (one.axis, one.joint_name, one.name):
                return one
        known = [one.axis or one.joint_name for one in self]
        raise InputError(f'there is no stiffness "{key}"', f"use one of {listed(known)}")

    def to_frame(self) -> pd.DataFrame:
        """Table with a row per joint: axis, joint, value, std, ci95 bounds, unit, identifiable."""
        ends = zip(*(one.ci95 or (None, None) for one in self), strict=True) if self else ((), ())
        return pd.DataFrame(
            {
                "axis": [one.axis for one in self],
                "joint": [one.joint_name for one in self],
                "value": [one.value for one in self],
                "std": [one.std for one in self],
                **dict(zip(("ci95_lower", "ci95_upper"), ends, strict=True)),
                "unit": [one.unit for one in self],
                "identifiable": [one.identifiable for one in self],
            }
        )

    def __repr__(self) -> str:
        """One line per joint."""
        return "\n".join(f"{one.called:14} {_in_short(one)}" for one in self)


def _in_short(one: Stiffness) -> str:
    if one.value is None or one.std is None:
        return "not identifiable"
    return f"{with_std(one.value, one.std)} {one.unit}"


@dataclass(frozen=True, eq=False, repr=False)
class Campaign:
    """Files of a campaign, read and with campaign.toml checked; nothing is computed yet.

    Attributes:
        name: Name of its folder.
        raw: Settings, robot and the bytes of every file that campaign.toml names.
    """

    name: str
    raw: Raw

    @property
    def robot(self) -> Robot:
        """The robot that campaign.toml names."""
        return self.raw.robot

    @property
    def files(self) -> Mapping[str, bytes]:
        """Content of its files by name."""
        return self.raw.files

    def __repr__(self) -> str:
        """Its name, robot and files, not their content."""
        sizes = ", ".join(f"{name} ({len(data)} bytes)" for name, data in self.files.items())
        return f"Campaign {self.name}, robot {self.robot.name}: {sizes}"

    def save(self, root: Path | str = ".") -> Path:
        """Write its files to data/raw/NAME of a project, where `pipeline run` finds them.

        Raises:
            UsageError: A folder of that name already exists.
            CannotWrite: The disk refuses.
        """
        folder = Path(root) / "data" / "raw" / self.name
        if folder.exists():
            raise UsageError(f"{folder} is there already: load the files under another name")
        replace_folder(folder, self.files)
        return folder


@dataclass(frozen=True, repr=False)
class Picture:
    """A figure of a report.

    Attributes:
        svg: Content of the SVG file.
        caption: Its caption.
    """

    svg: str
    caption: str

    def _repr_svg_(self) -> str:
        """SVG for display in a notebook."""
        return self.svg

    def __repr__(self) -> str:
        """Its caption."""
        return f"Picture: {self.caption}"

    def save(self, path: Path | str) -> Path:
        """Write the SVG file.

        Raises:
            CannotWrite: The disk refuses.
        """
        files.write(Path(path), self.svg.encode())
        return Path(path)


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The answer to a campaign.

    Attributes:
        answer: result.json as frozen records; `answer.as_json()` is the plain data.
        model: The identified model, for predictions.
        tables: The tables of the report, by name; column names include units.
        positions: Model of the robot's positions, for a campaign of absolute positions; else None.
    """

    answer: Answer
    model: Model
    tables: Mapping[str, pd.DataFrame]
    positions: PositionModel | None = None

    @property
    def verdict(self) -> str:
        """Verdict: adequate, explained, ambiguous, unexplained or bad_data."""
        return str(self.answer.diagnosis.verdict)

    @property
    def stiffness(self) -> _Stiffnesses:
        """Each joint's stiffness with its standard uncertainty and unit, by place or by name."""
        return _Stiffnesses(self.answer.stiffness)

    def plot(self, name: str = "stiffness") -> Picture:
        """A figure of the report, which a notebook displays; `save` writes it as SVG.

        Args:
            name: Name of its file in reports/NAME/figures, without the extension.

        Raises:
            InputError: The report of this campaign has no such figure.
        """
        from pipeline.report.figures.catalogue import CATALOGUE, draw, figures

        drawn = figures([one.name for one in CATALOGUE], self.answer, self.tables)
        if name not in (known := [one.name for one in drawn]):
            raise InputError(f'there is no figure "{name}"', f"use one of {listed(known, 40)}")
        words = {one.name: f"{one.title}. {one.caption}" for one in drawn}
        return Picture(draw(name, self.answer, self.tables).svg, words[name])

    def to_frame(self) -> pd.DataFrame:
        """The stiffnesses as a table with one row per joint."""
        return self.stiffness.to_frame()

    def __repr__(self) -> str:
        """Verdict, stiffnesses, and names of the tables."""
        tables = ", ".join(self.tables)
        return f"Result: {self.verdict}\n{self.stiffness!r}\ntables: {tables}; all of it: .answer"


def load_campaign(
    source: Path | str | Mapping[str, bytes], *, root: Path | str = ".", name: str = "in_memory"
) -> Campaign:
    """Load a campaign from its folder, or from the content of its files.

    Args:
        source: The folder's path, its name under data/raw of `root`, or file contents by name,
            including campaign.toml.
        root: The project's folder.
        name: Name of a campaign in memory.

    Raises:
        InputError: A file is missing or cannot be read, or campaign.toml is wrong; states the line.
    """
    if not isinstance(source, Mapping):
        found = find(Path(root), str(source))
        return Campaign(found.name, found.read())
    if why := unfit(name):
        raise InputError(why, "choose another name")
    if "campaign.toml" not in source:
        raise InputError("there is no campaign.toml among the files", "add it by this name")
    return Campaign(name, in_memory(dict(source)))


def identify(campaign: Campaign) -> Result:
    """Identify stiffnesses, diagnosis and model of a campaign in memory; no file is written.

    The numbers are those of `pipeline run`.

    Raises:
        InputError: The data cannot be trusted; states file, line and way out.
        UsageError: The argument is not a campaign.
    """
    if not isinstance(campaign, Campaign):
        raise UsageError("identify takes a campaign: give it what load_campaign(...) returns")
    made = stages.campaign_answer(campaign.name, campaign.raw)
    kept = made.files.get(_POSITIONS)
    places = None if kept is None else position_model(kept)
    return Result(made.answer, Model(made.model), made.shown, places)


def run_campaign(campaign: Path | str, *, root: Path | str = ".", force: bool = False) -> Result:
    """Run a campaign as `pipeline run`: tables, result.json and report; computed only if new.

    Args:
        campaign: Name under data/raw of `root`, or the path of a folder.
        root: The project's folder, for data/processed and reports.
        force: Compute even if nothing changed.

    Raises:
        InputError: The data cannot be trusted; states file, line and way out.
        CannotWrite: The disk refuses.
    """
    found = find(Path(root), str(campaign))
    answer = stages.run(found, force=force)
    model = load_model(found.reports / "model.toml")
    kept = found.reports / _POSITIONS
    places = load_position_model(kept) if kept.is_file() else None
    return Result(answer, model, archive.kept_tables(found), places)
