"""A campaign on disk: where its files are, how they are read, kept and recognised again.

Raw files are only ever read. Tables go to data/processed/<campaign>, answers to
reports/<campaign>, and the manifest, written last, says from which inputs and code they came.
"""

from __future__ import annotations

import io
import json
import stat
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from pipeline import tables
from pipeline.base import files
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.machine.robot import Robot
from pipeline.machine.robot import load as load_robot
from pipeline.machine.robot.mdh import parse as parse_robot
from pipeline.reduction.settings import Settings
from pipeline.reduction.settings import parse as parse_settings

_LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "pin", "prefect", "matplotlib", "typst")
MANIFEST = "manifest.json"
_REJECTION = "rejection.json"
LARGEST_FILE = 4 * 2**30
"""Bytes; files are read whole into memory."""


@dataclass(frozen=True, eq=False)
class Raw:
    """What a campaign folder holds.

    Attributes:
        settings: campaign.toml, checked.
        robot: Its robot.
        files: Name relative to the folder -> bytes, of everything that campaign.toml names.
        key: Hash over all of it and over the code; equal keys give equal results.
    """

    settings: Settings
    robot: Robot
    files: Mapping[str, bytes]
    key: str


@dataclass(frozen=True)
class Campaign:
    """One campaign folder.

    Attributes:
        root: The project's root, where data/processed and reports are.
        folder: The folder with campaign.toml.
    """

    root: Path
    folder: Path

    @property
    def name(self) -> str:
        """The folder's name; tables and reports carry it."""
        return self.folder.name

    @property
    def processed(self) -> Path:
        """Where its tables are."""
        return self.root / "data" / "processed" / self.name

    @property
    def reports(self) -> Path:
        """Where its answers are."""
        return self.root / "reports" / self.name

    def read(self) -> Raw:
        """Read everything that campaign.toml names, once.

        Raises:
            InputError: A file is missing, unreadable, too large, or changes while it is read.
        """
        names = ["campaign.toml", *self._named(self.settings())]
        return in_memory({name: self.content(name) for name in names}, self.folder)

    def settings(self) -> Settings:
        """Its campaign.toml, checked.

        Raises:
            InputError: It cannot be read, or has a word or value it cannot have.
        """
        return _settings(self.content("campaign.toml"))

    def _named(self, settings: Settings) -> list[str]:
        """Names of the files that campaign.toml names, relative to the folder."""
        if settings.displacements is not None:
            given = settings.displacements
            return [given.file, given.forces, settings.joints.file]
        assert settings.tracker is not None  # Settings sees to that
        assert settings.scale is not None
        names: list[str] = []
        for pattern in settings.tracker.files:
            _inside(pattern)
            found = self.folder.glob(pattern)
            names += sorted(path.relative_to(self.folder).as_posix() for path in found)
        settings.tracker.none_missing(names)
        others = [settings.tracker.assignment, settings.scale.file, settings.joints.file]
        return list(dict.fromkeys([*names, *filter(None, others)]))

    def content(self, name: str) -> bytes:
        """Content of one of its files.

        Raises:
            InputError: Missing, unreadable, too large, outside the folder, or still growing.
        """
        path, refused = self.folder / name, partial(InputError, file=name)
        _inside(name)
        try:
            before = path.stat()
            if not (stat.S_ISREG(before.st_mode) or stat.S_ISDIR(before.st_mode)):
                raise refused(
                    "is no file but a device or a pipe, which never ends",
                    f"copy the file itself into {self.name}",
                )
            if before.st_size > LARGEST_FILE:
                raise refused(too_large(before.st_size), "split the export")
            data = path.read_bytes()
            after = path.stat()
        except FileNotFoundError as problem:
            way_out = f"copy it into {self.name} or correct campaign.toml"
            raise refused("the file is missing", way_out) from problem
        except OSError as problem:
            thing, way_out = "cannot be read", "check the file and its permissions"
            raise refused(f"{thing} ({problem.strerror})", way_out, passing=True) from problem
        if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
            way_out = "run again when the export is finished"
            raise refused("changed while it was read", way_out, passing=True)
        return data

    def keep(
        self, name: str, table: pd.DataFrame | pa.Table | None, promise: pa.Schema
    ) -> pd.DataFrame:
        """Check a table against its promise, write it as Parquet, and give it on as promised."""
        kept = tables.conform(table, promise)
        sink = io.BytesIO()
        pq.write_table(kept, sink, compression="zstd")
        files.write(self.processed / f"{name}.parquet", sink.getvalue())
        return tables.frame(kept)

    @contextmanager
    def locked(self) -> Iterator[bool]:
        """Hold the campaign for one run; a second run says so and waits, and then gets True.

        Raises:
            CannotWrite: The disk refuses.
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

    def tidy(self) -> None:
        """Remove what a killed run left behind, also where nothing has to be computed.

        A run at work cleans up after itself, and a disk that cannot be written stays as it is.
        """
        folders = (self.processed, self.reports)
        if not any(files.leftovers(folder) for folder in folders):
            return
        with suppress(Timeout, OSError), FileLock(self.processed / ".lock", timeout=0):
            for folder in folders:
                files.sweep(folder)

    def _acquired_late(self, lock: FileLock) -> bool:
        try:
            lock.acquire(timeout=0)
        except Timeout:
            sys.stderr.write(f"{self.name}: another run holds this campaign; waiting for it.\n")
            lock.acquire()
            return True
        return False

    def _claim(self) -> None:
        """Never replace what another folder of the same name has made, as long as it is there."""
        source = (self.manifest() or {}).get("source")
        if not isinstance(source, str) or source == self.source:
            return
        other = self.root / source
        if (other / "campaign.toml").is_file() and other.resolve() != self.folder.resolve():
            raise InputError(
                f"{self.reports} holds the results of another folder named {self.name}, {other}",
                "rename one of the two folders",
            )

    @property
    def source(self) -> str:
        """Its folder for the manifest: relative to the root where it lies in it."""
        folder, root = self.folder.resolve(), self.root.resolve()
        return (folder.relative_to(root) if folder.is_relative_to(root) else folder).as_posix()

    def done(self, key: str) -> bool:
        """Whether the last finished run had this key, and its outputs are all intact."""
        manifest = self.manifest()
        if manifest is None or manifest["key"] != key:
            return False
        try:
            return all(
                files.sha256((self.root / name).read_bytes()) == digest
                for name, digest in manifest["outputs"].items()
            )
        except OSError:
            return False

    def current(self) -> bool:
        """Whether its last run is still valid, so that no engine needs to start.

        Raises:
            InputError: It cannot be read, and trying again will not help.
        """
        try:
            return self.done(self.read().key)
        except InputError as problem:
            if problem.passing:  # the engine reads again a little later
                return False
            raise

    @contextmanager
    def remembering(self, key: str) -> Iterator[None]:
        """Keep why an input is rejected while it is computed; a result makes it forgotten."""
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
        """Why the last run rejected the input with this key; None where it did not."""
        try:
            kept = json.loads((self.processed / _REJECTION).read_bytes())
            return InputError(**kept["why"]) if kept["key"] == key else None
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def manifest(self) -> dict[str, Any] | None:
        """What the last finished run was made from; None when there is none, or an odd one."""
        found = recalled(self.processed / MANIFEST)
        if not isinstance(found, dict) or not isinstance(found.get("key"), str):
            return None
        return found if isinstance(found.get("outputs"), dict) else None

    def result(self) -> dict[str, Any]:
        """Its result.json."""
        path = self.reports / "result.json"
        if not path.is_file():
            raise UsageError(f"{self.name} has no result: run `pipeline run {self.name}` first")
        found: dict[str, Any] = json.loads(path.read_bytes())
        return found

    def finish(self, key: str, answers: Mapping[str, bytes], about: Mapping[str, Any]) -> None:
        """Write the answers, then the manifest that makes them count, with `about` in it."""
        kept = sorted(self.processed.glob("*.parquet"))
        outputs = {self._output(path): files.sha256(path.read_bytes()) for path in kept}
        manifest = {"key": key, "source": self.source, "outputs": outputs}
        manifest |= {"code": code_version(), "versions": versions()}
        self.publish(manifest | dict(about), answers)

    def publish(self, manifest: dict[str, Any], answers: Mapping[str, bytes]) -> None:
        """Write answers; nothing counts until the manifest is there again, which knows them."""
        with files.writing(self.processed):
            (self.processed / MANIFEST).unlink(missing_ok=True)
        for name, data in answers.items():
            files.write(self.reports / name, data)
            manifest["outputs"][self._output(self.reports / name)] = files.sha256(data)
        files.write(self.processed / MANIFEST, dump(manifest))

    def _output(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()


def dump(content: object) -> bytes:
    """JSON as we write it: no NaN, UTF-8, one final newline."""
    return (json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def recalled(path: Path) -> Any:
    """What `dump` has left in a file; None where there is none, or one that cannot be read."""
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None


def in_memory(content: Mapping[str, bytes], folder: Path | None = None) -> Raw:
    """A campaign from the bytes of its files; its own robot's is among them or in `folder`."""
    settings = _settings(content["campaign.toml"])
    if settings.robot in content:
        robot = parse_robot(files.text(content[settings.robot], settings.robot), settings.robot)
    else:
        robot = load_robot(settings.robot, folder)
    return Raw(settings, robot, content, _key(content, robot))


def _settings(data: bytes) -> Settings:
    return parse_settings(files.text(data, "campaign.toml"))


def too_large(size: int) -> str:
    """What is wrong with a file of so many bytes."""
    return f"has {size / 2**30:.1f} GiB, more than {LARGEST_FILE / 2**30:.0f}"


def find(root: Path, name: str) -> Campaign:
    """A campaign by its name under data/raw, or by path.

    Raises:
        InputError: There is no such folder, or no campaign.toml in it; lists those there are.
    """
    if not name.strip():
        raise InputError(
            "the name of the campaign is empty", "give a name under data/raw or a path"
        )
    for folder in (root / "data" / "raw" / name, Path(name)):
        if (folder / "campaign.toml").is_file():
            return Campaign(root, folder.resolve())
    if (root / "data" / "raw" / name).is_dir() or Path(name).is_dir():
        raise InputError(
            f"{name} has no campaign.toml", f"write one, for example with `pipeline init {name}`"
        )
    known = listed(campaign.name for campaign in every(root))
    raise InputError(f'there is no campaign "{name}"', f"known under data/raw: {known}")


def label(name: str) -> str:
    """The name of the folder that somebody means by a name or a path, there or not."""
    return Path(name).resolve().name if name.strip() else name


def every(root: Path) -> list[Campaign]:
    """All campaigns under data/raw, by name."""
    return [
        Campaign(root, path.parent.resolve())
        for path in sorted((root / "data" / "raw").glob("*/campaign.toml"))
    ]


@cache
def versions() -> dict[str, str]:
    """Versions of the libraries that numbers and pages depend on."""
    from pipeline import __version__

    return {"pipeline": __version__} | {name: metadata.version(name) for name in _LIBRARIES}


@cache
def code_version() -> str:
    """Hash of every file of the package, so that changed code never meets an old result."""
    package = Path(__file__).parents[1]
    inside = (path.relative_to(package) for path in sorted(package.rglob("*")) if path.is_file())
    sources = [path for path in inside if "__pycache__" not in path.parts]
    lines = (f"{path}:{files.sha256((package / path).read_bytes())}\n" for path in sources)
    return files.sha256("".join(lines).encode())


def _inside(name: str) -> None:
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(
            f'"{name}" lies outside the campaign folder',
            "put it beside campaign.toml",
            file="campaign.toml",
        )


def _key(content: Mapping[str, bytes], robot: Robot) -> str:
    parts = [f"{name}:{files.sha256(data)}" for name, data in sorted(content.items())]
    parts += [robot.text, code_version(), json.dumps(versions())]
    return files.sha256("\n".join(parts).encode())
