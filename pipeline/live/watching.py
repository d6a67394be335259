"""A campaign looked at again and again: told after every pose, and at once where one is suspect."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.base.errors import InputError
from pipeline.library.campaign import identify, load_campaign
from pipeline.live.growing import snapshot
from pipeline.live.judged import Update, judged, measured

QUIET_S = 180.0
"""After so long without a reading something is said of a pose that is not whole [s], taste: some
minutes go by where somebody tightens a chain."""

_REFUSED_S = 20.0
"""After so long without a reading it is told why there is nothing to say [s]: a tracker takes some
eight seconds for one."""


@dataclass
class Live:
    """What has been told of a campaign so far.

    Attributes:
        name: Of the campaign.
        files: What was there when it was last looked at.
        told: The last update.
        poses: Those that have been told.
    """

    name: str
    files: Mapping[str, bytes] = field(default_factory=dict)
    told: Update | None = None
    poses: set[int] = field(default_factory=set)
    _since: float = 0.0
    _owed: Update | None = None

    def look(self, files: Mapping[str, bytes], now: float) -> Update | None:
        """What is to be told of files as they are now; None where nothing is.

        A pose is told when the next one begins, or when it has as many readings as others had; as
        one that is still being measured when none has come for `QUIET_S`. Suspects are told at
        once, a refusal when it stays.

        Args:
            files: Content by name, whole lines.
            now: By a clock that never goes back [s].
        """
        if dict(files) == dict(self.files):
            return self._when_quiet(now - self._since)
        self.files, self._since = dict(files), now
        try:
            campaign = load_campaign(files, name=self.name)
            result = identify(campaign)
        except InputError as problem:
            pose, poses = (self.told.pose, self.told.poses) if self.told else (None, 0)
            self._owed = Update(pose, poses, accepted=False, why=str(problem))
            return None
        ended = _ended(Counter(measured(result)))
        new = [pose for pose in ended if pose not in self.poses]
        update = judged(campaign, result, new[-1] if new else None)
        self.poses |= {*new}
        if new or self._differs(update):
            return self._tell(update)
        self._owed = None if update.pose in self.poses else update
        return None

    def _when_quiet(self, quiet_s: float) -> Update | None:
        """What is owed and was held back, when nothing has changed for so long [s]."""
        owed = self._owed
        if owed is None or quiet_s < (QUIET_S if owed.why is None else _REFUSED_S):
            return None
        return self._tell(owed)

    def _differs(self, update: Update) -> bool:
        """Whether others are suspected than before."""
        before = self.told.suspects if self.told else ()
        one, other = ({(s.name, s.where) for s in of} for of in (update.suspects, before))
        return one != other

    def _tell(self, update: Update) -> Update:
        self.told, self._owed = update, None
        return update


def _ended(readings: Mapping[int, int]) -> list[int]:
    """Poses that are measured, of the number of readings of each in the order of measuring.

    All but the last, and that one where it has as many as any other.
    """
    *before, last = readings or {0: 0}
    whole = before and readings[last] >= max(readings[pose] for pose in before)
    return [*before, last] if whole else before


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
