"""A folder on object storage, read and written as named bytes, with one-sentence messages.

pyarrow accesses the storage of S3, Google and Azure; fsspec with its drivers all other addresses.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import Any, Self
from urllib.parse import urlsplit

from pipeline.base.errors import CannotWrite, InputError
from pipeline.base.shown import too_large
from pipeline.readers import largest
from pipeline.service.listing import NO_END, NO_STORAGE, listed, opened

Marks = dict[str, tuple[int, float]]
"""Objects by their name: size in bytes, and when each was put there [s since 1970]."""

_KEYS = "give a key that may: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or a profile"
_REFUSALS = (
    (
        NO_END.upper(),
        f"its listing has {NO_END}",
        "give a folder that holds campaigns alone, or see to the storage",
    ),
    (
        NO_STORAGE.upper(),
        "what answers there is no storage: it has whatever it is asked for, as a page to log in at",
        "log in to the network, or correct AWS_ENDPOINT_URL",
    ),
    ("NO_SUCH_BUCKET", "there is no such bucket", "make it, or correct the address"),
    (
        "SLOW_DOWN|SERVICE_UNAVAILABLE|INTERNAL_FAILURE|THROTTL|VALIDATION|STATUS 416",
        "it is busy or out of order",
        "run it again in a moment, as watch and serve do",
    ),
    ("ACCESS_DENIED|INVALID_|SIGNATURE|TOKEN|UNRECOGNIZED|CREDENTIAL", "access is denied", _KEYS),
    (
        "NETWORK|TIMEOUT|TIMED OUT|RESOLVE|REFUSED|UNREACHABLE|CONNECT|NO RESPONSE",
        "it cannot be reached",
        "check the network, and AWS_ENDPOINT_URL for a server of your own",
    ),
)
"""Pattern of a driver's message, what it means, and the remedy."""


@dataclass
class Store:
    """A folder on object storage.

    Attributes:
        url: Address, such as s3://bucket/folder.
    """

    url: str

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: nothing is kept open."""

    @property
    def shown(self) -> str:
        """Address without credentials."""
        parts = urlsplit(self.url)
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"

    @cached_property
    def _opened(self) -> tuple[Any, str]:
        """The file system, and the folder in it."""
        return opened(self.url)

    def marks(self) -> Marks:
        """Every object below, by its name from here: size in bytes, and when it was put there.

        Raises:
            InputError: It cannot be reached, read or found.
        """
        with self._reading():
            return {name: (size, put) for name, size, put in listed(*self._opened)}

    def has(self, name: str) -> bool:
        """Whether an object is there, asked for by itself.

        Raises:
            InputError: The storage does not say.
        """
        with self._reading():
            files, folder = self._opened
            return bool(files.get_file_info(f"{folder.rstrip('/')}/{name}").is_file)

    def read(self, name: str, mark: tuple[int, float]) -> bytes:
        """Content of one object.

        Args:
            name: Name relative to the folder.
            mark: Its size and time, as returned by `marks`.

        Raises:
            InputError: It cannot be read, or is served as it was before its last change: one of the
                machines of the storage may be behind.
        """
        with self._reading():
            data, digest = self._delivered(name, mark, b"\xa5")
            doubtful = re.fullmatch("[0-9a-f]{32}", digest) and digest != _md5(data)
            if doubtful or data.endswith(b"\xa5"):
                again, _ = self._delivered(name, mark, b"\x5a")
                if again != data:
                    raise self._unlike(name, "is cut, or not twice the same")
        return data

    def _delivered(self, name: str, mark: tuple[int, float], filling: bytes) -> tuple[bytes, str]:
        """Content of one object as delivered once, and its ETag.

        What a storage leaves out of the size that it states is the filling in the content: the
        driver does not count what it was given.
        """
        files, folder = self._opened
        with files.open_input_file(f"{folder.rstrip('/')}/{name}") as source:
            size, told = source.size(), _told(source.metadata())
            if size > largest(name):
                thing = f"{self.shown}/{name} {too_large(size, largest(name))}"
                raise InputError(thing, "split the export")
            put = _put(told)
            if size != mark[0] or (put is not None and put < mark[1] - _WHOLE_S):
                raise self._unlike(name, f"was given with {size} bytes, not as it is listed")
            data = bytearray(filling * size)
            source.readinto(data)
        return bytes(data), told.get("ETag", "").strip('"')

    def _unlike(self, name: str, how: str) -> InputError:
        return InputError(f"{self.shown}/{name} {how}", "run again in a moment", passing=True)

    def write(self, name: str, data: bytes) -> None:
        """Write an object, replacing an older one.

        Raises:
            CannotWrite: The storage refuses.
        """
        try:
            files, folder = self._opened
            path = f"{folder.rstrip('/')}/{name}"
            if files.type_name not in ("s3", "gcs", "abfs"):  # which have no folders
                files.create_dir(path.rpartition("/")[0], recursive=True)
            with files.open_output_stream(path) as sink:
                sink.write(data)
        except (OSError, ValueError, ImportError) as problem:
            thing, way_out = _explained(problem)
            words = f"{self.shown}/{name} cannot be written ({thing}); {way_out}."
            raise CannotWrite(words) from problem

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except (
            FileNotFoundError
        ) as problem:  # removed in the meantime, or one of its machines is behind
            thing = f"{self.shown} lists what is not there"
            raise InputError(thing, "run it again in a moment", passing=True) from problem
        except (OSError, ValueError, ImportError) as problem:
            thing, way_out = _explained(problem)
            raise InputError(
                f"{self.shown} cannot be read ({thing})", way_out, passing=True
            ) from problem


def _told(metadata: Mapping[bytes | str, bytes | str] | None) -> dict[str, str]:
    """What a driver knows about an object."""
    return {_text(word): _text(value) for word, value in (metadata or {}).items()}


def _put(told: Mapping[str, str]) -> float | None:
    """Time at which an object just read was stored [s since 1970]; None if it is not given."""
    with contextlib.suppress(KeyError, ValueError):
        return datetime.fromisoformat(told["Last-Modified"]).timestamp()
    return None


def _md5(data: bytes) -> str:
    """What an ETag is, without encryption by a key service and for uploads in one part."""
    return hashlib.md5(data, usedforsecurity=False).hexdigest()


def _text(word: bytes | str) -> str:
    return word.decode(errors="replace") if isinstance(word, bytes) else word


_WHOLE_S = 1.0
"""Tolerance of times [s]: a listing gives fractions of a second, an object whole seconds."""


def _explained(problem: Exception) -> tuple[str, str]:
    """Problem and remedy, from the message of a driver."""
    words = str(problem)
    for pattern, thing, way_out in _REFUSALS:
        if re.search(pattern, words.upper()):
            return thing, way_out
    short = " ".join(words.split())[:200].rstrip(" .")
    return short or type(problem).__name__, "correct its address in pipeline.toml"
