"""Appearance of a project's certificates: language, and additions of its house."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.base import files, preferences
from pipeline.base.doors import opened

_HOUSE = "pipeline.house:house"
"""Door of the reader of a folder of overrides."""


@dataclass(frozen=True)
class Appearance:
    """Appearance of a certificate, apart from its content.

    Attributes:
        language: Language of the certificate.
        logo: An SVG drawing; empty for none.
        fields: Additional lines of the house, each with its label.
        order: Keys of the annexes that come first.
    """

    language: str = "en"
    logo: str = ""
    fields: tuple[tuple[str, str], ...] = ()
    order: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Hash that is equal for equal appearance."""
        return files.sha256(repr(self).encode())


PLAIN = Appearance()
"""Default appearance, in English."""

AppearanceFacts = Mapping[str, str]
"""Facts about a campaign that lines of the house may use, by name."""


def appearances(root: Path) -> Callable[[Mapping[str, Any], AppearanceFacts], Appearance]:
    """Function from statements of campaign.toml and facts to the look of a campaign.

    Args:
        root: The project's root.

    Raises:
        InputError: pipeline.toml, or the folder that it names, is invalid.
    """
    preferred = preferences.load(root).report
    house = None if preferred.templates is None else opened(_HOUSE)(root, preferred.templates)

    def look(about: Mapping[str, Any], facts: AppearanceFacts) -> Appearance:
        language = str(about.get("language") or preferred.language)
        if house is None:
            return Appearance(language)
        fields = house.fields(facts, about.get("fields") or {})
        return Appearance(language, house.logo, fields, house.order)

    return look
