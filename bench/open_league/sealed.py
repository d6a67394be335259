"""Commitment: SHA-256 of every truth and every file is published before anybody answers.

A commitment hides only what cannot be guessed, hence the salt in truth.json (Blum, Coin flipping by
telephone, 1981, in its form with a hash function).
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from bench.open_league import truth
from bench.open_league.truth import Truth
from pipeline.base import files
from pipeline.base.errors import InputError, UsageError, listed

T = TypeVar("T")

MANIFEST, REVEALED, TRUTH, ANSWERS = "manifest.json", "revealed.json", "truth", "answers"


@dataclass(frozen=True)
class Sealed:
    """What is published of one game before it is played.

    Attributes:
        truth: SHA-256 of its truth.json.
        files: SHA-256 of each file of its campaign, by name.
    """

    truth: str
    files: Mapping[str, str]


@dataclass(frozen=True)
class Manifest:
    """What is published of all games.

    Attributes:
        games: By name of the campaign's folder.
        format: 1.
    """

    games: dict[str, Sealed]
    format: int = 1


@dataclass(frozen=True)
class Revealed:
    """Answers that existed when the truth was opened.

    Attributes:
        answers: SHA-256 of each answer, by entry and game.
    """

    answers: dict[str, dict[str, str]]


def seal(games: Path, hidden: Path) -> Manifest:
    """Move truth.json out of every campaign's folder, and publish the hashes.

    Args:
        games: Folder of campaigns, each with its truth.json.
        hidden: Folder for the truths, outside `games`.

    Raises:
        UsageError: The games are already sealed, or the truths would stay with them.
        InputError: A truth is missing or invalid.
    """
    if (games / MANIFEST).exists():
        raise UsageError(f"{games} is sealed already: its {MANIFEST} is what others rely on")
    if hidden.resolve().is_relative_to(games.resolve()):
        raise UsageError(f"{hidden} lies in {games}, which others get: put the truths elsewhere")
    folders = campaigns(games)
    read = {folder.name: truth.read(_salted(folder / "truth.json")) for folder in folders}
    sealed = {}
    for folder in folders:
        kept = hidden / f"{folder.name}.json"
        truth.write(kept, read[folder.name])
        with files.writing(folder):
            (folder / "truth.json").unlink()
        sealed[folder.name] = Sealed(_hash(kept), _hashes(folder))
    manifest = Manifest(sealed)
    files.write(games / MANIFEST, _dump(manifest))
    return manifest


def _salted(path: Path) -> Path:
    """Add a random salt to a truth that has none."""
    try:
        said = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return path  # its reader reports the error
    if isinstance(said, dict) and "salt" not in said:
        files.write(path, json.dumps({"salt": secrets.token_hex(16)} | said).encode())
    return path


def campaigns(games: Path) -> list[Path]:
    """Folders of campaigns among the games, by name.

    Raises:
        InputError: There is none.
    """
    found = sorted(path.parent for path in games.glob("*/campaign.toml"))
    if not found:
        raise InputError(
            "holds no campaign", "a game is a folder with a campaign.toml in it", file=str(games)
        )
    return found


def manifest(games: Path) -> Manifest:
    """Published data of these games, if the campaigns are unchanged.

    Raises:
        InputError: They are not sealed, or a file was changed.
    """
    said = _load(games / MANIFEST, Manifest, "seal them first: python -m bench.open_league seal")
    for name, game in said.games.items():
        now = _hashes(games / name)
        changed = sorted(f for f in {*now, *game.files} if now.get(f) != game.files.get(f))
        if changed:
            raise InputError(
                f"{listed(changed)} of {name} is not what was sealed",
                "fetch the games again, all of them or none",
                file=str(games / MANIFEST),
            )
    return said


def reveal(games: Path, hidden: Path) -> Revealed:
    """Publish the truths, and the hashes of the answers that existed before.

    Raises:
        UsageError: They are already revealed.
        InputError: A truth is not the one that was sealed; then none is published.
    """
    if (games / REVEALED).exists():
        raise UsageError(f"the truths of {games} are revealed already")
    said = manifest(games)
    for name, game in said.games.items():
        _as_sealed(hidden / f"{name}.json", game.truth)
    for name in said.games:
        files.write(games / TRUTH / f"{name}.json", (hidden / f"{name}.json").read_bytes())
    stood: dict[str, dict[str, str]] = {}
    for path in sorted(games.glob(f"{ANSWERS}/*/*.json")):
        stood.setdefault(path.parent.name, {})[path.stem] = _hash(path)
    revealed = Revealed(stood)
    files.write(games / REVEALED, _dump(revealed))
    return revealed


def revealed(games: Path) -> Revealed:
    """Answers that count.

    Raises:
        InputError: The truths are not revealed.
    """
    return _load(games / REVEALED, Revealed, "nothing is scored before reveal")


def truths(games: Path) -> dict[str, Truth]:
    """The truths by game, each checked against its hash.

    Raises:
        InputError: One is not what was sealed.
    """
    out = {}
    for name, game in manifest(games).games.items():
        path = games / TRUTH / f"{name}.json"
        _as_sealed(path, game.truth)
        out[name] = truth.read(path)
    return out


def in_time(games: Path, path: Path) -> bool:
    """Whether an answer existed when the truths were opened."""
    return revealed(games).answers.get(path.parent.name, {}).get(path.stem) == _hash(path)


def _as_sealed(path: Path, said: str) -> None:
    if not path.is_file():
        raise InputError("the truth is missing", "give its folder with --truth", file=str(path))
    if _hash(path) != said:
        raise InputError(
            "is not the truth that was sealed: its SHA-256 differs",
            "give the file that seal wrote, byte by byte",
            file=str(path),
        )


def _hash(path: Path) -> str:
    return files.sha256(path.read_bytes())


def _hashes(folder: Path) -> dict[str, str]:
    inside = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): _hash(path) for path in inside}


def _dump(record: Manifest | Revealed) -> bytes:
    return TypeAdapter(type(record)).dump_json(record, indent=1) + b"\n"


def _load(path: Path, kind: type[T], way_out: str) -> T:
    if not path.is_file():
        raise InputError("there is no such file", way_out, file=str(path))
    try:
        return TypeAdapter(kind).validate_json(path.read_bytes())
    except ValidationError as problem:
        raise InputError("is none of ours", way_out, file=str(path)) from problem
