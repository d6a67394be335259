"""Mutations of bytes, lines and encodings of any file, including campaign.toml."""

from __future__ import annotations

import gzip
from collections.abc import Callable

import numpy as np

from bench.fuzz.mutation import Act, Files, Mutation, one, raw, text, two

Spoil = Callable[[bytes, np.random.Generator], bytes]


def _any_file(spoil: Spoil) -> Act:
    def act(files: Files, rng: np.random.Generator) -> Files:
        name = one(rng, sorted(files))
        return {**files, name: spoil(files[name], rng)}

    return act


def _at(data: bytes, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data) + 1))


def _bit(data: bytes, rng: np.random.Generator) -> bytes:
    k = _at(data[:-1], rng)
    return (
        data[:k] + bytes(b ^ (1 << int(rng.integers(8))) for b in data[k : k + 1]) + data[k + 1 :]
    )


def _lost(data: bytes, rng: np.random.Generator) -> bytes:
    k = _at(data, rng)
    return data[:k] + data[k + one(rng, [1, 1, 5, 60, 400]) :]


_EXTRA = [b",", b";", b'"', b"'", b"\n", b"\r", b"\t", b" ", b"\0", b"\xff", b"\x1b[31m", b"#"]
_EXTRA += [raw("\u202e").encode("latin-1"), raw("🤖").encode("latin-1"), b"=", b"[", b"]", b"\\"]
_EXTRA += [b"\xef\xbb\xbf", b"-", b".", b"0", b"e9", b"x" * 10_000, b"\x85", b"\xe2\x80\xa8"]


def _more(data: bytes, rng: np.random.Generator) -> bytes:
    k = _at(data, rng)
    return data[:k] + one(rng, _EXTRA) + data[k:]


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _at(data, rng)]


def _lines(change: Callable[[list[bytes], np.random.Generator], list[bytes]]) -> Spoil:
    return lambda data, rng: b"".join(change(data.splitlines(keepends=True) or [b""], rng))


def _doubled(lines: list[bytes], rng: np.random.Generator) -> list[bytes]:
    k = int(rng.integers(len(lines)))
    return [*lines[:k], lines[k], *lines[k:]]


def _without(lines: list[bytes], rng: np.random.Generator) -> list[bytes]:
    k = int(rng.integers(len(lines)))
    return [*lines[:k], *lines[k + one(rng, [1, 1, 1, 5]) :]]


def _exchanged(lines: list[bytes], rng: np.random.Generator) -> list[bytes]:
    a, b = two(rng, len(lines))
    return [*lines[:a], lines[b], *lines[a + 1 : b], lines[a], *lines[b + 1 :]]


def _shuffled(lines: list[bytes], rng: np.random.Generator) -> list[bytes]:
    return [lines[k] for k in rng.permutation(len(lines))]


def _blank(lines: list[bytes], rng: np.random.Generator) -> list[bytes]:
    k = int(rng.integers(len(lines)))
    return [*lines[:k], one(rng, [b"\n", b"  \r\n", b",,,,\n", b";;;\n", b"\x0c\n"]), *lines[k:]]


def _coded(name: str) -> Spoil:
    return lambda data, rng: text(data).encode(name, "replace")


def _noise(data: bytes, rng: np.random.Generator) -> bytes:
    return bytes(rng.integers(0, 256, one(rng, [1, 50, 3000])).astype(np.uint8))


def _as_is(content: bytes) -> Spoil:
    return lambda data, rng: content


_ENCODINGS = ("utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-8-sig", "cp500")

_SPOILS: dict[str, Spoil] = {
    "one bit": _bit,
    "lost": _lost,
    "more": _more,
    "cut": _cut,
    "line twice": _lines(_doubled),
    "line lost": _lines(_without),
    "lines exchanged": _lines(_exchanged),
    "lines shuffled": _lines(_shuffled),
    "blank line": _lines(_blank),
    "old line ends": lambda data, rng: data.replace(b"\r\n", b"\n").replace(b"\n", b"\r"),
    "no line ends": lambda data, rng: data.replace(b"\n", b" "),
    "file twice": lambda data, rng: data + data,
    "empty": _as_is(b""),
    "blanks": _as_is(b" \n \n"),
    "zeros": _as_is(b"\0" * 5000),
    "noise": _noise,
    "zipped": lambda data, rng: gzip.compress(data, mtime=0),
    "points to commas": lambda data, rng: data.replace(b".", b","),
    "commas to semicolons": lambda data, rng: data.replace(b",", b";"),
    "commas to tabs": lambda data, rng: data.replace(b",", b"\t"),
    "all in quotes": lambda data, rng: b'"' + data.replace(b",", b'","') + b'"',
    **{f"as {name}": _coded(name) for name in _ENCODINGS},
}


def _missing(files: Files, rng: np.random.Generator) -> Files:
    gone = one(rng, sorted(files))
    return {name: data for name, data in files.items() if name != gone}


def _mistaken(files: Files, rng: np.random.Generator) -> Files:
    names = sorted(files)
    a, b = two(rng, len(names))
    return {**files, names[a]: files[names[b]], names[b]: files[names[a]]}


MUTATIONS = (
    *(Mutation(f"bytes:{name}", _any_file(spoil)) for name, spoil in _SPOILS.items()),
    Mutation("bytes:file missing", _missing),
    Mutation("bytes:two files exchanged", _mistaken),
)
