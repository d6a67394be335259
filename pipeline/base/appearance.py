"""Appearance of a project's certificates: language, and additions of its house."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.base import files
from pipeline.base.doors import found

_HOUSE = "pipeline.house:looks"
"""Door of the house: language and additions of a project."""


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

Dress = Callable[[Mapping[str, Any], Any], Appearance]
"""Function from entries of campaign.toml and the answer to the look of a certificate."""


def appearances(root: Path) -> Dress:
    """What the house makes of the certificates of a project.

    Args:
        root: The project's root.

    Raises:
        InputError: pipeline.toml, or the folder that it names, is invalid.
    """
    dressed = found(_HOUSE)
    return dressed(root) if dressed else _plain


def _plain(about: Mapping[str, Any], answer: object) -> Appearance:
    return Appearance(str(about.get("language") or PLAIN.language))
