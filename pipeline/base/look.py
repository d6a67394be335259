"""How a project wants its certificates: their language, and what its house adds to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.base import files, preferences
from pipeline.base.doors import opened

HOUSE = "pipeline.house:house"
"""The door behind which a folder of overrides is read."""


@dataclass(frozen=True)
class Look:
    """How a certificate looks beyond what it says.

    Attributes:
        language: Of the certificate.
        logo: An SVG drawing; empty for none.
        fields: Lines of the house's own, each with its label.
        order: Keys of the annexes that come first.
    """

    language: str = "en"
    logo: str = ""
    fields: tuple[tuple[str, str], ...] = ()
    order: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """The same for the same look."""
        return files.sha256(repr(self).encode())


PLAIN = Look()
"""In English, as it comes."""

Facts = Mapping[str, str]
"""What a line of the house may say of a campaign, by name."""


def looks(root: Path) -> Callable[[Mapping[str, Any], Facts], Look]:
    """What makes the look of a campaign from what campaign.toml says of it, and its facts.

    Args:
        root: The project's root.

    Raises:
        InputError: pipeline.toml or the folder that it names says what it cannot.
    """
    said = preferences.load(root).report
    house = None if said.templates is None else opened(HOUSE)(root, said.templates)

    def look(about: Mapping[str, Any], facts: Facts) -> Look:
        language = about.get("language") or said.language
        if house is None:
            return Look(language)
        fields = house.fields(facts, about.get("fields") or {})
        return Look(language, house.logo, fields, house.order)

    return look
