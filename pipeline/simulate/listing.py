"""The catalogue in readable form."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from pipeline.machine.effect import Effect
from pipeline.machine.effects import catalogue, table
from pipeline.machine.robot import Robot


def _entries(robot: Robot) -> list[dict[str, Any]]:
    """One entry per cause and place, with all its forms."""
    out: dict[str, dict[str, Any]] = {}
    for effect in (*catalogue(robot), *table.effects(robot)):
        entry = out.setdefault(effect.label, _entry(effect))
        if effect.form:
            entry["forms"].append(effect.form)
    return list(out.values())


def _entry(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "where": effect.where,
        "acts_on": sorted({type(facet).__name__.lower() for facet in effect.facets}),
        "forms": [],
        "parameters": [asdict(parameter) for parameter in effect.parameters],
        "signature": effect.signature,
        "needs": effect.needs,
        "source": effect.source,
    }


def as_json(robot: Robot) -> str:
    """The catalogue as a JSON array."""
    return json.dumps(_entries(robot), allow_nan=False)


def as_text(robot: Robot) -> str:
    """One line per cause: argument of --effect, typical magnitude, signature."""
    rows = []
    for entry in _entries(robot):
        where = "" if entry["where"] is None else f":{entry['where']}"
        first = entry["parameters"][0]
        size = f"{first['name']} = {first['typical']:.2g} {first['unit']}"
        rows.append((f"{entry['name']}{where}", size, entry["signature"]))
    first_width, second_width = (2 + max(len(row[column]) for row in rows) for column in (0, 1))
    return "\n".join(
        f"{name:{first_width}}{size:{second_width}}{signature}" for name, size, signature in rows
    )
