"""Every number of a file that people write has to be one."""

import copy
import tomllib
from pathlib import Path

import pytest
from pydantic import ValidationError

from pipeline.base.strict import Numbers
from pipeline.library.preferences import Preferences
from pipeline.machine.robot import mdh
from pipeline.reduction.settings import Settings
from pipeline.simulate.plan import Plan

HERE = Path(__file__).parents[2]
FILES = {
    "campaign": (Settings, HERE / "data/raw/kr500_demo/campaign.toml"),
    "displacements": (Settings, HERE / "data/raw/fanuc_r2000ic/campaign.toml"),
    "robot": (mdh.RobotFile, Path(mdh.__file__).parent / "kr500_rail.toml"),
    "plan": (
        Plan,
        {
            "name": "a",
            "seed": 1,
            "poses": {"count": 7},
            "pulls": {"steps_n": [1500.0]},
            "tool": {"P1": [0.1, 0.2, 0.3], "load_point": [0.0, 0.0, 0.1]},
        },
    ),
    "preferences": (
        Preferences,
        {"service": {"interval_s": 5.0, "port": 4200, "limit_s": 10.0, "memory_gib": 1.0}},
    ),
}


def numbers(content, path=()):
    """Where the numbers of a file are."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in pairs:
        if isinstance(value, dict | list):
            yield from numbers(value, (*path, key))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*path, key)


def changed(content, path, value):
    out = copy.deepcopy(content)
    *above, last = path
    place = out
    for key in above:
        place = place[key]
    place[last] = value
    return out


@pytest.mark.parametrize(("kind", "file"), FILES.values(), ids=FILES)
def test_truth_is_no_number(kind, file):
    """`sigma_m = true` would be a metre: each number of these files, replaced, is refused."""
    content = tomllib.loads(file.read_text("utf-8")) if isinstance(file, Path) else file
    places = list(numbers(content))

    assert issubclass(kind, Numbers)
    assert len(places) > 3
    for path in places:
        with pytest.raises(ValidationError, match="true and false are no numbers"):
            kind.model_validate(changed(content, path, True))


@pytest.mark.parametrize("value", [0, "0", "3.11.2026", 20261103])
def test_a_number_is_no_day(value):
    """`calibrated = 0` would be the first of January 1970."""
    kind, file = FILES["campaign"]
    content = tomllib.loads(file.read_text("utf-8"))
    content["scale"]["calibrated"] = "2026-11-03"
    kind.model_validate(content)
    content["scale"]["calibrated"] = value
    with pytest.raises(ValidationError):
        kind.model_validate(content)
