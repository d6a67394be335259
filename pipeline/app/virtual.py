"""What `pipeline simulate` does on disk: plan in, raw folder out, truth beside the tables."""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.base import files
from pipeline.base.errors import InputError, UsageError
from pipeline.machine.robot import load as load_robot
from pipeline.simulate import Plan, RawCampaign, parse, prepared, revised, simulate
from pipeline.store.campaign import dump

_INSTRUMENT = {
    "range_m": 8e-6,
    "range_per_m": 0.3e-6,
    "transverse_m": 7.5e-6,
    "transverse_per_m": 3e-6,
}
"""Half the MPE of an AT500-class tracker, the usual size of its standard uncertainty."""


@dataclass(frozen=True)
class Written:
    """Where a simulated campaign went.

    Attributes:
        folder: The raw folder.
        truth: What is true, sealed outside of it.
    """

    folder: Path
    truth: Path


def write(
    root: Path,
    plan: Path | None,
    changes: dict[str, Any],
    noise: str | None = None,
    exact: bool = False,
    truth: Path | None = None,
    force: bool = False,
) -> Written:
    """Simulate a campaign and put it under data/raw.

    Args:
        root: The project's root.
        plan: A plan file, or None for the default plan.
        changes: What the command line says otherwise, as in the plan; None is no change.
        noise: `paper`, `instrument`, or a standard uncertainty per axis in m.
        exact: Readings without noise, all digits written.
        truth: Where the truth goes, data/processed/<name>.truth.json when not given.
        force: Replace a campaign of the same name.

    Raises:
        UsageError: The campaign is there already, or the truth would lie in a raw folder.
        InputError: The plan cannot be carried out.
    """
    wanted = revised(_read(plan), _given(changes))
    wanted = revised(wanted, {"tracker": _noise(noise)}) if noise else wanted
    wanted = wanted.without_noise() if exact else wanted
    raw = (root / "data" / "raw").resolve()
    sealed = (truth or root / "data" / "processed" / f"{wanted.name}.truth.json").resolve()
    if sealed.is_relative_to(raw):
        raise UsageError(f"{sealed} lies under {raw}: keep the truth away from the raw files")
    folder = raw / wanted.name
    if folder.exists() and not force:
        raise UsageError(f"{folder} is there already: choose another --name, or use --force")
    made = simulate(wanted, robot=load_robot(wanted.robot, plan.parent if plan else None))
    files.write(sealed, dump(made.truth))
    with files.writing(folder):
        _place(made, folder)
    return Written(root / "data" / "raw" / wanted.name, sealed)


def prepare(root: Path, name: str, plan: Path) -> Path:
    """Make the folder of a campaign that will measure a plan: all but forces and tracker export.

    Args:
        root: The project's root.
        name: Name of the campaign.
        plan: The plan file.

    Raises:
        UsageError: The folder is there already.
        InputError: The plan cannot be carried out, or the name cannot name a campaign.
    """
    folder = root / "data" / "raw" / name
    if folder.exists():
        raise UsageError(f"{folder} is there already: choose another name")
    wanted = revised(_read(plan), {"name": name})
    for inner, data in prepared(wanted, load_robot(wanted.robot, plan.parent)).items():
        files.write(folder / inner, data)
    return folder


def _read(path: Path | None) -> Plan:
    if path is None:
        return Plan()
    try:
        text = path.read_text("utf-8-sig")
    except FileNotFoundError as problem:
        raise InputError("there is no such plan", "check the path", file=str(path)) from problem
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(
            f"cannot be read ({problem})", "give a plan in UTF-8", file=str(path)
        ) from problem
    return parse(text, path.name)


def _given(changes: dict[str, Any]) -> dict[str, Any]:
    """The changes without what was not said."""
    out: dict[str, Any] = {}
    for key, value in changes.items():
        value = _given(value) if isinstance(value, dict) else value
        if value is not None and value != {}:
            out[key] = value
    return out


def _place(made: RawCampaign, folder: Path) -> None:
    """Put the whole folder in its place in one step; an old one of that name goes."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    # beside data/raw, where a half-written folder is no campaign yet
    temporary = Path(tempfile.mkdtemp(dir=folder.parent.parent, prefix=f".{made.name}."))
    try:
        new, old = temporary / "new", temporary / "old"
        for name, data in made.files.items():
            files.write(new / name, data)
        replaced = folder.exists()
        if replaced:
            os.rename(folder, old)
        try:
            os.rename(new, folder)
        except OSError:
            if replaced:
                os.rename(old, folder)
            raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _noise(word: str) -> dict[str, Any]:
    if word == "paper":
        return {"noise": "paper", "sigma_m": None}
    if word == "instrument":
        return {"noise": _INSTRUMENT, "sigma_m": None}
    try:
        return {"sigma_m": float(word), "noise": None}
    except ValueError as problem:
        raise UsageError(
            f'"{word}" is no noise: write paper, instrument, or metres per axis like 3e-5'
        ) from problem
