"""All named numbers of the package, with value, unit and meaning.

Their page is part of the site (`make docs`) and is made from the code each time, so that it cannot
become outdated and no constant is documented twice.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "pipeline"

_HEAD = """# Constants

Every number that has a name in the package, made from the code; [1] is the unit of ratios. What a
user may set stands in [campaign.toml](campaign.md). Which of these decide a verdict, and with which
rate of false alarms, stands in [how a verdict comes about](verdict.md).
"""

_UNIT = re.compile(r" ?\[([^\]]+)\]")


@dataclass(frozen=True)
class Constant:
    """A named number.

    Attributes:
        module: Its file, relative to the package.
        name: Name as written.
        value: Value as written, which shows whether it is a power of two or a product.
        unit: Content of the brackets in the sentence below it; empty for a count.
        meaning: That sentence, with its source if it has one.
    """

    module: str
    name: str
    value: str
    unit: str
    meaning: str


@cache
def constants() -> tuple[Constant, ...]:
    """Constants of all modules, in the order of files and lines."""
    files = sorted(PACKAGE.rglob("*.py"))
    each = (of(one.read_text("utf-8"), one.relative_to(PACKAGE).as_posix()) for one in files)
    return tuple(constant for some in each for constant in some)


def of(source: str, module: str) -> Iterator[Constant]:
    """Constants of one module."""
    body = ast.parse(source).body
    for statement, after in zip(body, [*body[1:], None], strict=True):
        name, value = _assigned(statement)
        if value is not None and _is_number(value):
            meaning = _sentence(after)
            unit = _UNIT.search(meaning)
            told = _UNIT.sub("", meaning, count=1)
            yield Constant(module, name, ast.unparse(value), unit[1] if unit else "", told)


def _assigned(statement: ast.stmt) -> tuple[str, ast.expr | None]:
    match statement:
        case ast.Assign(targets=[ast.Name(id=name)], value=value):
            return name, value
        case ast.AnnAssign(target=ast.Name(id=name), value=value):
            return name, value
    return "", None


def _is_number(value: ast.expr) -> bool:
    """Whether it is a number, or an arithmetic expression of numbers."""
    match value:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=inner):
            return _is_number(inner)
        case ast.BinOp(left=left, right=right):
            return _is_number(left) and _is_number(right)
    return False


def _sentence(statement: ast.stmt | None) -> str:
    match statement:
        case ast.Expr(value=ast.Constant(value=str() as text)):
            return " ".join(text.split())
    return ""


def page() -> str:
    """Markdown with a table for every package."""
    rooms = groupby(constants(), lambda one: one.module.partition("/")[0])
    return "\n".join([_HEAD, *(line for room, found in rooms for line in _table(room, found))])


def _table(room: str, found: Iterator[Constant]) -> Iterator[str]:
    yield from (f"## {room}", "", "| constant | value | unit | meaning |", "|---|---|---|---|")
    for one in found:
        name = f"`{one.module.partition('/')[2] or one.module}` `{one.name}`"
        cells = (name, f"`{one.value}`", one.unit, one.meaning)
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
    yield ""
