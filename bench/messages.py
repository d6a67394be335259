"""`python -m bench.messages`: extract translated texts from the source to gettext catalogues.

A text is a constant or an f-string, with `{}` for its variable parts. `catalogues` updates the
files of Babel; a test calls `texts` for the same, without Babel.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1] / "pipeline"

SPOKEN: dict[str, tuple[str, ...] | None] = {
    "positions/answer.py": ("_to_do", "_ALONE", "_next", "_AGAIN"),
    "answer/remarks.py": ("WORK", "other_way", "stiffness_text"),
    "answer/sentences.py": (
        *("_next", "_again", "_proposed", "_unchecked", "_pulled", "_joints"),
        *("_least_certain", "_NONE_OPEN", "_settled"),
    ),
    "answer/conformity.py": ("DECIDED", "compared"),
    "check/misplaced_anchors.py": (),
    "answer/words.py": ("MISTAKES", "DO", "DO_DESPITE", "listed", "loads"),
    "design/discriminate.py": ("_never",),
    "design/criteria.py": ("prediction",),
    "design/finished.py": ("worth_unpulled", "_unchecked", "cell_lines"),
    "design/plan_book.py": (),
    "design/plan_figures.py": ("pose_picture", "_view"),
    "design/plan_sheet.py": (),
    "faults/*.py": (),
    "positions/position_readings.py": (),
    "positions/position_rows.py": (),
    "machine/effect.py": ("in_place",),
    "machine/effects/*.py": (),
    "machine/effects/nameless.py": None,
    "machine/effects/unlisted.py": ("_said",),
    "design/room.py": ("unchecked",),
    "report/certificate.py": (),
    "report/beside_nominal.py": ("SOFT", "WIDE_OPEN", "SURE", "stand"),
    "annex/figures/certificate.py": (
        *(
            "_RULES",
            "_CAUSE",
            "_joints",
            "_deflection",
            "_key",
        ),
        *(
            "_write",
            "_stands_at",
            "_JudgedDeflection",
            "_judged_deflections",
            "_draw_gauge",
            "_write_gauge",
            "_only",
        ),
    ),
    "report/model.py": ("compose", "_about", "_title"),
    "report/record.py": ("Certificate", "PageFrame"),
    "annex/identity.py": (
        "_KINDS",
        "rows",
        "_when",
        "_scatter",
        "_unit",
        "_instrument",
        "_counts",
        "_counted",
    ),
    "report/words.py": (
        "nouns",
        "VERDICTS",
        "UNUSABLE",
        "CORRECTED",
        "_OUT",
        "_OPEN",
        "JUDGED",
    ),
}
"""Files, and the functions and constants in them with texts of a certificate or sheet: all of them
if (), none if None. The line of a single file replaces that of a pattern."""

JOINED = (
    *("{} ({})", "{}: {}", "{} = {}", "{} or {}", " in axis {}", "axis {}", "joint {}", "pose"),
    *("tighten to {} N", "release, tighten to {} N", "slacken to {} N"),
)
"""Patterns that combine texts and do not occur in the source as a whole."""

_UNSAID = {
    *("correction", "form", "source", "signature", "place", "element", "name", "key"),
    *("encoding", "part", "text_anchor", "font_weight", "fill", "law"),
}
"""Keyword arguments that contain no text of a certificate or sheet."""

_CALLS = {
    "re",
    "getattr",
    "Parameter",
    "vector",
    "_shift",
    "_turn",
    "rename",
    "sort_values",
    "groupby",
    "UsageError",
    "InputError",
}
"""Functions whose arguments contain no text."""

_SINGLE = {
    *(
        "arm",
        "base",
        "calibrated",
        "cause",
        "certificate",
        "chain",
        "curvature",
        "fail",
        "floor",
        "hysteresis",
    ),
    *(
        "joint",
        "none",
        "once",
        "pass",
        "rail",
        "reflectors",
        "softer",
        "stiffer",
        "twice",
        "uncertainty",
    ),
    *("undecided", "anchor", "up", "down", "group", "row", "large", "small", "shuffled"),
}
"""Single lower-case words that are texts."""

_ELSEWHERE = re.compile(
    r"(re)?computed (without|with|as) |nothing can be corrected"
    r"|(\{\} )?pose\{\}( rep\{\})?$|\{\} (columns|force|joints)$"
)
"""Corrections of mistakes, and names of places in files, neither of which is on a certificate."""

_NO_CONSTANTS = {"_FORMS", "_SIGNATURE", "_SOURCE"}
"""Constants that contain no text."""

_WORDS = re.compile(r"[^\W\d_]{2,}")


def texts() -> dict[str, str]:
    """Every text, and the first file that contains it."""
    found = dict.fromkeys(JOINED, "")
    for pattern, names in SPOKEN.items():
        sources = {path: path.read_text("utf-8") for path in files_of(pattern)}
        _there(pattern, names or (), sources.values())
        if names is None:
            continue
        for path, source in sources.items():
            for _, text in _said(source, names):
                found.setdefault(text, path.relative_to(ROOT).as_posix())
    return found


def files_of(pattern: str) -> list[Path]:
    """The files of a pattern, except those that have a line of their own in `SPOKEN`."""
    others = SPOKEN.keys() - {pattern}
    every = sorted(ROOT.glob(pattern))
    return [path for path in every if path.relative_to(ROOT).as_posix() not in others]


def _there(pattern: str, names: tuple[str, ...], sources: Collection[str]) -> None:
    """Stop if a file or a name of `SPOKEN` is gone: its texts would vanish from the catalogues."""
    if not sources:
        raise SystemExit(f"pipeline/{pattern} is gone: correct SPOKEN of bench/messages.py")
    defined = {name for one in sources for node in ast.parse(one).body for name in _names(node)}
    for name in sorted(set(names) - defined):
        raise SystemExit(f"pipeline/{pattern} has no {name}: correct SPOKEN of bench/messages.py")


def catalogues() -> None:
    """Update the catalogues: new texts are empty there, texts gone from the source are removed."""
    from babel.messages.catalog import Catalog
    from babel.messages.mofile import write_mo
    from babel.messages.pofile import read_po, write_po

    template = Catalog()
    for text, file in texts().items():
        template.add(text, locations=[(file, 0)] if file else [])
    for path in sorted((ROOT / "house" / "locale").glob("*.po")):
        with path.open("rb") as written:
            found = read_po(written, locale=path.stem)
        found.update(template, no_fuzzy_matching=True, update_creation_date=False)
        found.obsolete.clear()
        for message in found:
            message.flags.clear()  # set by guess from "% o", as for format strings
        with path.open("wb") as text_file, path.with_suffix(".mo").open("wb") as compiled:
            write_po(text_file, found, width=100, include_lineno=False, sort_by_file=True)
            write_mo(compiled, found)
        if waiting := sum(not message.string for message in found if message.id):
            print(f"{path.relative_to(ROOT.parent)}: {waiting} texts to translate")


def _said(source: str, names: tuple[str, ...]) -> Iterator[tuple[int, str]]:
    """Line and text of some functions and constants of a file."""
    for node in ast.parse(source).body:
        defined = _names(node)
        if defined & set(names) or (not names and not defined & _NO_CONSTANTS):
            for line, text in _texts(node):
                if _is_text(text):
                    yield line, text


def _names(node: ast.stmt) -> set[str]:
    """Names that a statement defines."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return {
        one.id
        for target in targets
        for one in ast.walk(target or ast.Pass())
        if isinstance(one, ast.Name)
    }


def _texts(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Constants and f-strings except docstrings, keys and operands of comparisons."""
    if isinstance(node, ast.Compare | ast.Raise | ast.Import | ast.ImportFrom | ast.Assert):
        return
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return
    if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[0] in _CALLS:
        return
    if isinstance(node, ast.Constant | ast.JoinedStr):
        yield node.lineno, _template(node)
    if isinstance(node, ast.JoinedStr):
        inner: list[ast.AST] = [
            one.value for one in node.values if isinstance(one, ast.FormattedValue)
        ]
    elif isinstance(node, ast.Subscript):
        inner = [node.value]
    elif isinstance(node, ast.Dict):
        pairs = zip(node.keys, node.values, strict=True)
        inner = [one for key, one in pairs if getattr(key, "value", None) not in _UNSAID]
    elif isinstance(node, ast.keyword) and node.arg in _UNSAID:
        inner = []
    elif isinstance(node, ast.FunctionDef):
        inner = [*node.args.defaults, *node.body]
    elif isinstance(node, ast.AnnAssign):
        inner = [node.value] if node.value else []
    else:
        inner = list(ast.iter_child_nodes(node))
    for one in inner:
        yield from _texts(one)


def _template(node: ast.AST) -> str:
    """A constant unchanged, an f-string with `{}` for variable parts; adjacent ones are merged."""
    if isinstance(node, ast.JoinedStr):
        parts = (one.value if isinstance(one, ast.Constant) else "{}" for one in node.values)
        return re.sub(r"(?:\{\}){2,}", "{}", "".join(map(str, parts)))
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def _is_text(text: str) -> bool:
    """Whether it is a text for readers: words, a title, or one of the single words."""
    bare = text.replace("{}", "")
    if text in _SINGLE:
        return True
    if _ELSEWHERE.match(text):
        return False
    return bool(_WORDS.search(bare)) and (
        " " in text.strip() or bool(re.match(r"[A-Z][a-z]", text))
    )


if __name__ == "__main__":
    catalogues()
