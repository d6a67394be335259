"""The clean campaigns to be spoilt: bytes by file name, from the plans in seeds.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

import pandas as pd

from bench.reduced import reduce
from pipeline.machine.robot import load
from pipeline.reduction.bring import conformed
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory

Files = Mapping[str, bytes]

_SEEDS = tomllib.loads(Path(__file__).with_name("seeds.toml").read_text("utf-8"))

NAMES = tuple(_SEEDS)
"""Names of all clean campaigns."""


@cache
def base(name: str) -> Files:
    """Content of the raw folder of one clean campaign."""
    return MappingProxyType(made(name, _SEEDS[name]["seed"]))


def made(name: str, seed: int) -> dict[str, bytes]:
    """The same campaign, drawn with another seed."""
    plan = revised(Plan(name=name), _SEEDS[name] | {"seed": seed})
    files = dict(simulate(plan).files)
    if name == "reduced":
        files = _reduced(files)
    if name == "own_robot":
        files["robot.toml"] = load(plan.robot).text.encode()
        files = _stated(files, f'robot = "{plan.robot}"', 'robot = "robot.toml"')
    return files


def _stated(files: dict[str, bytes], old: str, new: str) -> dict[str, bytes]:
    text = files["campaign.toml"].decode()
    assert old in text
    return files | {"campaign.toml": text.replace(old, new).encode()}


def _reduced(files: dict[str, bytes]) -> dict[str, bytes]:
    """The same campaign as displacements and forces, as if reduced by its operator."""
    shown = reduce(in_memory(files), conformed).shown
    text = files["campaign.toml"].decode()
    tables = text.split("\n\n")
    kept = [t for t in tables if not t.startswith(("[tracker]", "[scale]", "[base_frame]"))]
    stated = '[displacements]\nfile = "displacements.csv"\nforces = "forces.csv"\nsigma_m = 4e-05'
    text = "\n\n".join([kept[0], stated, *kept[1:]])
    moved = shown["displacements"][["pose", "repeat", "target", "dx_m", "dy_m", "dz_m"]]
    pulls = shown["forces"][["pose", "repeat", "fx_n", "fy_n", "fz_n"]]
    return {
        "campaign.toml": text.encode(),
        "displacements.csv": _csv(moved, "%.7f"),
        "forces.csv": _csv(pulls, "%.3f"),
        "joints.csv": files["joints.csv"],
    }


def _csv(table: pd.DataFrame, digits: str) -> bytes:
    return table.to_csv(index=False, float_format=digits, lineterminator="\n").encode()
