"""User-supplied patterns for names, matched in bounded time.

Regular expressions are matched by RE2, which comes with Arrow: its time is linear in the length of
name and expression, whatever is nested, and so it has neither look-around nor back-references.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

_MOST = 300
"""Maximum number of characters of an expression."""
_LONGEST = 200
"""Maximum number of characters of a name that is matched."""

_TOKENS = re.compile(r"\\.|\[\^?\]?(?:\\.|\[:\w*:\]|[^\]\\])*\]?|\(\??|\{\d+,?\d*\}|.", re.DOTALL)
"""An escaped character, a class, an opening parenthesis, a count, or any other character."""
_LETTERS = r"\pL\p{Nd}_"
_ANY_LETTERS = {r"\w": f"[{_LETTERS}]", r"\W": f"[^{_LETTERS}]", r"\Z": r"\z", "(": "(?:"}
"""Replacements for what RE2 restricts to ASCII or writes differently."""


def _in_re2(pattern: str) -> str:
    """The expression in the syntax of RE2, with Unicode letters as users expect them."""

    def group_of(token: re.Match[str]) -> str:
        if token[0].startswith("["):
            return re.sub(r"\\.", lambda one: _LETTERS if one[0] == r"\w" else one[0], token[0])
        return _ANY_LETTERS.get(token[0], token[0])

    return f"^(?:{_TOKENS.sub(group_of, pattern)})$"


OTHERWISE = "_2"
"""Ends the name of a part in an alternative, where RE2 does not let two parts have one name."""


def parts(names: pa.StringArray, pattern: str) -> pa.StructArray:
    """Named groups of complete matches, null where the expression does not match.

    A part that is empty is what its alternative matches, `group_2` for `group`.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    short = pc.if_else(pc.less_equal(pc.utf8_length(names), _LONGEST), names, None)
    found = pc.extract_regex(short, _in_re2(pattern))
    part = {one.name: pc.struct_field(found, one.name) for one in found.type}
    for name in [one for one in part if f"{one}{OTHERWISE}" in part]:
        other = part.pop(f"{name}{OTHERWISE}")
        part[name] = pc.if_else(pc.equal(part[name], ""), other, part[name])
    return pa.StructArray.from_arrays([*part.values()], [*part], mask=found.is_null())


def named(pattern: str) -> set[str]:
    """Names of the groups of an expression.

    Raises:
        ValueError: RE2 does not accept it.
    """
    import pyarrow as pa

    if len(pattern) > _MOST or _written_out(pattern) > 2 * _MOST:
        raise ValueError(f"the expression has more than {_MOST} letters, or twice that with counts")
    try:
        kind = parts(pa.array([], pa.string()), pattern).type
    except (pa.ArrowInvalid, UnicodeEncodeError) as problem:
        why = str(problem).removeprefix("Invalid regular expression: ")
        raise ValueError(
            f"not a regular expression of RE2, which has no look-around and no references ({why})"
        ) from problem
    names = [kind.field(k).name for k in range(kind.num_fields)]
    if len({*names}) < len(names):
        raise ValueError("not a regular expression (two parts have one name)")
    return {*names}


def _written_out(pattern: str) -> int:
    """Number of characters of an expression with all counted repetitions written out."""
    sizes, last = [0], 0
    for token in _TOKENS.findall(pattern):
        if token.startswith("("):
            sizes.append(0)
        elif token == ")" and len(sizes) > 1:
            last = sizes.pop()
            sizes[-1] += last
        elif token.startswith("{") and len(token) > 1:
            often = max(int(count or 0) for count in token[1:-1].split(","))
            sizes[-1] += last * max(often - 1, 0)
            last *= often
        else:
            last = 1
            sizes[-1] += 1
    return sum(sizes)


def is_glob(pattern: str) -> bool:
    """Whether it may match several files."""
    return any(mark in pattern for mark in "*?[")


def natural(name: str) -> list[str | int]:
    """Key that sorts numbers within names by size: pose2 before pose10."""
    return [int(part) if part.isdecimal() else part for part in re.split("([0-9]+)", name)]


def depth(glob: str, most: int) -> int:
    """Depth to which folders must be searched for a glob, at most `most`."""
    parts = PurePosixPath(glob).parts
    return most if "**" in parts else min(most, len(parts))


def fits(name: str, glob: str) -> bool:
    """Whether the path of a file matches a glob, in which ** stands for any folders.

    The time is bounded by the product of their lengths: all positions in the glob are followed at
    once.
    """
    pattern, open_at = PurePosixPath(glob).parts, {0}
    for part in PurePosixPath(name).parts:
        open_at = {
            after
            for k in _past_any(open_at, pattern)
            if k < len(pattern)
            for after in ((k,) if pattern[k] == "**" else (k + 1,))
            if pattern[k] == "**" or fnmatchcase(part, pattern[k])
        }
    return len(pattern) in _past_any(open_at, pattern) and not glob.endswith("**")


def _past_any(open_at: set[int], pattern: Sequence[str]) -> set[int]:
    """Positions in a pattern, and those after a ** there, which may match nothing."""
    reached = set(open_at)
    for k in range(len(pattern)):
        if k in reached and pattern[k] == "**":
            reached.add(k + 1)
    return reached
