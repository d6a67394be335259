"""Report of an internal error that can be shared: where the code failed, without any user data.

Names, numbers and paths of a campaign may occur in the message of an exception, in lines of other
code and in names of folders; none of these is written.
"""

from __future__ import annotations

import platform
import re
import sys
import traceback
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from pipeline.base.version import __version__

_OURS = Path(__file__).parents[1]

_LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "pin", "prefect")

_ELSEWHERE = "(somebody else's code)"

_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"|`[^`]*`")
_PATH = re.compile(r"\S*[/\\]\S*")
_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)+(?:[eE][-+]?\d+)?|[-+]?\d+[eE][-+]?\d+|\d{4,}")
_PLAIN = re.compile(r"[(\[]*[a-z]+[)\].,:;]*|[(\[]*\d{1,3}[)\].,:;x\d]*|…[)\].,:;]*|[=<>!]+")


def shareable(problem: BaseException) -> str:
    """Versions, types of errors with anonymised messages, and where in the code they arose.

    Integers below 1000 are kept: shapes and counts are the most useful part of a message.
    """
    libraries = " ".join(f"{one} {_version(one)}" for one in _LIBRARIES)
    about = f"pipeline {__version__}, Python {platform.python_version()}, {sys.platform}"
    chain = traceback.TracebackException.from_exception(problem)
    return "\n".join([f"{about} {platform.machine()}", libraries, *_chained(chain), ""])


def _chained(error: traceback.TracebackException) -> Iterator[str]:
    """Lines on a chain of errors, the original error first."""
    before = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    if before is not None:
        yield from _chained(before)
        yield "then:"
    for frame in error.stack:
        where = _place(frame.filename)
        line = f": {frame.line}" if where and where.startswith("pipeline/") else ""
        yield f"  {where}:{frame.lineno} {frame.name}{line}" if where else f"  {_ELSEWHERE}"
    message = "".join(error.format_exception_only()).strip().partition(": ")
    yield f"{message[0]}: {_anonymous(message[2])}"


def _place(filename: str) -> str | None:
    """Path of a file of this package or a library relative to its installation, or else None."""
    path = Path(filename)
    if path.is_relative_to(_OURS):
        return f"pipeline/{path.relative_to(_OURS).as_posix()}"
    parts = path.parts
    for above in ("site-packages", "dist-packages", f"python3.{sys.version_info.minor}"):
        if above in parts:
            return "/".join(parts[len(parts) - parts[::-1].index(above) :])
    return None


def _anonymous(words: str) -> str:
    """Message of an exception without possible user data: quoted text, paths, values, names.

    Words in lower case and integers below 1000 remain.
    """
    for kind in (_QUOTED, _PATH, _NUMBER):
        words = kind.sub("…", words)
    return " ".join(one for one in words.split() if _PLAIN.fullmatch(one))[:300]


def _version(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "not installed"
