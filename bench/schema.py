"""`python -m bench.schema`: docs/result.schema.json and the keys in docs/answer.md, from types.

Both are derived from pipeline/answer/contract.py alone; a test checks that.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import json
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from pipeline.answer import contract
from pipeline.answer.contract import Answer

DOCS = Path(__file__).parents[1] / "docs"
BEGIN, END = "<!-- make schema writes from here -->", "<!-- to here -->"


def _meanings() -> dict[tuple[str, str], str]:
    """The docstring below each field, by record and field."""
    return {
        (record.name, field.target.id): " ".join(str(text.value.value).split())
        for record in ast.parse(inspect.getsource(contract)).body
        if isinstance(record, ast.ClassDef)
        for field, text in itertools.pairwise(record.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }


def _describe() -> None:
    """Hand them to pydantic, which would read the source anew at every import."""
    meanings = _meanings()
    for kind in vars(contract).values():
        if isinstance(kind, type) and issubclass(kind, contract.Fact):
            for name, field in kind.model_fields.items():
                owners = (meanings.get((one.__name__, name)) for one in kind.__mro__)
                field.description = next(filter(None, owners), None)
            kind.model_rebuild(force=True)


_describe()


def schema() -> str:
    """JSON Schema of result.json."""
    return json.dumps(Answer.model_json_schema(by_alias=True), indent=1) + "\n"


def page(old: str) -> str:
    """docs/answer.md with a new table of keys; text outside the marks is unchanged."""
    before, _, rest = old.partition(BEGIN)
    _, _, after = rest.partition(END)
    rows = ["| key | type | meaning |", "|---|---|---|", *_rows(Answer, "")]
    return "\n".join([f"{before}{BEGIN}", "", *rows, "", f"{END}{after}"])


def _rows(model: type[BaseModel], path: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        here = f"{path}{field.serialization_alias or name}"
        inner, several = _inner(field.annotation)
        where = f"{here}[]" if inner and several else here
        meaning = field.description or (inner.__doc__ or "").strip() if inner else field.description
        yield f"| `{where}` | {_words(field.annotation)} | {(meaning or '').replace('|', '/')} |"
        if inner and not path:
            yield from _rows(inner, f"{where}.")


def _inner(kind: Any) -> tuple[type[BaseModel] | None, bool]:
    """The record that a type contains, and whether it is a list."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind, False
    for part in get_args(kind):
        inner, several = _inner(part)
        if inner:
            return inner, several or get_origin(kind) is tuple
    return None, get_origin(kind) is tuple


def _words(kind: Any) -> str:
    """Name of a type in JSON."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _words(parts[0])
    if origin in (Union, types.UnionType):
        return " or ".join(_words(part) for part in parts)
    if origin is Literal:
        return ", ".join(f"`{part}`" for part in parts)
    if origin is tuple:
        return f"list of {_words(parts[0])}"
    if origin is dict or kind is Any:
        return "object"
    if kind is type(None):
        return "null"
    if issubclass(kind, BaseModel):
        return "object"
    if hasattr(kind, "__members__"):
        return ", ".join(f"`{member.value}`" for member in kind)
    return {str: "text", int: "integer", float: "number", bool: "true or false"}[kind]


def main() -> None:
    """Write both."""
    (DOCS / "result.schema.json").write_text(schema(), "utf-8")
    answer = DOCS / "answer.md"
    answer.write_text(page(answer.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
