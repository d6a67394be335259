"""The code blocks of README, CONTRIBUTING and docs/, with what their authors say of running them.

A comment in the line before a block speaks of it:

    <!-- given: COMMANDS -->          run before it, in the same folder
    <!-- file: NAME -->               the block is a file of that name, for the blocks behind it
    <!-- exit: CODE -->               what its last command returns, 0 otherwise
    <!-- tested: tests/test_X.py -->  that test runs it, where the text says
    <!-- not run: REASON -->          nobody can run it in a test

An indented block is a shell's where its first word is a command, else a drawing or an answer; a
fenced one is what it says, and without a language none of code.
"""

from __future__ import annotations

import re
import shutil
import textwrap
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "CONTRIBUTING.md", *sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "docs").rglob("*.md")
    if path.parent.name != "decisions"
))  # fmt: skip
_BUILTIN = {"cd", "export", "pipeline", "make", "dask", "prefect", "sudo"}
_MARK = re.compile(r"^<!-- (given|file|exit|tested|not run): (.*?) -->$")
_FENCE = re.compile(r"^```(?:\{code-cell\} (\w+)|\{[\w-]+\}|(\w*))$")


@dataclass(frozen=True)
class Block:
    """One block.

    Attributes:
        page: File it stands in.
        line: Of its first line of code.
        kind: python, sh, toml, sql, or empty where it is no code.
        code: Its text.
        marks: What the comments before it say, by their word.
    """

    page: str
    line: int
    kind: str
    code: str
    marks: dict[str, str]

    @property
    def at(self) -> str:
        """Where it is."""
        return f"{self.page}:{self.line}"

    @property
    def runs(self) -> bool:
        """Whether this page's test runs it."""
        return self.kind in ("python", "sh") and not {"tested", "not run", "file"} & set(self.marks)


def blocks(page: str) -> list[Block]:
    """All blocks of a page, in their order."""
    lines, out, at = (ROOT / page).read_text("utf-8").split("\n"), [], 0
    if lines[0] == "---":  # what a notebook says of itself
        at = lines.index("---", 1) + 1
    while at < len(lines):
        fence = _FENCE.match(lines[at])
        if fence:
            end = lines.index("```", at + 1)
            out.append(
                _block(page, lines, at, fence[1] or fence[2] or "", lines[at + 1 : end], at + 2)
            )
            at = end
        elif lines[at].startswith("    ") and lines[at - 1].strip() in ("", *_comment(lines, at)):
            end = at
            while end < len(lines) and (lines[end].startswith("    ") or not lines[end]):
                end += 1
            inner = textwrap.dedent("\n".join(lines[at:end])).strip("\n").split("\n")
            kind = "sh" if _command(inner[0].split()[0]) else ""
            out.append(_block(page, lines, at, kind, inner, at + 1))
            at = end - 1
        at += 1
    return out


def _comment(lines: list[str], at: int) -> list[str]:
    return [lines[at - 1].strip()] if _MARK.match(lines[at - 1]) else []


def _block(page: str, lines: list[str], at: int, kind: str, code: list[str], line: int) -> Block:
    marks, above = {}, at - 1
    while above >= 0 and (not lines[above].strip() or _MARK.match(lines[above])):
        if found := _MARK.match(lines[above]):
            marks[found[1]] = found[2]
        above -= 1
    return Block(page, line, kind, "\n".join(code) + "\n", marks)


def _command(word: str) -> bool:
    return word in _BUILTIN or bool(re.fullmatch(r"[a-z][a-z0-9]*", word) and shutil.which(word))
