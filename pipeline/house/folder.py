"""The folder of overrides: its house.toml with lines of its own, and the logo named there.

A line is text with names of facts in double braces, and nothing executable.
"""

from __future__ import annotations

import base64
import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from jinja2 import StrictUndefined, TemplateSyntaxError, nodes
from jinja2.sandbox import ImmutableSandboxedEnvironment
from pydantic import Field

from pipeline.base import files, toml
from pipeline.base.errors import InputError
from pipeline.base.strict import FileName, Name, Strict, checked

_FACTS = ("campaign", "measured", "operator", "robot", "machine", "verdict", "tolerance", "digest")
"""Facts about a campaign that a line may use."""

_OWN = "fields"
"""Name of the table of campaign.toml whose entries a line may use."""

_PLAIN = (nodes.Template, nodes.Output, nodes.TemplateData, nodes.Name, nodes.Getattr)
"""Permitted syntax elements of a line; everything else in Jinja is rejected."""

_LINE_WAY_OUT = (
    f"write text with {', '.join(f'{{{{ {one} }}}}' for one in _FACTS)} or "
    f"{{{{ {_OWN}.NAME }}}} of campaign.toml in it"
)

_SANDBOX = ImmutableSandboxedEnvironment(undefined=StrictUndefined, autoescape=False)
"""Template environment without a loader: a line cannot include files."""


@dataclass(frozen=True)
class _HouseLine:
    """One line of the house.

    Attributes:
        label: Its label.
        text: Its text, with names in double braces.
        own: Names of the fields of campaign.toml that it needs.
    """

    label: str
    text: str
    own: frozenset[str]

    def said(self, facts: Mapping[str, str], own: Mapping[str, str]) -> str | None:
        """Its text for a campaign; None if campaign.toml lacks a field of it."""
        if not self.own <= own.keys():
            return None
        known = {name: facts.get(name, "") for name in _FACTS}
        return _SANDBOX.from_string(self.text).render(known | {_OWN: dict(own)})


def _line(label: str, text: str, file: str) -> _HouseLine:
    """Parse a line that only refers to facts.

    Raises:
        InputError: It does more than that, or names an unknown fact.
    """

    def refused(why: str) -> InputError:
        return InputError(f'[fields] "{label}": {why}', _LINE_WAY_OUT, file=file)

    try:
        tree = _SANDBOX.parse(text)
    except TemplateSyntaxError as problem:
        raise refused(f"{problem.message}") from problem
    own = set[str]()
    for one in tree.find_all(nodes.Node):
        if not isinstance(one, _PLAIN):
            raise refused(f"{type(one).__name__.lower()} is nothing that a line may do")
        if isinstance(one, nodes.Getattr):
            if not isinstance(one.node, nodes.Name) or one.node.name != _OWN:
                raise refused(f'"{one.attr}" belongs to no table of campaign.toml')
            own.add(one.attr)
        if isinstance(one, nodes.Name) and one.name not in (*_FACTS, _OWN):
            raise refused(f'there is no "{one.name}"')
    return _HouseLine(label, text, frozenset(own))


_FILE = "house.toml"
_LOGO_BYTES = 200_000
"""Maximum size of a logo [B], which is embedded in page and PDF."""
_MOST_FIELDS = 8
"""Maximum number of additional lines that fit beside the drawing."""
_WAY_OUT = "correct it as docs/house.md describes"

Annex = Literal[
    "budget",
    "cell",
    "diagnosis",
    "enough",
    "files",
    "identity",
    "laws",
    "method",
    "positions",
    "registration",
    "rejected",
    "reliability",
    "residuals",
    "stiffness",
    "table",
    "test-pose",
    "validation",
]
"""Names of the annexes, as in the anchors of their headings on the page."""


class _Overrides(Strict):
    """Content of house.toml.

    Attributes:
        logo: A drawing in the folder, .svg or .png.
        order: Annexes that come first; the others follow in the usual order.
        fields: Lines by their labels.
    """

    logo: FileName | None = None
    order: list[Annex] = Field(default_factory=list)
    fields: Annotated[dict[Name, Name], Field(max_length=_MOST_FIELDS)] = Field(
        default_factory=dict
    )


@dataclass(frozen=True)
class House:
    """Additions of a house to every certificate.

    Attributes:
        logo: An SVG drawing; empty for none.
        order: Keys of the annexes that come first.
        lines: Its additional lines.
    """

    logo: str
    order: tuple[str, ...]
    lines: tuple[_HouseLine, ...]

    def fields(
        self, facts: Mapping[str, str], own: Mapping[str, str]
    ) -> tuple[tuple[str, str], ...]:
        """Label and text of each line, without those whose fields campaign.toml lacks.

        Args:
            facts: Facts about the campaign, by name.
            own: `[fields]` of campaign.toml.
        """
        texts = ((one.label, one.said(facts, own)) for one in self.lines)
        return tuple((label, text) for label, text in texts if text is not None)


def house(root: Path, name: str) -> House:
    """Read the folder of a house.

    Args:
        root: The project's root.
        name: The folder, below it.

    Raises:
        InputError: It lies among measurements or reports, leads elsewhere, or has invalid content.
    """
    if PurePosixPath(name).parts[0] in ("data", "reports"):
        raise InputError(
            f'templates "{name}" lies among campaigns or reports, which anybody may write',
            "move the folder beside pipeline.toml",
            file="pipeline.toml",
        )
    folder = root / name
    text = files.text(_content(folder, name, _FILE, toml.LARGEST_TEXT), f"{name}/{_FILE}")
    content = toml.loads(text, f"{name}/{_FILE}")
    overrides = checked(_Overrides, content, f"{name}/{_FILE}", "", _WAY_OUT, text)
    lines = tuple(_line(label, one, f"{name}/{_FILE}") for label, one in overrides.fields.items())
    return House(
        _logo(folder, name, overrides.logo) if overrides.logo else "", tuple(overrides.order), lines
    )


def _content(folder: Path, name: str, file: str, most: int) -> bytes:
    """Content of a file that lies within the folder.

    Raises:
        InputError: It leads elsewhere, or cannot be read.
    """
    path = folder / file
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError("leads out of its folder", "copy it there", file=f"{name}/{file}")
    return files.read(path, f"{name}/{file}", most)


# --- the logo -------------------------------------------------------------------------------------

_SVG, _XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"
_DRAWN = {
    *("svg", "g", "defs", "title", "desc", "path", "rect", "circle", "ellipse", "line", "polyline"),
    *("polygon", "text", "tspan", "linearGradient", "radialGradient", "stop", "clipPath", "use"),
}
"""Elements that only draw."""

_ELSEWHERE = re.compile(r"url\(\s*['\"]?(?!#)|@import|javascript:", re.IGNORECASE)
_PNG = b"\x89PNG\r\n\x1a\n"


def _logo(folder: Path, name: str, file: str) -> str:
    """A logo as SVG.

    Raises:
        InputError: It is not a drawing, or does more than draw.
    """
    data, shown = _content(folder, name, file, _LOGO_BYTES), f"{name}/{file}"
    if data.startswith(_PNG) and len(data) > 24:
        wide, high = struct.unpack(">II", data[16:24])
        image = base64.b64encode(data).decode()
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}" width="{wide}" '
            f'height="{high}"><image width="{wide}" height="{high}" '
            f'href="data:image/png;base64,{image}"/></svg>'
        )
    if more := _more_than_drawn(files.text(data, shown)):
        raise InputError(
            f"is no plain drawing: it has {more}", "save it as plain SVG or as PNG", file=shown
        )
    return data.decode()


def _more_than_drawn(text: str) -> str:
    """First content of an SVG besides shapes, gradients and text; empty if there is none."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        return "a document type"
    try:
        root = ET.fromstring(text)
    except ET.ParseError as problem:
        return f"what is no XML ({problem})"
    for one in root.iter():
        kind = str(one.tag).removeprefix(_SVG)
        if kind not in _DRAWN:
            return f"<{kind}>"
        for attribute, value in one.attrib.items():
            if _leads(attribute, value):
                return f"{attribute.removeprefix('{http://www.w3.org/1999/xlink}')}={value[:40]!r}"
    return "" if root.tag == f"{_SVG}svg" else "no <svg>"


def _leads(attribute: str, value: str) -> bool:
    """Whether an attribute triggers an action, or refers to something outside the file."""
    if attribute in ("href", _XLINK) and not value.startswith("#"):
        return True
    return attribute.lower().startswith("on") or bool(_ELSEWHERE.search(value))
