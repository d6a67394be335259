"""Mutations of cells, columns, titles and rows of exports, logs and displacements."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bench.fuzz.mutation import Mutation, one, raw, two
from bench.fuzz.sheet import NUMBER, Edit, Sheet, on_any, put

# --- cells ---------------------------------------------------------------------------------------


def _times(factor: float) -> Callable[[str], str]:
    return lambda cell: f"{float(cell) * factor:.9g}"


_WORDS = {
    "nan": "nan",
    "inf": "inf",
    "-inf": "-inf",
    "huge": "1e160",
    "largest": "1.7976931348623157e308",
    "beyond": "1e999",
    "subnormal": "5e-324",
    "small": "1e-160",
    "zero": "0",
    "nothing": "",
    "formula": "=1+1",
    "words": "n/a",
    "grouped": "1,234",
    "underscore": "1_000",
    "hexadecimal": "0x1F",
    "wide digits": raw("１２３"),
    "minus sign": raw("\u22125.1"),
    "many digits": "1" * 5000,
    "control": "\x1b[2J1.0",
    "right to left": raw("\u202e1.0"),
    "html": "<script>alert(1)</script>",
    "true": "True",
    "date": "2026-11-03",
    "line end": "1\n2",
}

_FACTORS = {
    "x 1000": 1000.0,
    "x 0.001": 0.001,
    "x 25.4": 25.4,
    "/ 25.4": 1 / 25.4,
    "deg to rad": math.pi / 180,
    "rad to deg": 180 / math.pi,
    "negated": -1.0,
    "x 1.01": 1.01,
    "x 10": 10.0,
    "kgf": 1 / 9.80665,
}

_CHANGES: dict[str, Callable[[str], str]] = {
    **{name: (lambda cell, word=word: word) for name, word in _WORDS.items()},
    **{name: _times(factor) for name, factor in _FACTORS.items()},
    "decimal comma": lambda cell: cell.replace(".", ","),
    "in quotes": lambda cell: f'"{cell}"',
    "in apostrophes": lambda cell: f"'{cell}",
    "blanks inside": lambda cell: f" {cell[:2]} {cell[2:]} ",
    "rounded": lambda cell: f"{float(cell):.0f}",
}


def _cells(scope: str, change: Callable[[str], str]) -> Edit:
    def edit(sheet: Sheet, rng: np.random.Generator) -> Sheet:
        cells = sheet.numbers()
        if not cells:
            return sheet
        row, column = one(rng, cells)
        hit = {
            "one": lambda r, c: (r, c) == (row, column),
            "column of": lambda r, c: c == column,
            "row of": lambda r, c: r == row,
        }[scope]
        rows = [list(cells) for cells in sheet.rows]
        for r, c in cells:
            if hit(r, c):
                rows[r][c] = change(rows[r][c])
        return Sheet(tuple(map(tuple, rows)), sheet.delimiter, sheet.ending, sheet.first)

    return edit


def _other(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    size = 10.0 ** rng.uniform(-6, 4)
    return _cells("one", lambda cell: f"{float(cell) + rng.normal(0, size):.6f}")(sheet, rng)


# --- columns -------------------------------------------------------------------------------------

Columns = Callable[[list[list[str]], int, np.random.Generator], list[list[str]]]


def _columns(change: Columns) -> Edit:
    """Change the columns including titles, with all rows padded to the width of the first."""

    def edit(sheet: Sheet, rng: np.random.Generator) -> Sheet:
        start = max(sheet.first - 1, 0)
        rows, width = sheet.rows[start:], len(sheet.body[0])
        rows = tuple((*row, *[""] * (width - len(row)))[:width] for row in rows)
        columns = change([list(c) for c in zip(*rows, strict=True)], len(rows), rng)
        body = tuple(zip(*columns, strict=True))
        return Sheet((*sheet.rows[:start], *body), sheet.delimiter, sheet.ending, sheet.first)

    return edit


def _column_lost(columns: list[list[str]], _: int, rng: np.random.Generator) -> list[list[str]]:
    k = int(rng.integers(len(columns)))
    return [*columns[:k], *columns[k + 1 :]] or columns


def _column_twice(columns: list[list[str]], _: int, rng: np.random.Generator) -> list[list[str]]:
    k = int(rng.integers(len(columns)))
    return [*columns[:k], columns[k], *columns[k:]]


def _columns_moved(columns: list[list[str]], _: int, rng: np.random.Generator) -> list[list[str]]:
    return [columns[k] for k in rng.permutation(len(columns))]


def _cells_moved(columns: list[list[str]], _: int, rng: np.random.Generator) -> list[list[str]]:
    a, b = two(rng, len(columns))
    first, second = columns[a], columns[b]
    columns[a], columns[b] = [first[0], *second[1:]], [second[0], *first[1:]]
    return columns


def _constant(columns: list[list[str]], rows: int, rng: np.random.Generator) -> list[list[str]]:
    k = int(rng.integers(len(columns)))
    columns[k] = [columns[k][0], *[columns[k][-1]] * (rows - 1)]
    return columns


def _emptied(columns: list[list[str]], rows: int, rng: np.random.Generator) -> list[list[str]]:
    k = int(rng.integers(len(columns)))
    columns[k] = [columns[k][0], *[""] * (rows - 1)]
    return columns


def _shifted(columns: list[list[str]], _: int, rng: np.random.Generator) -> list[list[str]]:
    k = int(rng.integers(len(columns)))
    columns[k] = [columns[k][0], columns[k][-1], *columns[k][1:-1]]
    return columns


def _further(columns: list[list[str]], rows: int, rng: np.random.Generator) -> list[list[str]]:
    return [*columns, [one(rng, ["remark", "", "x_mm", "pose"]), *["7"] * (rows - 1)]]


_COLUMNS: dict[str, Columns] = {
    "lost": _column_lost,
    "twice": _column_twice,
    "in another order": _columns_moved,
    "under each other's titles": _cells_moved,
    "constant": _constant,
    "emptied": _emptied,
    "one row late": _shifted,
    "one more": _further,
}

# --- titles --------------------------------------------------------------------------------------

_UNITS = [
    ("_mm", "_m"),
    ("_m", "_mm"),
    ("_deg", "_rad"),
    ("_n", "_kn"),
    ("_n", "_lbf"),
    ("_n", "_kgf"),
]
_UNITS += [("[mm]", "[m]"), ("[mm]", "[in]"), ("Millimeters", "Meters"), ("Millimeters", "Inches")]
_UNITS += [("_m", "_in"), ("_deg", "_gon"), ("_m", "_furlong")]

_HOSTILE = [
    "",
    " ",
    "pose",
    "x_mm",
    "\x07",
    raw("\u202e"),
    "A" * 10_000,
    "<b>",
    "../x",
    "\0",
    "nan",
]


def _titles(change: Callable[[list[str], np.random.Generator], list[str]]) -> Edit:
    def edit(sheet: Sheet, rng: np.random.Generator) -> Sheet:
        if not sheet.first:
            return sheet
        titles = tuple(change(list(sheet.titles), rng))
        rows = (*sheet.rows[: sheet.first - 1], titles, *sheet.body)
        return Sheet(rows, sheet.delimiter, sheet.ending, sheet.first)

    return edit


def _unit(everywhere: bool) -> Edit:
    def edit(sheet: Sheet, rng: np.random.Generator) -> Sheet:
        above = [sheet.delimiter.join(row) for row in sheet.rows[: sheet.first]]
        able = [pair for pair in _UNITS if any(pair[0] in line for line in above)]
        if not able:
            return sheet
        old, new = one(rng, able)
        count = -1 if everywhere else 1
        above = [line.replace(old, new, count) for line in above]
        rows = tuple(tuple(line.split(sheet.delimiter)) for line in above)
        return Sheet((*rows, *sheet.body), sheet.delimiter, sheet.ending, sheet.first)

    return edit


def _title_lost(titles: list[str], rng: np.random.Generator) -> list[str]:
    k = int(rng.integers(len(titles)))
    return [*titles[:k], *titles[k + 1 :]]


def _title_twice(titles: list[str], rng: np.random.Generator) -> list[str]:
    a, b = two(rng, len(titles))
    titles[a] = titles[b]
    return titles


def _titles_moved(titles: list[str], rng: np.random.Generator) -> list[str]:
    a, b = two(rng, len(titles))
    titles[a], titles[b] = titles[b], titles[a]
    return titles


def _title_hostile(titles: list[str], rng: np.random.Generator) -> list[str]:
    titles[int(rng.integers(len(titles)))] = one(rng, _HOSTILE)
    return titles


def _no_titles(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    return Sheet(sheet.body, sheet.delimiter, sheet.ending, 0)


def _titles_again(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    k = int(rng.integers(len(sheet.body)))
    return sheet.with_body([*sheet.body[:k], sheet.titles, *sheet.body[k:]])


_TITLES: dict[str, Edit] = {
    "one unit": _unit(False),
    "every unit": _unit(True),
    "one lost": _titles(_title_lost),
    "one twice": _titles(_title_twice),
    "two exchanged": _titles(_titles_moved),
    "hostile": _titles(_title_hostile),
    "capitals": _titles(lambda titles, rng: [title.upper() for title in titles]),
    "blanks": _titles(lambda titles, rng: [f"  {title} " for title in titles]),
    "none": _no_titles,
    "again below": _titles_again,
}

# --- rows ----------------------------------------------------------------------------------------

Rows = list[tuple[str, ...]]


def _rows(change: Callable[[Rows, np.random.Generator], Rows]) -> Edit:
    return lambda sheet, rng: sheet.with_body(change(list(sheet.body), rng))


def _twice(rows: Rows, rng: np.random.Generator) -> Rows:
    return [*rows, one(rng, rows)]


def _twice_other(rows: Rows, rng: np.random.Generator) -> Rows:
    row = one(rng, rows)
    able = [k for k, cell in enumerate(row) if NUMBER.fullmatch(cell)]
    if not able:
        return rows
    k = one(rng, able)
    return [*rows, put(row, k, _times(1.5)(row[k]))]


def _row_lost(rows: Rows, rng: np.random.Generator) -> Rows:
    k = int(rng.integers(len(rows)))
    return [*rows[:k], *rows[k + 1 :]]


def _rows_moved(rows: Rows, rng: np.random.Generator) -> Rows:
    return [rows[k] for k in rng.permutation(len(rows))]


def _rows_exchanged(rows: Rows, rng: np.random.Generator) -> Rows:
    a, b = two(rng, len(rows))
    rows[a], rows[b] = rows[b], rows[a]
    return rows


def _few(rows: Rows, rng: np.random.Generator) -> Rows:
    return rows[: one(rng, [0, 0, 1, 2, 3, 5])]


def _half(rows: Rows, rng: np.random.Generator) -> Rows:
    return [row for row in rows if rng.random() < 0.5]


def _short(rows: Rows, rng: np.random.Generator) -> Rows:
    k = int(rng.integers(len(rows)))
    rows[k] = rows[k][: int(rng.integers(len(rows[k])))]
    return rows


def _long(rows: Rows, rng: np.random.Generator) -> Rows:
    k = int(rng.integers(len(rows)))
    rows[k] = (*rows[k], *["9"] * one(rng, [1, 5, 5000]))
    return rows


_ROWS = {
    "one twice": _twice,
    "one twice, with another number": _twice_other,
    "one lost": _row_lost,
    "shuffled": _rows_moved,
    "two exchanged": _rows_exchanged,
    "few": _few,
    "half": _half,
    "too short": _short,
    "too long": _long,
}

MUTATIONS = (
    Mutation("cell:another number", on_any(_other)),
    *(
        Mutation(f"cell:{scope} {name}", on_any(_cells(scope, change)))
        for scope in ("one", "column of", "row of")
        for name, change in _CHANGES.items()
    ),
    *(Mutation(f"column:{name}", on_any(_columns(change))) for name, change in _COLUMNS.items()),
    *(Mutation(f"title:{name}", on_any(edit)) for name, edit in _TITLES.items()),
    *(Mutation(f"row:{name}", on_any(_rows(change))) for name, change in _ROWS.items()),
)
