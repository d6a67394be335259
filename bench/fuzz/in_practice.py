"""Blunders made in practice: shifted logs, wrong tool points, few poses, mixed campaigns."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from bench.fuzz.bases import NAMES, base
from bench.fuzz.mutation import (
    TOML,
    Act,
    Files,
    Mutation,
    data_of,
    one,
    tables,
    text,
    two,
    with_text,
)
from bench.fuzz.sheet import NUMBER, Edit, Sheet, on, put, sheet

# --- joints and forces -------------------------------------------------------------------------


def _values(change: Callable[[list[float], np.random.Generator], list[float]], begins: str) -> Edit:
    """Change all numbers in the column whose title begins with `begins`; if empty, of any joint."""

    def edit(read: Sheet, rng: np.random.Generator) -> Sheet:
        able = [k for k, title in enumerate(read.titles) if title.endswith(("_deg", "_m", "_rad"))]
        k = read.column(begins) if begins else (one(rng, able) if able else None)
        if k is None or not all(k < len(row) and NUMBER.fullmatch(row[k]) for row in read.body):
            return read
        changed = change([float(row[k]) for row in read.body], rng)
        return read.with_column(k, [f"{value:.6f}" for value in changed])

    return edit


def _all(factor: float) -> Callable[[list[float], np.random.Generator], list[float]]:
    return lambda values, rng: [factor * value for value in values]


def _plus(size: float) -> Callable[[list[float], np.random.Generator], list[float]]:
    return lambda values, rng: [value + size for value in values]


def _single(factor: float, size: float = 0.0) -> Callable[..., list[float]]:
    def change(values: list[float], rng: np.random.Generator) -> list[float]:
        k = int(rng.integers(len(values)))
        return [factor * v + size if i == k else v for i, v in enumerate(values)]

    return change


def _late(values: list[float], rng: np.random.Generator) -> list[float]:
    return [values[0], *values[:-1]]


def _poses_exchanged(read: Sheet, rng: np.random.Generator) -> Sheet:
    """Exchange the poses of two rows of the log."""
    k, (a, b) = read.column("pose"), two(rng, len(read.body))
    if k is None or max(map(len, (read.body[a], read.body[b]))) <= k:
        return read
    body = list(read.body)
    body[a], body[b] = put(body[a], k, read.body[b][k]), put(body[b], k, read.body[a][k])
    return read.with_body(body)


def _poses_late(read: Sheet, rng: np.random.Generator) -> Sheet:
    """Give every row the values of the previous one."""
    k = read.column("pose")
    if k is None:
        return read
    rows = read.body
    return read.with_body(
        [
            put(before, k, row[k])
            for row, before in zip(rows, (rows[0], *rows[:-1]), strict=True)
            if k < len(row)
        ]
    )


def _one_pose(factor: float) -> Edit:
    """Multiply all forces of one pose."""

    def edit(read: Sheet, rng: np.random.Generator) -> Sheet:
        pose = read.column("pose")
        able = [
            k
            for k, title in enumerate(read.titles)
            if title.startswith(("force", "fx", "fy", "fz"))
        ]
        if pose is None or not able:
            return read
        chosen = one(rng, read.body)[pose : pose + 1]
        return read.with_body(
            [
                tuple(
                    f"{factor * float(cell):.3f}" if k in able and NUMBER.fullmatch(cell) else cell
                    for k, cell in enumerate(row)
                )
                if row[pose : pose + 1] == chosen
                else row
                for row in read.body
            ]
        )

    return edit


def _emptied(begins: str) -> Edit:
    def edit(read: Sheet, rng: np.random.Generator) -> Sheet:
        k = read.column(begins)
        return read if k is None else read.with_column(k, [""] * len(read.body))

    return edit


def _words_turned(begins: str, words: Sequence[str]) -> Edit:
    def edit(read: Sheet, rng: np.random.Generator) -> Sheet:
        k = read.column(begins)
        if k is None:
            return read
        return read.with_column(k, [words[int(rng.integers(len(words)))] for _ in read.body])

    return edit


_JOINTS = {
    "two poses exchanged": _poses_exchanged,
    "one row late": _poses_late,
    "sign of one joint": _values(_all(-1.0), ""),
    "one joint late": _values(_late, ""),
    "one joint 5 off": _values(_plus(5.0), ""),
    "one joint 0.5 off": _values(_plus(0.5), ""),
    "one value 2 off": _values(_single(1.0, 2.0), ""),
    "one value negated": _values(_single(-1.0), ""),
    "one value a turn on": _values(_single(1.0, 360.0), ""),
    "approach turned": _words_turned("approach", ["1", "-1"]),
    "approach odd": _words_turned("approach", ["2", "0", "up", "nan"]),
    "approach empty": _emptied("approach"),
}

_LOADS = {
    "one x 1.2": _values(_single(1.2), "force"),
    "one x 10": _values(_single(10.0), "force"),
    "one negated": _values(_single(-1.0), "force"),
    "one zero": _values(_single(0.0), "force"),
    "one pose doubled": _one_pose(2.0),
    "two exchanged": _poses_exchanged,
    "one row late": _values(_late, "force"),
    "all x 2": _values(_all(2.0), "force"),
    "all x 1.2": _values(_all(1.2), "force"),
    "all in kgf": _values(_all(1 / 9.80665), "force"),
    "all in kN": _values(_all(1e-3), "force"),
    "all negated": _values(_all(-1.0), "force"),
    "tare 100 N": _values(_plus(100.0), "force"),
    "all alike": _values(lambda values, rng: [values[0]] * len(values), "force"),
    "branch odd": _words_turned("branch", ["up", "down", "sideways", ""]),
    "branch turned": _words_turned("branch", ["up", "down"]),
}

_FORCES = {
    "one pose doubled": _one_pose(2.0),
    "fx negated": _values(_all(-1.0), "fx"),
    "all fz late": _values(_late, "fz"),
    "one x 10": _values(_single(10.0), "fy"),
}

# --- readings ------------------------------------------------------------------------------------


def _export(files: Files) -> str | None:
    """The file with readings, or with names of readings."""
    names = [n for n in files if n.startswith(("assignment", "tracker", "displacements"))]
    return sorted(names)[0] if names else None


def _lines(change: Callable[[list[str], np.random.Generator], list[str]]) -> Act:
    """Change the lines of the export."""

    def act(files: Files, rng: np.random.Generator) -> Files:
        name = _export(files)
        if name is None:
            return files
        lines = text(files[name]).splitlines(keepends=True)
        return {**files, name: data_of("".join(change(lines, rng)))} if lines else files

    return act


def _names_exchanged(first: str, second: str) -> Act:
    def swap(line: str) -> str:
        names = {first: second, second: first}
        return re.sub(rf"\b({first}|{second})\b", lambda m: names[m[0]], line)

    return _lines(lambda lines, rng: [swap(line) for line in lines])


def _names_exchanged_once(first: str, second: str) -> Act:
    """Exchange two names in one group only."""

    def change(lines: list[str], rng: np.random.Generator) -> list[str]:
        named = re.compile(r"pose\d+_rep\d+_\w+|base_\w+")
        able = [line for line in lines if re.search(rf"\b{first}\b", line)]
        groups = sorted({m[0] for line in able if (m := named.search(line))})
        if not groups:
            return lines
        group, names = one(rng, groups), {first: second, second: first}
        return [
            re.sub(rf"\b({first}|{second})\b", lambda m: names[m[0]], line)
            if group in line
            else line
            for line in lines
        ]

    return _lines(change)


def _groups_exchanged(lines: list[str], rng: np.random.Generator) -> list[str]:
    poses = sorted({m[1] for line in lines if (m := re.search(r"(pose\d+)_", line))})
    if len(poses) < 2:
        return lines
    a, b = (poses[k] for k in two(rng, len(poses)))
    names = {a: b, b: a}
    return [re.sub(rf"\b({a}|{b})(?=_)", lambda m: names[m[0]], line) for line in lines]


def _states_exchanged(lines: list[str], rng: np.random.Generator) -> list[str]:
    names = {"unloaded": "loaded", "loaded": "unloaded"}
    return [re.sub("unloaded|loaded", lambda m: names[m[0]], line) for line in lines]


def _without(pattern: str) -> Act:
    """Remove all lines that match; no change if an assignment counts the rows."""

    def act(files: Files, rng: np.random.Generator) -> Files:
        if any(name.startswith("assignment") for name in files):
            return files
        return _lines(lambda ls, rng: [line for line in ls if not re.search(pattern, line)])(
            files, rng
        )

    return act


def _first_poses(count: int) -> Act:
    """Keep only the first poses, in every file."""

    def kept(name: str, line: str) -> bool:
        found = (
            re.search(r"pose(\d+)_", line)
            if name.startswith("tracker")
            else re.match(r"(\d+),", line)
        )
        return found is None or int(found[1]) <= count

    def act(files: Files, rng: np.random.Generator) -> Files:
        if any(name.startswith("assignment") for name in files):
            return files
        return {
            name: data
            if name.endswith(".toml")
            else data_of("".join(filter(partial(kept, name), text(data).splitlines(keepends=True))))
            for name, data in files.items()
        }

    return act


def _first_pulls(files: Files, rng: np.random.Generator) -> Files:
    """Keep only one pull."""

    def kept(line: str) -> bool:
        found = re.search(r"pose(\d+)_rep(\d+)_loaded|^(\d+),(\d+),", line)
        if not found:
            return True
        pose, repeat = (found[1], found[2]) if found[1] else (found[3], found[4])
        return (int(pose), int(repeat)) == (1, 1)

    if any(name.startswith("assignment") for name in files):
        return files
    return {
        name: data
        if name.endswith(".toml") or name.startswith("joints")
        else data_of("".join(filter(kept, text(data).splitlines(keepends=True))))
        for name, data in files.items()
    }


def _moved(size: float, which: str) -> Act:
    """Shift readings of one target or of one group along x, in the export's unit."""

    def edit(read: Sheet, rng: np.random.Generator) -> Sheet:
        row = one(rng, read.body)
        able = [k for k, cell in enumerate(row) if NUMBER.fullmatch(cell) and "." in cell]
        words = [cell for cell in row if which in cell]
        if not able or not words:
            return read
        k = able[0]
        return read.with_body(
            [
                put(each, k, f"{float(each[k]) + size:.6f}")
                if words[0] in each and k < len(each) and NUMBER.fullmatch(each[k])
                else each
                for each in read.body
            ]
        )

    return on("tracker", edit)


_EXPORT: dict[str, Act] = {
    "P1 and P2 exchanged": _names_exchanged("P1", "P2"),
    "P1 and P2 exchanged once": _names_exchanged_once("P1", "P2"),
    "P3 and Pl1 exchanged once": _names_exchanged_once("P3", "Pl1"),
    "Pl1 and Pl2 exchanged": _names_exchanged("Pl1", "Pl2"),
    "Pl1 and Pl2 exchanged once": _names_exchanged_once("Pl1", "Pl2"),
    "B1 and B2 exchanged": _names_exchanged("B1", "B2"),
    "B1 and B2 exchanged once": _names_exchanged_once("B1", "B2"),
    "B1 and P1 exchanged": _names_exchanged("B1", "P1"),
    "two poses exchanged": _lines(_groups_exchanged),
    "loaded for unloaded": _lines(_states_exchanged),
    "no base reflectors": _without(r"base_"),
    "no chain": _without(r"\bPl\d\b"),
    "no zeros": _without("unloaded"),
    "no pulls": _without("_loaded"),
    "no P1": _without(r"\bP1\b"),
    "one target only": _without(r"\bP[23]\b"),
    "one base reflector": _without(r"\bB[234]\b"),
    "two base reflectors": _without(r"\bB[34]\b"),
    "one target moved 1": _moved(1.0, "P"),
    "one group moved 1": _moved(1.0, "_"),
    "one group moved 0.3": _moved(0.3, "_"),
    "1 pose": _first_poses(1),
    "2 poses": _first_poses(2),
    "3 poses": _first_poses(3),
    "5 poses": _first_poses(5),
    "1 pull": _first_pulls,
}

# --- plausible settings ---------------------------------------------------------------------


def _point(keys: str, change: Callable[[list[float], np.random.Generator], list[float]]) -> Act:
    """Change the coordinates of one of these points in campaign.toml."""
    line = re.compile(rf"(?m)^({keys}) = \[([^\]]*)\]")

    def act(files: Files, rng: np.random.Generator) -> Files:
        def edit(content: str) -> str:
            hits = list(line.finditer(content))
            if not hits:
                return content
            hit = one(rng, hits)
            try:
                values = [float(each) for each in hit[2].split(",")]
            except ValueError:
                return content
            new = f"{hit[1]} = {change(values, rng)}"
            return content[: hit.start()] + new + content[hit.end() :]

        return with_text(files, TOML, edit)

    return act


def _off(size: float) -> Callable[[list[float], np.random.Generator], list[float]]:
    def change(values: list[float], rng: np.random.Generator) -> list[float]:
        values[int(rng.integers(len(values)))] += size
        return [round(value, 9) for value in values]

    return change


def _alike(keys: str) -> Act:
    """Put all points at one place."""

    def edit(content: str) -> str:
        return re.sub(rf"(?m)^({keys}) = \[.*\]", r"\1 = [0.1, 0.2, 0.3]", content)

    return lambda files, rng: with_text(files, TOML, edit)


def _in_line(keys: str) -> Act:
    """Put all points on one line."""

    def act(files: Files, rng: np.random.Generator) -> Files:
        count = iter(range(100))
        return with_text(
            files,
            TOML,
            lambda t: re.sub(
                rf"(?m)^({keys}) = \[.*\]", lambda m: f"{m[1]} = [0.1, {next(count)}.0, 0.3]", t
            ),
        )

    return act


def _points_exchanged(first: str, second: str) -> Act:
    names = {first: second, second: first}
    return lambda files, rng: with_text(
        files, TOML, lambda t: re.sub(rf"(?m)^({first}|{second})(?= =)", lambda m: names[m[0]], t)
    )


def _point_lost(name: str) -> Act:
    return lambda files, rng: with_text(
        files, TOML, lambda t: re.sub(rf"(?m)^{name} = .*\n", "", t)
    )


_COVERED = ("load_point_offset",)
_POINTS = {
    "load point 5 cm off": (_point("load_point", _off(0.05)), _COVERED),
    "load point 5 mm off": (_point("load_point", _off(0.005)), _COVERED),
    "tool point 5 cm off": (_point(r"P\d", _off(0.05)), ()),
    "tool point 2 mm off": (_point(r"P\d", _off(0.002)), ()),
    "tool in mm": (_point(r"P\d|load_point", lambda v, rng: [1e3 * x for x in v]), _COVERED),
    "base reflector 5 cm off": (_point(r"B\d", _off(0.05)), ()),
    "base reflector 5 m off": (_point(r"B\d", _off(5.0)), ()),
    "base reflector in mm": (_point(r"B\d", lambda v, rng: [1e3 * x for x in v]), ()),
    "y and z exchanged": (_point(r"[BP]\d", lambda v, rng: [v[0], *v[:0:-1]]), ()),
    "tool points alike": (_alike(r"P\d|load_point"), ()),
    "targets alike": (_alike(r"P\d"), ()),
    "targets in line": (_in_line(r"P\d"), ()),
    "base reflectors alike": (_alike(r"B\d"), ()),
    "base reflectors in line": (_in_line(r"B\d"), ()),
    "P1 and P2 exchanged": (_points_exchanged("P1", "P2"), ()),
    "P1 and load point exchanged": (_points_exchanged("P1", "load_point"), ()),
    "B1 and B3 exchanged": (_points_exchanged("B1", "B3"), ()),
    "B4 lost": (_point_lost("B4"), ()),
    "P2 lost": (_point_lost("P2"), ()),
    "load point lost": (_point_lost("load_point"), ()),
}

# --- another campaign --------------------------------------------------------------------------


def _from_other(files: Files, rng: np.random.Generator) -> Files:
    """Replace one of its tables by that of another campaign."""
    names = tables(files)
    other = base(one(rng, NAMES))
    able = [name for name in names if name in other and other[name] != files[name]]
    return {**files, (name := one(rng, able)): other[name]} if able else files


def _merged(files: Files, rng: np.random.Generator) -> Files:
    """Append rows of another campaign to one of its tables."""
    names = tables(files)
    other = base(one(rng, NAMES))
    able = [name for name in names if name in other and other[name] != files[name]]
    if not able:
        return files
    name = one(rng, able)
    more = sheet(other[name])
    rows = text(files[name]) + "".join(more.delimiter.join(row) + "\n" for row in more.body)
    return {**files, name: data_of(rows)}


def _second(files: Files, rng: np.random.Generator) -> Files:
    """Add the export of another campaign, so that both are named."""
    other = base(one(rng, NAMES))
    exports = [name for name in other if name.startswith("tracker")]
    if not exports:
        return files
    added = {**files, "tracker2.csv": other[exports[0]]}
    return with_text(
        added, TOML, lambda t: re.sub(r'(?m)^files = \["', 'files = ["tracker2.csv", "', t)
    )


def _settings_of_other(files: Files, rng: np.random.Generator) -> Files:
    return {**files, TOML: base(one(rng, NAMES))[TOML]}


def _export_twice(files: Files, rng: np.random.Generator) -> Files:
    exports = [name for name in files if name.startswith("tracker")]
    if not exports:
        return files
    added = {**files, "again.csv": files[exports[0]]}
    return with_text(
        added, TOML, lambda t: re.sub(r'(?m)^files = \["', 'files = ["again.csv", "', t)
    )


MUTATIONS = (
    *(Mutation(f"joints:{name}", on("joints", edit)) for name, edit in _JOINTS.items()),
    *(Mutation(f"loads:{name}", on("loads", edit)) for name, edit in _LOADS.items()),
    *(Mutation(f"forces:{name}", on("forces", edit)) for name, edit in _FORCES.items()),
    *(Mutation(f"readings:{name}", act) for name, act in _EXPORT.items()),
    *(Mutation(f"points:{name}", act, covered=blind) for name, (act, blind) in _POINTS.items()),
    Mutation("other:one table", _from_other),
    Mutation("other:rows behind", _merged),
    Mutation("other:second export", _second),
    Mutation("other:settings", _settings_of_other),
    Mutation("other:export twice", _export_twice),
)
