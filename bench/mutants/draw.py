"""Where a bug can be planted in a function, and the source with it."""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

_COMPARED = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
_REPLACED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr,
}
_CALLED = {
    "min": "max",
    "max": "min",
    "any": "all",
    "all": "any",
    "argmin": "argmax",
    "argmax": "argmin",
    "minimum": "maximum",
    "maximum": "minimum",
    "mean": "sum",
    "cos": "sin",
    "sin": "cos",
    "sqrt": "abs",
    "cumsum": "cumprod",
    "hstack": "vstack",
}

_CHECKING = {"strict", "check_finite", "overwrite_a", "overwrite_c"}
"""Arguments that check values or save time: another one gives the same results."""


@dataclass(frozen=True)
class Bug:
    """A planted bug.

    Attributes:
        file: Path in the package.
        function: Qualified name of the function.
        line: Line where it stands.
        kind: What was changed.
        before, after: The statement without and with it.
        source: The whole module with it.
    """

    file: str
    function: str
    line: int
    kind: str
    before: str
    after: str
    source: str


@dataclass(frozen=True)
class _Site:
    """A node that can be changed: its number in the module's walk, and the change."""

    node: int
    kind: str
    change: Callable[[Any], None]


def bug(package: Path, room: str, seed: int) -> Bug:
    """A bug of this seed in one room.

    Functions are drawn in proportion to the number of their sites, so that a long one gets more.
    """
    rng = np.random.default_rng([seed, *room.encode()])
    every = [
        (path, name, node, sites)
        for path in sorted(_files(package, room))
        for name, node, sites in functions(path.read_text("utf-8"))
        if sites
    ]
    share = np.array([len(sites) for *_, sites in every], float)
    path, name, _, sites = every[rng.choice(len(every), p=share / share.sum())]
    site = sites[rng.integers(len(sites))]
    return _planted(path, path.relative_to(package), name, site)


def _files(package: Path, room: str) -> list[Path]:
    place = package / room
    return [*place.rglob("*.py")] if place.is_dir() else [place.with_suffix(".py")]


def functions(source: str) -> Iterator[tuple[str, ast.FunctionDef, list[_Site]]]:
    """Functions of a module with the sites of their bodies."""
    tree = ast.parse(source)
    number = {id(node): n for n, node in enumerate(ast.walk(tree))}
    for name, node in _named(tree, ""):
        inside = [one for part in node.body for one in _computing(part)]
        yield name, node, [site for one in inside for site in _sites(one, number[id(one)])]


def _computing(part: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a statement on which its result depends."""
    every = list(ast.walk(part))
    checks = [one.value for one in every if isinstance(one, ast.keyword) and one.arg in _CHECKING]
    free = [*checks, *(length for one in every for length in _lengths(one))]
    return (one for one in every if not any(one is same for same in free))


def _lengths(node: ast.AST) -> Iterator[ast.AST]:
    """The 1 of a length -1 in reshape, which follows from the others: any negative number does."""
    if isinstance(node, ast.Call) and getattr(node.func, "attr", None) == "reshape":
        for one in (part for argument in node.args for part in ast.walk(argument)):
            if isinstance(one, ast.UnaryOp) and ast.unparse(one) == "-1":
                yield one.operand


def _named(tree: ast.AST, of: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield of + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _named(node, f"{of}{node.name}.")


def _sites(node: ast.AST, number: int) -> Iterator[_Site]:
    """Changes of one node."""

    def site(kind: str, change: Callable[[Any], None]) -> _Site:
        return _Site(number, kind, change)

    match node:
        case ast.Compare(ops=[op]) if type(op) in _COMPARED:
            yield site("comparison", lambda n: _set(n, ops=[_COMPARED[type(n.ops[0])]()]))
        case ast.BinOp(op=op) if type(op) in _REPLACED and not _of_text(node):
            yield site("operator", lambda n: _set(n, op=_REPLACED[type(n.op)]()))
        case ast.AugAssign(op=op) if type(op) in _REPLACED:
            yield site("operator", lambda n: _set(n, op=_REPLACED[type(n.op)]()))
        case ast.BinOp(op=ast.Pow()):
            yield site("power dropped", lambda n: _set(n, op=ast.Mult(), right=ast.Constant(1)))
        case ast.UnaryOp(op=ast.USub(), operand=operand) if not isinstance(operand, ast.Constant):
            yield site("sign", lambda n: _set(n, op=ast.UAdd()))
        case ast.UnaryOp(op=ast.Not()):
            yield site("not", lambda n: _set(n, operand=ast.UnaryOp(ast.Not(), n.operand)))
        case ast.BoolOp():
            yield site("and, or", lambda n: _set(n, op=_other(n.op)))
        case ast.IfExp():
            yield site("branches exchanged", lambda n: _set(n, body=n.orelse, orelse=n.body))
        case ast.Constant(value=bool()):
            yield site("flag", lambda n: _set(n, value=not n.value))
        case ast.Constant(value=int() | float()):
            yield site("number", lambda n: _set(n, value=_another(n.value)))
        case ast.Call(func=ast.Attribute(attr=name)) if name in _CALLED:
            yield site("function", lambda n: _set(n.func, attr=_CALLED[n.func.attr]))
        case ast.Call(func=ast.Name(id=name)) if name in _CALLED:
            yield site("function", lambda n: _set(n.func, id=_CALLED[n.func.id]))
        case ast.Attribute(attr="T"):
            yield site("transpose dropped", lambda n: _set(n, attr="real"))
        case ast.comprehension(ifs=[_]):
            yield site("filter dropped", lambda n: _set(n, ifs=[]))


def _set(node: ast.AST, **new: object) -> None:
    for name, value in new.items():
        setattr(node, name, value)


def _other(op: ast.boolop) -> ast.boolop:
    return ast.Or() if isinstance(op, ast.And) else ast.And()


def _another(value: float) -> float:
    """Another number: the next one if whole, half as much again if not."""
    return value + 1 if isinstance(value, int) else 1.5 * value or 1.0


def _of_text(node: ast.BinOp) -> bool:
    parts = [
        part.value if isinstance(part, ast.Constant) else part for part in (node.left, node.right)
    ]
    return any(isinstance(part, str | ast.JoinedStr | ast.List | ast.Tuple) for part in parts)


def _planted(path: Path, relative: Path, name: str, site: _Site) -> Bug:
    tree = ast.parse(path.read_text("utf-8"))
    before = _statement(tree, site.node)
    old = ast.unparse(copy.deepcopy(before))
    node = list(ast.walk(tree))[site.node]
    site.change(node)
    ast.fix_missing_locations(tree)
    line = getattr(before, "lineno", 0)
    return Bug(str(relative), name, line, site.kind, old, ast.unparse(before), ast.unparse(tree))


def _statement(tree: ast.AST, number: int) -> ast.AST:
    """The innermost statement around a node."""
    wanted = list(ast.walk(tree))[number]
    around = [
        one
        for one in ast.walk(tree)
        if isinstance(one, ast.stmt) and any(part is wanted for part in ast.walk(one))
    ]
    return min(around, key=lambda one: sum(1 for _ in ast.walk(one)))
