"""A campaign looked at again and again: told after every pose, and at once where one is suspect."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.base.errors import InputError
from pipeline.library.campaign import Campaign, identify, load_campaign
from pipeline.live.growing import snapshot
from pipeline.live.judged import Update, judged, measured

QUIET_S = 20.0
"""Without a new reading for so long a pose is done: a tracker takes some eight seconds for one."""


@dataclass
class Live:
    """What has been told of a campaign so far.

    Attributes:
        name: Of the campaign.
        files: What was there when it was last looked at.
        told: The last update.
        readings: Of each pose when it was told, by its number.
    """

    name: str
    files: Mapping[str, bytes] = field(default_factory=dict)
    told: Update | None = None
    readings: dict[int, int] = field(default_factory=dict)
    _since: float = 0.0
    _owed: Update | None = None

    def look(self, files: Mapping[str, bytes], now: float) -> Update | None:
        """What is to be told of files as they are now; None where nothing is.

        A pose is told once: when the next one begins, when it has as many readings as others had,
        or when none has come for `QUIET_S`. Suspects are told at once, a refusal when it stays.

        Args:
            files: Content by name, whole lines.
            now: By a clock that never goes back [s].
        """
        if dict(files) == dict(self.files):
            if self._owed is not None and now - self._since >= QUIET_S:
                return self._tell(self._owed)
            return None
        self.files, self._since = dict(files), now
        update, counts = self._judge(files)
        done = self._done(update, counts)
        if done or self._differs(update):
            return self._tell(update, counts if done else None)
        self._owed = update
        return None

    def _judge(self, files: Mapping[str, bytes]) -> tuple[Update, dict[int, int]]:
        """What is known, and how many readings each pose has."""
        try:
            campaign: Campaign = load_campaign(files, name=self.name)
            result = identify(campaign)
        except InputError as problem:
            before = self.told
            pose, poses = (before.pose, before.poses) if before else (None, 0)
            return Update(pose, poses, accepted=False, why=str(problem)), {}
        return judged(campaign, result), Counter(measured(result))

    def _done(self, update: Update, counts: dict[int, int]) -> bool:
        """Whether the last pose that has readings is measured, and was not told before."""
        if update.pose is None or update.why is not None:
            return False
        here = counts.get(update.pose, 0)
        others = [n for pose, n in counts.items() if pose != update.pose]
        new = [pose for pose in counts if pose not in self.readings and pose != update.pose]
        whole = bool(others) and here >= max(others)
        return bool(new) or (whole and update.pose not in self.readings)

    def _differs(self, update: Update) -> bool:
        """Whether others are suspected than before; a refusal may pass with the next reading."""
        if update.why is not None:
            return False
        before = self.told.suspects if self.told else ()
        one, other = ({(s.name, s.where) for s in of} for of in (update.suspects, before))
        return one != other

    def _tell(self, update: Update, counts: dict[int, int] | None = None) -> Update:
        self.told, self._owed = update, None
        if counts is None and update.pose is not None and update.why is None:
            counts = {update.pose: 1}
        self.readings |= counts or {}
        return update


def live(
    folder: Path, every_s: float, sleep: Callable[[float], None] = time.sleep
) -> Iterator[Update]:
    """Updates of a campaign for as long as somebody wants them.

    Args:
        folder: Where its files grow.
        every_s: How often to look [s].
        sleep: Waits; another one in tests.
    """
    state = Live(folder.resolve().name)
    while True:
        try:
            files = snapshot(folder)
        except InputError as problem:
            if not problem.passing:
                raise
        else:
            if (update := state.look(files, time.monotonic())) is not None:
                yield update
        sleep(every_s)
