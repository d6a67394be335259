"""`python -m bench.mutants ROOM`: plant bugs, and list those that the tests of the room miss."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.mutants.draw import Bug, bug, functions
from bench.mutants.play import SECONDS, Reached, apart, reached, tested_with, warm

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pipeline"
MANY_S = 1800.0
"""Maximum time for all fast tests of a room [s]."""

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@command.command()
def mutants(
    room: Annotated[str, typer.Argument(help="Folder of pipeline/, such as system.")],
    cases: Annotated[int, typer.Option(min=1, help="How many, from --first on.")] = 20,
    first: Annotated[int, typer.Option(min=0, help="Number of the first case.")] = 0,
    results: Annotated[Path, typer.Option(help="Where finished cases are kept.")] = Path(
        "build/mutants.jsonl"
    ),
) -> None:
    """Plant bugs at random in a room of the package, and list those that its fast tests miss."""
    warm()
    code = _code(room)
    kept = {row["case"]: row for row in _kept(results) if row["code"] == code}
    of = _reached(room, code, results.parent)
    results.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    for case in range(first, first + cases):
        row = kept.get(f"{room} {case}") or {
            "case": f"{room} {case}",
            "code": code,
            **played(bug(PACKAGE, room, case), room, of),
        }
        if row["case"] not in kept:
            with results.open("a", encoding="utf-8") as out:
                out.write(json.dumps(row) + "\n")
        rows.append(row)
        if row["outcome"] != "caught":
            typer.echo(_told(row))
    caught = sum(row["outcome"] == "caught" for row in rows)
    typer.echo(f"{room}: {caught} of {len(rows)} caught by the tests of their own room")


def played(planted: Bug, room: str, of: Reached) -> dict[str, Any]:
    """Whether the room's tests that enter the function fail, and if not, whether any of it does."""
    at = f"{planted.file}:{_first_line(planted)}"
    enter = [test for test, seen in of.items() if at in seen["of"]]
    enter.sort(key=lambda test: of[test]["s"])
    module = "pipeline." + planted.file.removesuffix(".py").replace("/", ".")
    module = module.removesuffix(".__init__")
    outcome = "not entered" if not enter else "missed"
    if enter:
        told = apart(partial(tested_with, planted.source, module, enter), SECONDS)
        outcome = "missed" if told == 0 else "caught"
    return {
        "outcome": outcome,
        "file": planted.file,
        "line": planted.line,
        "function": planted.function,
        "kind": planted.kind,
        "before": planted.before,
        "after": planted.after,
        "tests": len(enter),
    }


def _first_line(planted: Bug) -> int:
    """Line where the function begins for Python: that of its first decorator."""
    source = (PACKAGE / planted.file).read_text("utf-8")
    for name, node, _ in functions(source):
        if name == planted.function:
            return min([node.lineno, *(one.lineno for one in node.decorator_list)])
    raise KeyError(planted.function)


def _tests(room: str) -> list[str]:
    return [
        str(path.relative_to(ROOT)) for path in sorted((ROOT / "tests" / room).rglob("test_*.py"))
    ]


def _reached(room: str, code: str, place: Path) -> Reached:
    """What the room's tests enter, kept beside the results."""
    path = place / f"reached-{room}-{code}.json"
    if not path.is_file():
        place.mkdir(parents=True, exist_ok=True)
        told = apart(partial(reached, PACKAGE, _tests(room)), MANY_S)
        path.write_text(json.dumps(told), "utf-8")
    return json.loads(path.read_text("utf-8"))


def _code(room: str) -> str:
    """Version of the package and of the room's tests."""
    every = sorted([*PACKAGE.rglob("*.py"), *(ROOT / "tests" / room).rglob("*.py")])
    return sha256(b"".join(path.read_bytes() for path in every)).hexdigest()[:12]


def _kept(results: Path) -> Iterator[dict[str, Any]]:
    if results.is_file():
        yield from map(json.loads, results.read_text("utf-8").splitlines())


def _told(row: dict[str, Any]) -> str:
    where = f"{row['file']}:{row['line']} {row['function']}"
    return f"{row['outcome']} ({row['tests']} tests)  {where}, {row['kind']}\n" + "\n".join(
        f"  {sign} {line}"
        for sign, text in (("-", row["before"]), ("+", row["after"]))
        for line in text.splitlines()[:6]
    )


if __name__ == "__main__":
    command()
