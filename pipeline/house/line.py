"""A line of the house: text with names of facts in double braces, and nothing executable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from jinja2 import StrictUndefined, TemplateSyntaxError, nodes
from jinja2.sandbox import ImmutableSandboxedEnvironment

from pipeline.base.errors import InputError

_FACTS = ("campaign", "measured", "operator", "robot", "machine", "verdict", "tolerance", "digest")
"""Facts about a campaign that a line may use."""

_OWN = "fields"
"""Name of the table of campaign.toml whose entries a line may use."""

_PLAIN = (nodes.Template, nodes.Output, nodes.TemplateData, nodes.Name, nodes.Getattr)
"""Permitted syntax elements of a line; everything else in Jinja is rejected."""

_WAY_OUT = (
    f"write text with {', '.join(f'{{{{ {one} }}}}' for one in _FACTS)} or "
    f"{{{{ {_OWN}.NAME }}}} of campaign.toml in it"
)

_SANDBOX = ImmutableSandboxedEnvironment(undefined=StrictUndefined, autoescape=False)
"""Template environment without a loader: a line cannot include files."""


@dataclass(frozen=True)
class HouseLine:
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


def line(label: str, text: str, file: str) -> HouseLine:
    """Parse a line that only refers to facts.

    Raises:
        InputError: It does more than that, or names an unknown fact.
    """

    def refused(why: str) -> InputError:
        return InputError(f'[fields] "{label}": {why}', _WAY_OUT, file=file)

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
    return HouseLine(label, text, frozenset(own))
