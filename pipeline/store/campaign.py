"""A campaign on disk: where its files are, how they are read and kept, when they are current.

Raw files are only ever read. Tables go to data/processed/<campaign>, answers to reports/<campaign>,
and the manifest, written last, states from which inputs and code they were made.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cache, cached_property, partial
from importlib import metadata
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
from filelock import FileLock, Timeout

from pipeline import tables
from pipeline.base import files, parquet, toml
from pipeline.base.doors import opened
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.base.patterns import depth, fits, is_glob
from pipeline.base.shown import in_json, is_printable, typed
from pipeline.machine.robot import SHIPPED, Robot
from pipeline.machine.robot import load as load_robot
from pipeline.machine.robot.mdh import no_robot
from pipeline.machine.robot.mdh import parse as parse_robot
from pipeline.readers import largest, refuse_other_programs
from pipeline.reduction.settings import Settings
from pipeline.reduction.settings import parse as parse_settings

_AS_ONE = "pipeline.dialects:joined"
_LIBRARIES = (
    *("numpy", "scipy", "pandas", "pyarrow", "python-calamine", "pin"),
    *("prefect", "matplotlib", "typst", "xlsxwriter"),
)
MANIFEST = "manifest.json"
FLEET = "fleet"
"""Folder of the tables across campaigns, beside those of each campaign."""
_REJECTION = "rejection.json"


@dataclass(frozen=True, eq=False)
class Raw:
    """Content of a campaign folder.

    Attributes:
        settings: campaign.toml, validated.
        robot: The robot of the campaign.
        files: Name relative to the folder -> bytes, of everything that campaign.toml names.
        key: Hash of all of it and of the code; equal keys give equal results.
    """

    settings: Settings
    robot: Robot
    files: Mapping[str, bytes]
    key: str

    def placing(self) -> AbstractContextManager[None]:
        """Add the line to errors about campaign.toml; errors without a file are about it."""
        said = self.files["campaign.toml"].decode("utf-8", "replace")
        return toml.placed("campaign.toml", said)


@dataclass(frozen=True)
class CampaignFolder:
    """One campaign folder.

    Attributes:
        root: The project's root, which contains data/processed and reports.
        folder: The folder with campaign.toml.
    """

    root: Path
    folder: Path

    @property
    def name(self) -> str:
        """Name of the folder, also used for its tables and reports."""
        return self.folder.name

    @property
    def processed(self) -> Path:
        """Folder of its tables."""
        return self.root / "data" / "processed" / self._slot

    @property
    def reports(self) -> Path:
        """Folder of its answers."""
        return self.root / "reports" / self._slot

    @property
    def _slot(self) -> str:
        """Name of its folders for tables and answers; no valid campaign name begins with a dot."""
        if self._unfit is None:
            return self.name
        return f".odd-{files.sha256(os.fsencode(self.name))[:16]}"

    @cached_property
    def _unfit(self) -> tuple[str, str] | None:
        """Why the folder cannot be processed, and the remedy; None if it can."""
        if why := unfit(self.name):
            return why, "rename the folder"
        if self.folder.is_symlink():  # other links are resolved beforehand
            thing = f"{self.name} is a link that leads out of data/raw"
            return thing, "put a copy of the folder there, or run it by its own path"
        return None

    def read(self) -> Raw:
        """Read everything that campaign.toml names, once.

        Raises:
            InputError: A file is missing, unreadable, too large, or changes while it is read; or
                the folder has an invalid name.
        """
        self.fit()
        said = self.content("campaign.toml")
        settings = _settings(said)
        with toml.placed("campaign.toml", said.decode("utf-8", "replace")):
            others = {name: self.content(name) for name in self._named(settings)}
        return _raw(settings, {"campaign.toml": said, **others})

    def fit(self) -> None:
        """Check that the folder can be processed.

        Raises:
            InputError: It has an invalid name, or leads out of data/raw.
        """
        if self._unfit is not None:
            raise InputError(*self._unfit, file="campaign.toml")

    def settings(self) -> Settings:
        """Its campaign.toml, validated.

        Raises:
            InputError: It cannot be read, or has an invalid key or value.
        """
        return _settings(self.content("campaign.toml"))

    def _named(self, settings: Settings) -> list[str]:
        """Files that campaign.toml names, relative to the folder."""
        own = None if settings.robot in SHIPPED else settings.robot
        path = settings.tolerance.path if settings.tolerance else None
        if own is not None and not (own.endswith(".toml") and os.path.exists(self.folder / own)):
            raise no_robot(own, "campaign.toml")
        stood = [] if settings.positions is None else settings.positions.named
        if settings.of_positions:
            return [*stood, *filter(None, [own, path])]
        if (given := settings.displacements) is not None:
            others = [given.file, given.forces, settings.joints.file, own, path]
            return [*stood, *filter(None, others)]
        assert settings.tracker is not None  # guaranteed by Settings
        names = self._matching(settings.tracker.files)
        settings.tracker.none_missing(names)
        others = [settings.tracker.assignment, settings.loads_file, settings.joints.file, own, path]
        return list(dict.fromkeys([*names, *stood, *filter(None, others)]))

    def _matching(self, patterns: Sequence[str]) -> list[str]:
        """Existing files that are given by name, and those that match a glob, in order.

        Raises:
            InputError: The folder contains too many files.
        """
        deepest = max((depth(one, DEEPEST) for one in patterns if is_glob(one)), default=0)
        there = sorted(within(self.folder, deepest))
        found: list[str] = []
        for one in patterns:
            if is_glob(one):
                found += [name for name in there if fits(name, one)]
            elif os.path.exists(self.folder / one):
                found.append(one)
        return found

    def content(self, name: str) -> bytes:
        """Content of one of its files; of a glob, that of all files which match it, as one.

        Raises:
            InputError: Missing, unreadable, too large, outside the folder, or still growing.
        """
        if not is_printable(name):
            raise InputError(
                "its name contains characters that cannot be displayed", "rename it", file=name
            )
        path, home = self.folder / name, os.path.realpath(self.folder)
        if is_glob(name) and not path.exists() and (several := self._matching([name])):
            return bytes(opened(_AS_ONE)({one: self.content(one) for one in several}))
        if not Path(os.path.realpath(path)).is_relative_to(home):
            raise InputError(
                "leads out of the campaign's folder", "put a copy of the file there", file=name
            )
        missing = InputError(
            "the file is missing", f"copy it into {self.name} or correct campaign.toml", file=name
        )
        if name.endswith(".toml"):
            return files.read(path, name, toml.LARGEST_TEXT, missing)
        return files.read(path, name, largest(name), missing, partial(refuse_other_programs, name))

    def keep(
        self, name: str, table: pd.DataFrame | pa.Table | None, promise: pa.Schema
    ) -> pd.DataFrame:
        """Check a table against its schema, write it as Parquet, and return it as in the schema."""
        kept = tables.conform(table, promise)
        parquet.write(self.processed / f"{name}.parquet", kept)
        return tables.frame(kept)

    @contextmanager
    def locked(self) -> Iterator[bool]:
        """Lock the campaign for one run; yield whether another run had to be waited for.

        Raises:
            CannotWrite: The disk cannot be written.
            InputError: The results here are those of another folder of the same name.
        """
        lock = FileLock(self.processed / ".lock")
        with files.writing(self.processed):
            self.processed.mkdir(parents=True, exist_ok=True)
            waited = self._acquired_late(lock)
        try:
            self._claim()
            for folder in (self.processed, self.reports):
                with files.writing(folder):
                    files.sweep(folder)
            yield waited
        finally:
            lock.release()

    def _acquired_late(self, lock: FileLock) -> bool:
        try:
            lock.acquire(timeout=0)
        except Timeout:
            sys.stderr.write(
                f"{self.name}: another run is processing this campaign; waiting for it.\n"
            )
            lock.acquire()
            return True
        return False

    def _claim(self) -> None:
        """Refuse to replace results of another existing folder of the same name."""
        source = (self.manifest() or {}).get("source", self.source)
        if source == self.source:
            return
        other = self.root / source
        if os.path.isfile(other / "campaign.toml") and other.resolve() != self.folder.resolve():
            raise InputError(
                f"{self.reports} contains the results of another folder named {self.name}, {other}",
                "rename one of the two folders",
            )

    @property
    def source(self) -> str:
        """Its folder for the manifest: relative to the root if it is inside."""
        folder, root = self.folder.resolve(), self.root.resolve()
        return (folder.relative_to(root) if folder.is_relative_to(root) else folder).as_posix()

    def done(self, key: str) -> bool:
        """Whether the last finished run had this key, and its outputs are all intact."""
        manifest = self.manifest()
        if manifest is None or manifest["key"] != key:
            return False
        try:
            return all(
                files.sha256(files.read(self.root / name, name, largest(name))) == digest
                for name, digest in manifest["outputs"].items()
            )
        except InputError:
            return False

    @contextmanager
    def remembering(self, key: str) -> Iterator[None]:
        """Store why the block rejects an input; a block without error removes that record."""
        path = self.processed / _REJECTION
        try:
            yield
        except InputError as problem:
            if not problem.passing:
                files.write(path, dump({"key": key, "why": problem.parts}))
            raise
        with files.writing(path):
            path.unlink(missing_ok=True)

    def rejection(self, key: str) -> InputError | None:
        """Why the last run rejected the input with this key; None if it did not."""
        try:
            kept = recalled(self.processed / _REJECTION)
            return InputError(**kept["why"]) if kept["key"] == key else None
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None

    def manifest(self) -> dict[str, Any] | None:
        """Manifest of the last finished run; None if there is none, or an invalid one."""
        found = recalled(self.processed / MANIFEST)
        if not isinstance(found, dict) or not isinstance(found.get("outputs"), dict):
            return None
        said = (found.get("key"), found.get("source", ""), *found["outputs"].values())
        return found if all(isinstance(word, str) for word in said) else None

    def result(self) -> dict[str, Any]:
        """Its result.json."""
        found: dict[str, Any] = json.loads(self.result_text())
        return found

    def result_text(self) -> bytes:
        """Its result.json, byte for byte.

        Raises:
            UsageError: It has none.
        """
        path = self.reports / "result.json"
        if not path.is_file():
            raise UsageError(
                f"{self.name} has no result: run `pipeline run {typed(self.name)}` first"
            )
        return path.read_bytes()

    def finish(self, key: str, answers: Mapping[str, bytes], about: Mapping[str, Any]) -> None:
        """Write the answers, then the manifest that validates them, including `about`."""
        kept = sorted(self.processed.glob("*.parquet"))
        outputs = {self._output(path): files.sha256(path.read_bytes()) for path in kept}
        manifest = {"key": key, "source": self.source, "outputs": outputs}
        manifest |= {"code": code_version(), "versions": versions()}
        self.publish(manifest | dict(about), answers)

    def publish(self, manifest: dict[str, Any], answers: Mapping[str, bytes]) -> None:
        """Write answers; they are invalid until the manifest that lists them is written again."""
        with files.writing(self.processed):
            (self.processed / MANIFEST).unlink(missing_ok=True)
        for name, data in answers.items():
            files.write(self.reports / name, data)
            manifest["outputs"][self._output(self.reports / name)] = files.sha256(data)
        files.write(self.processed / MANIFEST, dump(manifest))

    def answers(self, manifest: Mapping[str, Any]) -> list[str]:
        """Names of the answers listed in a manifest, relative to the folder of its reports."""
        folder = f"{self._output(self.reports)}/"
        return [
            name.removeprefix(folder) for name in manifest["outputs"] if name.startswith(folder)
        ]

    def _output(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()


def dump(content: object) -> bytes:
    """JSON as written by this project: no NaN, UTF-8, one final newline."""
    return (in_json(content, indent=2) + "\n").encode()


def recalled(path: Path) -> Any:
    """Content of a file written by `dump`; None if it is missing or cannot be read."""
    try:
        return json.loads(files.read(path, path.name, largest(path.name)))
    except (InputError, ValueError, RecursionError):
        return None


def in_memory(content: Mapping[str, bytes]) -> Raw:
    """A campaign from the bytes of its files, including those of its own robot."""
    return _raw(_settings(content["campaign.toml"]), content)


def _raw(settings: Settings, content: Mapping[str, bytes]) -> Raw:
    if settings.robot in content:
        robot = parse_robot(files.text(content[settings.robot], settings.robot), settings.robot)
    else:
        robot = load_robot(settings.robot)
    robot = robot.under(settings.gravity.vector)
    return Raw(settings, robot, content, _key(content, robot))


def _settings(data: bytes) -> Settings:
    return parse_settings(files.text(data, "campaign.toml"))


def find(root: Path, name: str) -> CampaignFolder:
    """A campaign by its name under data/raw, or by path.

    Raises:
        InputError: There is no such folder, or no campaign.toml in it; the message lists those that
            exist.
    """
    if not name.strip():
        raise InputError(
            "the name of the campaign is empty", "give a name under data/raw or a path"
        )
    raw = root / "data" / "raw"
    for folder in (raw / name, Path(name)):
        if _has_settings(folder):
            return _at(root, folder)
    if os.path.isdir(raw / name) or os.path.isdir(name):
        raise InputError(
            f"{name} has no campaign.toml",
            f"write one, for example with `pipeline init {typed(name)}`",
        )
    known = listed(campaign.name for campaign in every(root))
    raise InputError(f'there is no campaign "{name}"', f"known under data/raw: {known}")


def _at(root: Path, folder: Path) -> CampaignFolder:
    """The campaign in a folder, with links resolved, except one that leads out of data/raw."""
    real, raw = Path(os.path.realpath(folder)), Path(os.path.realpath(root / "data" / "raw"))
    here = Path(os.path.realpath(folder.parent)) == raw
    return CampaignFolder(root, folder if here and not real.is_relative_to(raw) else real)


def outside_raw(root: Path, output: Path) -> Path:
    """An output file given by the user, if it is outside the measurements.

    Raises:
        UsageError: It is under data/raw.
    """
    raw = os.path.realpath(root / "data" / "raw")
    if Path(os.path.realpath(output)).is_relative_to(raw):
        raise UsageError(
            f"{output} lies under data/raw, where measurements stay as they came: choose another "
            "--output"
        )
    return output


def label(name: str) -> str:
    """Name of the folder meant by a name or a path, whether it exists or not."""
    return os.path.basename(os.path.realpath(name.replace("\0", ""))) if name.strip() else name


def every(root: Path) -> list[CampaignFolder]:
    """All campaigns under data/raw, by name, without hidden folders.

    Raises:
        InputError: It is there and cannot be listed, as a share that is gone.
    """
    raw = root / "data" / "raw"
    try:
        names = sorted(os.listdir(raw))
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as problem:
        thing = f"{raw} cannot be listed ({problem.strerror})"
        raise InputError(thing, "check the folder and its permissions", passing=True) from problem
    there = [raw / name for name in names if not name.startswith(".")]
    found = (_at(root, folder) for folder in there if _has_settings(folder))
    return list({campaign.folder: campaign for campaign in found}.values())


def _has_settings(folder: Path) -> bool:
    """Whether a folder is a campaign's; an unreadable campaign.toml counts, to be reported."""
    try:
        os.lstat(folder / "campaign.toml")
    except (FileNotFoundError, NotADirectoryError, ValueError):  # which a NUL in a name is
        return False
    except OSError as problem:
        return problem.errno not in files.HOPELESS_ERRORS
    return True


_OURS = re.compile(rf"plans|{FLEET}|.*\.(html|json)", re.IGNORECASE | re.DOTALL)
"""Names of our own files and folders beside those of the campaigns."""
_LONGEST = 120
"""Maximum number of bytes of a name: file systems allow 255, and suffixes need some of them."""


def unfit(name: str) -> str | None:
    """Why a folder of this name cannot be a campaign; None if it can."""
    if not is_printable(name):
        return "the name of its folder contains characters that cannot be displayed"
    if not name.strip() or name[0] in ".-" or "/" in name or "\\" in name:
        return "the name of its folder is empty, begins with a dot or a dash, or contains a slash"
    if len(os.fsencode(name)) > _LONGEST:
        return f"the name of its folder has more than {_LONGEST} bytes"
    return "the name of its folder is one of our own files" if _OURS.fullmatch(name) else None


MOST_ENTRIES, DEEPEST = 20_000, 16
"""Maximum number of files and folders of a campaign, and depth to which they are searched."""


def within(folder: Path, deepest: int) -> Iterator[str]:
    """Names of all files of a folder, relative to it; linked folders are not entered.

    Raises:
        InputError: There are too many, or it cannot be listed.
    """
    left, seen = [("", 1)] if deepest else [], 0
    while left:
        inner, depth = left.pop()
        try:
            with os.scandir(folder / inner) as listing:
                entries = list(itertools.islice(listing, MOST_ENTRIES))
        except OSError as problem:
            thing = f"cannot be listed ({problem.strerror})"
            raise InputError(thing, "check its permissions", file=inner or folder.name) from problem
        seen += len(entries)
        if seen >= MOST_ENTRIES:
            thing = f"the folder contains more than {MOST_ENTRIES} files"
            raise InputError(thing, "keep only those of the campaign", file="campaign.toml")
        for entry in entries:
            if not entry.is_dir(follow_symlinks=False):
                yield f"{inner}{entry.name}"
            elif depth < deepest:
                left.append((f"{inner}{entry.name}/", depth + 1))


@cache
def versions() -> dict[str, str]:
    """Versions of the libraries on which numbers and pages depend."""
    from pipeline.base.version import __version__

    return {"pipeline": __version__} | {name: metadata.version(name) for name in _LIBRARIES}


@cache
def code_version() -> str:
    """Hash of every file of the package, so that a result of other code is never reused."""
    package = Path(__file__).parents[1]
    inside = (path.relative_to(package) for path in sorted(package.rglob("*")) if path.is_file())
    sources = [path for path in inside if "__pycache__" not in path.parts]
    lines = (f"{path}:{files.sha256((package / path).read_bytes())}\n" for path in sources)
    return files.sha256("".join(lines).encode())


def _key(content: Mapping[str, bytes], robot: Robot) -> str:
    parts = [f"{name}:{files.sha256(data)}" for name, data in sorted(content.items())]
    parts += [robot.text, code_version(), json.dumps(versions())]
    return files.sha256("\n".join(parts).encode())
