"""Mutations of a user's own robot file: lengths, limits, axes, names, joints."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from bench.fuzz.in_settings import with_key
from bench.fuzz.mutation import TOML, Act, Files, Mutation, data_of, one, raw, text, with_text
from pipeline.machine.robot import SHIPPED, load

OWN = "robot.toml"
_MEANT = "the geometry of a robot of one's own is what its user says it is"

Edit = Callable[[list[str], np.random.Generator], list[str]]
"""Changes the parts of a robot file: its head, each of its joints, and what follows."""

_END = "[controller]"


def _own(files: Files) -> Files:
    """The campaign with its robot as a file in the folder."""
    if OWN in files:
        return files
    found = re.search(r'(?m)^robot = "(\w+)"', text(files.get(TOML, b"")))
    if not found or found[1] not in SHIPPED:
        return files
    named = with_text(files, TOML, lambda t: with_key(t, "", "robot", f'"{OWN}"'))
    return {**named, OWN: load(found[1]).text.encode()}


def _parts(edit: Edit) -> Act:
    def act(files: Files, rng: np.random.Generator) -> Files:
        files = _own(files)
        if OWN not in files:
            return files
        head, *rest = text(files[OWN]).split("[[joint]]")
        last, mark, tail = rest[-1].partition(_END) if rest else ("", "", "")
        joints = [*rest[:-1], last]
        head, *joints, tail = edit([head, *joints, mark + tail], rng)
        return {**files, OWN: data_of("[[joint]]".join([head, *joints]) + tail)}

    return act


def _line(joint: str, key: str, value: str | None) -> str:
    """A joint with another value of a key, or without it."""
    line = "" if value is None else f"{key} = {value}"
    if re.search(rf"(?m)^{key}\s*=.*$", joint):
        return re.sub(rf"(?m)^{key}\s*=.*$", lambda _: line, joint)
    return f"{joint.rstrip()}\n{line}\n\n"


def _in_one(key: str, values: list[str | None]) -> Edit:
    def edit(parts: list[str], rng: np.random.Generator) -> list[str]:
        k = int(rng.integers(1, len(parts) - 1)) if len(parts) > 2 else 0
        parts[k] = _line(parts[k], key, one(rng, values))
        return parts

    return edit


def _in_all(key: str, values: list[str | None]) -> Edit:
    def edit(parts: list[str], rng: np.random.Generator) -> list[str]:
        value = one(rng, values)
        return [parts[0], *(_line(part, key, value) for part in parts[1:-1]), parts[-1]]

    return edit


_ODD: list[str | None] = ["0", "-1.0", "1e160", "nan", "inf", "1e-320", '"a"', "[1]", None, "true"]
_LENGTHS: list[str | None] = [*_ODD, "0.05", "55", "-0.3"]
_ANGLES: list[str | None] = [*_ODD, "90", "-90", "45", "1e6"]


def _limits_exchanged(parts: list[str], rng: np.random.Generator) -> list[str]:
    k = int(rng.integers(1, max(len(parts) - 1, 2)))
    parts[k] = (
        parts[k].replace("lower_", "lo_").replace("upper_", "lower_").replace("lo_", "upper_")
    )
    return parts


def _type_exchanged(parts: list[str], rng: np.random.Generator) -> list[str]:
    k = int(rng.integers(1, max(len(parts) - 1, 2)))
    words = {"prismatic": "revolute", "revolute": "prismatic"}
    parts[k] = re.sub("prismatic|revolute", lambda m: words[m[0]], parts[k])
    return parts


def _joint_twice(parts: list[str], rng: np.random.Generator) -> list[str]:
    k = int(rng.integers(1, max(len(parts) - 1, 2)))
    return [*parts[:k], parts[k], *parts[k:]]


def _many(parts: list[str], rng: np.random.Generator) -> list[str]:
    more = [re.sub(r'name = "', f'name = "again{k}_', parts[-2]) for k in range(one(rng, [5, 60]))]
    return [*parts[:-1], *more, parts[-1]]


def _moved(parts: list[str], rng: np.random.Generator) -> list[str]:
    order = rng.permutation(len(parts) - 2) + 1
    return [parts[0], *(parts[k] for k in order), parts[-1]]


def _head(key: str, values: list[str]) -> Edit:
    def edit(parts: list[str], rng: np.random.Generator) -> list[str]:
        parts[0] = with_key(parts[0], "", key, one(rng, values))
        return parts

    return edit


_HOSTILE = [
    r'"a\u0007\u001bb"',
    r'"a\nb"',
    r'"\u0000"',
    raw('"🤖"'),
    '"<b>&"',
    '""',
    '"' + "A" * 10_000 + '"',
]
_HOSTILE += ['"../x"', raw('"\u202eabc"'), '"a b"', '"1"', '"pose"', '"approach"']


def _controller(parts: list[str], rng: np.random.Generator) -> list[str]:
    count = len(parts) - 2
    axes = [f'"J{k + 1}"' for k in range(count)]
    zero = "[" + ", ".join(["[" + ", ".join(["0"] * count) + "]"] * count) + "]"
    one_row = "[[" + ", ".join(["1"] * count) + "]]"
    matrix = one(rng, [zero, one_row, "[[1e160]]", "[[nan]]", "[]", zero.replace("0", "1")])
    parts[-1] = f"{_END}\naxes = [{', '.join(axes)}]\nmatrix = {matrix}\n"
    return parts


_EDITS: dict[str, Edit] = {
    "one length d": _in_one("d_m", _LENGTHS),
    "one length r": _in_one("r_m", _LENGTHS),
    "one length a": _in_one("a_m", _LENGTHS),
    "all lengths d": _in_all("d_m", ["0", "1e160", "1e-160"]),
    "all lengths r": _in_all("r_m", ["0", "1e160", "1e-160"]),
    "one axis": _in_one("alpha_deg", _ANGLES),
    "all axes alike": _in_all("alpha_deg", ["0", "90", "180"]),
    "one offset": _in_one("theta_deg", _ANGLES),
    "lower limit": _in_one("lower_deg", [*_ODD, "400", "-1e9"]),
    "upper limit": _in_one("upper_deg", [*_ODD, "-400", "1e9"]),
    "rail's limits": _in_one("upper_m", _ODD),
    "limits exchanged": _limits_exchanged,
    "types exchanged": _type_exchanged,
    "another type": _in_one("type", ['"spherical"', '"fixed"', "1", None]),
    "one name": _in_one("name", [*_HOSTILE, '"theta2"', None]),
    "one name for all": _in_all("name", ['"theta2"']),
    "stiffness": _in_one("stiffness_nm_per_rad", [*_ODD, "1", "1e12"]),
    "stiffness of the rail": _in_one("stiffness_n_per_m", [*_ODD, "1", "1e30"]),
    "all stiffnesses": _in_all("stiffness_nm_per_rad", ["1e-300", "1e300", "1", "0"]),
    "unknown key": _in_one("length_m", ["1"]),
    "one joint": lambda parts, rng: [*parts[:2], parts[-1]],
    "two joints": lambda parts, rng: [*parts[:3], parts[-1]],
    "no joints": lambda parts, rng: [parts[0], parts[-1]],
    "one joint lost": lambda parts, rng: [*parts[:-2], parts[-1]],
    "one joint twice": _joint_twice,
    "many joints": _many,
    "joints in another order": _moved,
    "convention": _head("convention", ['"khalil"', '"craig"', '"standard"', '"x"', "1"]),
    "robot's name": _head("name", _HOSTILE),
    "description": _head("description", _HOSTILE),
    "assumptions": _head("assumptions", ["[]", f"[{_HOSTILE[0]}]", '"a"', "[1]"]),
    "format": _head("format", ["2", "nan", '"1"']),
    "controller": _controller,
    "no controller": lambda parts, rng: [*parts[:-1], ""],
}

MUTATIONS = (
    *(Mutation(f"robot:{name}", _parts(edit), _MEANT) for name, edit in _EDITS.items()),
    Mutation("robot:as it ships", lambda files, rng: _own(files)),
)
