"""What lies in a folder beside exports and logs: sheets of a workbook, the URDF of a robot."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Mapping
from posixpath import basename, splitext

from pipeline.base.doors import found
from pipeline.base.errors import InputError, listed
from pipeline.base.shown import typed
from pipeline.dialects._log_form import headers
from pipeline.dialects._titles import name_a_place, titled
from pipeline.dialects.workbook import sheets
from pipeline.intake import _log_words
from pipeline.intake._sheet import sheet
from pipeline.readers._text import Text, is_workbook, text
from pipeline.readers.logs import SCALE

_TREE = [re.compile(rf"<{end}\s+link\s*=\s*[\"']([^\"']+)[\"']") for end in ("parent", "child")]
"""Links of the joints of a URDF."""
ROBOT = "it describes a robot"
"""Beginning of why a file is not used that does."""
_TIMES = {"time", "clock", "date"}


def in_workbooks(files: Mapping[str, bytes]) -> list[str]:
    """A sentence for each workbook of several sheets: what each of them is."""
    out = []
    for name, data in files.items():
        with contextlib.suppress(InputError):
            there = sheets(name, data) if is_workbook(data) else {}
            if len(there) > 1:
                kinds = listed([f'"{one}" {_kind(text)}' for one, text in there.items()], most=20)
                out.append(f"{name} has {len(there)} sheets: {kinds}.")
    return out


def robots_in(files: Mapping[str, bytes], others: Collection[str | None]) -> list[str]:
    """A sentence for each workbook, and each file but some others, that describes a robot, too."""
    left = {k: data for k, data in files.items() if is_workbook(data) or k not in others}
    said = {name: of_robot(name, data) for name, data in left.items() if not _made(name, files)}
    return [f"{name}: {one.replace('it', 'it also', 1)}." for name, one in said.items() if one]


def pages(files: Mapping[str, bytes]) -> list[str]:
    """A sentence for each code page in which files are written, other than UTF-8."""
    written: dict[str, list[str]] = {}
    for name, data in files.items():
        begin = data[:_BEGIN]
        with contextlib.suppress(InputError):  # no text
            own = text(name, begin[: begin.rfind(b"\n") + 1] or begin)
            written.setdefault(own.encoding, []).append(name)
    others = {page: names for page, names in written.items() if page not in ("ascii", "utf-8")}
    return [f"{listed(names)}: read as {page}" for page, names in others.items()]


_BEGIN = 1 << 16
"""Size of the text that shows its code page [byte]."""


def _made(name: str, files: Mapping[str, bytes]) -> list[str]:
    """The robot files that name another file as their source."""
    tables = (k for k in files if k.endswith(".toml") and k != "campaign.toml")
    return [k for k in tables if name.encode() in files[k]]


def described(name: str, files: Mapping[str, bytes]) -> str | None:
    """Why a file that describes a robot, and nothing else, is not used; None for any other file."""
    if is_workbook(files[name]) or not (own := of_robot(name, files[name])):
        return None
    made = _made(name, files)
    return f"{ROBOT}, that of {made[0]}" if made else own


def _kind(text: Text) -> str:
    """What a sheet is by its titles."""
    units = tuple(SCALE)
    is_table = found("pipeline.exchange.from_table:is_table")
    if is_table and is_table(text.name, text.data):
        return "is of a robot"
    for head in headers(text):
        if axes := _log_words.called_axes(head.written, dict):
            first, *_, last = axes
            without = _log_words.axes_without_pose(head.written)
            return f"is a joint log ({first} to {last})" + ", without poses" * bool(without)
        if name_a_place(head.written):
            roles = {one.role for one in titled(head.written)}
            return "has points with times" if roles & _TIMES else "is a list of points"
        if _log_words.names_a_force(head.written, units):
            return "is a log of loads"
    return "has points" if sheet(text) else "is text"


def of_robot(name: str, data: bytes) -> str | None:
    """The command for a file that describes a robot: a URDF or a table; None if it is none."""
    output = f"{splitext(basename(name))[0]}.toml"
    if options := _links(data):
        return f"{ROBOT}: {_command(name, options, output)}"
    is_table = found("pipeline.exchange.from_table:is_table")
    if not (is_table and is_table(name, data)):
        return None
    own = _command(name, "", output)
    has_rail = found("pipeline.exchange.from_table:has_rail")
    more = (
        ""
        if has_rail and has_rail(name, data)
        else "; if it stands on a rail, with --rail, --turn and --foot"
    )
    return f"{ROBOT}: {own}{more}"


def _command(name: str, options: str, output: str) -> str:
    command = f"pipeline robot {typed(name)} {options}--output {typed(output)}"
    return f"type `{command}` in this folder, and `pipeline init` again"


def _links(data: bytes) -> str:
    """Options for a URDF, in which the first link carries all others; empty if it is none."""
    text = data.decode("utf-8", "replace")
    parents, children = ([*dict.fromkeys(one.findall(text))] for one in _TREE)
    first = [link for link in parents if link not in children]
    last = [link for link in children if link not in parents]
    if "<robot" not in text or not (first and last):
        return ""
    return f"--base {typed(first[0])} --flange {typed(last[-1])} "
