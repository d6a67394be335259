"""Appearance of a project's certificates, as its pipeline.toml and the folder named there say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pipeline.answer.contract import Answer
from pipeline.base import doors, files
from pipeline.base.appearance import Appearance, Dress
from pipeline.house.folder import house as house_of
from pipeline.store.campaign import dump

_PREFERENCES = "pipeline.library.preferences:load"
"""Door: pipeline.toml."""

_Facts = Mapping[str, str]
"""Facts about a campaign that lines of the house may use, by name."""


def looks(root: Path) -> Dress:
    """Function from entries of campaign.toml and the answer to the look of its certificate.

    Args:
        root: The project's root.

    Raises:
        InputError: pipeline.toml, or the folder that it names, is invalid.
    """
    look = appearances(root)
    return lambda about, answer: look(about, _facts(answer))


def _facts(of: Answer) -> _Facts:
    worst = of.tolerance.worst if of.tolerance else None
    return {
        "campaign": of.name,
        "measured": (of.measured or "")[:10],
        "operator": of.identity.operator or "",
        "robot": of.robot,
        "machine": of.machine,
        "verdict": str(of.diagnosis.verdict),
        "tolerance": str(worst or ""),
        "digest": files.sha256(dump(of.as_json()))[:16],
    }


def appearances(root: Path) -> Callable[[Mapping[str, Any], _Facts], Appearance]:
    """The same from the facts."""
    load = doors.found(_PREFERENCES)
    if load is None:
        return lambda about, _: Appearance(str(about.get("language") or "en"))
    preferred = load(root).report
    house = None if preferred.templates is None else house_of(root, preferred.templates)

    def look(about: Mapping[str, Any], facts: _Facts) -> Appearance:
        language = str(about.get("language") or preferred.language)
        if house is None:
            return Appearance(language)
        fields = house.fields(facts, about.get("fields") or {})
        return Appearance(language, house.logo, fields, house.order)

    return look
