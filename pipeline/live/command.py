"""`pipeline watch --live`: a campaign judged pose by pose, as sentences or as lines of JSON."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from pipeline.base.errors import InputError
from pipeline.base.quantities import common_prefix, prefixed, with_uncertainty
from pipeline.base.shown import say
from pipeline.live.update import Update
from pipeline.live.updates import live as updates

_LISTED = 3
"""Maximum number of planned poses that the terminal lists."""


def live(name: str, root: Path, every_s: float, as_json: bool) -> None:
    """Judge a campaign while it is measured, until Ctrl-C.

    Args:
        name: Name of its folder below data/raw, or its path.
        root: Root of the project.
        every_s: Interval between two looks [s].
        as_json: Whether to print one JSON object per line instead of sentences.

    Raises:
        InputError: There is no such folder with a campaign.toml.
    """
    there = [one for one in (root / "data" / "raw" / name, Path(name)) if one.is_dir()]
    if not there or not (there[0] / "campaign.toml").is_file():
        raise InputError(
            f"there is no campaign {name}: neither below {root / 'data' / 'raw'} nor as a folder "
            "has it a campaign.toml",
            f"write one with `pipeline init {name}`",
        )
    beside = f"Watching {there[0]}: a pose is told when it is measured; Ctrl-C ends."
    say(beside, sys.stderr)
    for update in updates(there[0], every_s):
        if as_json:
            say(update.as_json())
        else:
            for line in sentences(update):
                say(line)


def sentences(update: Update) -> Iterator[str]:
    """Sentences of an update, for an engineer at the robot."""
    if update.why is not None:
        yield f"Nothing to say yet: {update.why}"
        return
    yield f"Pose {update.pose}: {'accepted' if update.accepted else 'look at it'}. " + _known(
        update
    )
    yield from (f"  {one.text}" for one in update.suspects)
    yield from (f"  {one}" for one in update.warnings)
    for one in () if update.stop.now else update.next[:_LISTED]:
        at = ", ".join(f"{axis} {value:.3f} {unit}" for axis, value, unit in one.axes)
        which = f"pose {one.pose}" if one.pose is not None else "a pose"
        yield f"  Next: {which} ({one.text}): {at}"
    if update.stop.now:
        yield f"  Stop: {update.stop.text}; {update.stop.saved_poses} planned poses are not needed."
    else:
        yield f"  Go on: {update.stop.text}."


def _known(update: Update) -> str:
    """The stiffnesses in one line."""
    found = []
    for one in update.stiffness:
        if one.value is None or one.std is None:
            found.append(f"{one.axis} open")
        else:
            factor, letter = common_prefix([one.value])
            value, std = with_uncertainty(one.value / factor, one.std / factor)
            found.append(f"{one.axis} {value} ± {std} {prefixed(one.unit, letter)}")
    return "; ".join(found)
