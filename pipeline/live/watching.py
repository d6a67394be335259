"""A campaign looked at again and again: told after every pose, and at once where one is suspect."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipeline.base.errors import InputError
from pipeline.faults.mistake import Mistake
from pipeline.library.campaign import Campaign, Result, identify, load_campaign
from pipeline.live.beside import Standing
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
    _search: Standing | None = None
    _unsearched: Campaign | None = None

    def look(self, files: Mapping[str, bytes], now: float) -> Update | None:
        """What is to be told of files as they are now; None where nothing is.

        A pose is told when the next one begins, or when it has as many readings as others had; as
        one that is still being measured when none has come for `QUIET_S`. Suspects are told at
        once, a refusal when it stays. Causes are sought anew with what contradicts the last search,
        before the end is proposed, when no planned pose is left, and when it gets quiet.

        Args:
            files: Content by name, whole lines.
            now: By a clock that never goes back [s].
        """
        if dict(files) == dict(self.files):
            return self._when_quiet(now - self._since)
        self.files, self._since = dict(files), now
        return self._tried(lambda: self._looked(load_campaign(files, name=self.name)))

    def _tried(self, look: Callable[[], Update | None]) -> Update | None:
        """What a look tells; that it cannot tell anything is told when it stays so."""
        try:
            return look()
        except InputError as problem:
            pose, poses = (self.told.pose, self.told.poses) if self.told else (None, 0)
            self._owed = Update(pose, poses, accepted=False, why=str(problem))
            return None

    def _looked(self, campaign: Campaign) -> Update | None:
        """What is to be told, of the last search where that stands."""
        found = self._search.beside(campaign) if self._search else ()
        if isinstance(found, Result) and not (self.told and self.told.suspects):
            update = self._judged(campaign, found)
            if not (update.complete and self._may_end(update)):
                self._unsearched = campaign
                return self._heard(update, found)
        return self._heard(*self._sought(campaign, () if isinstance(found, Result) else found))

    def _may_end(self, update: Update) -> bool:
        """Whether it may be the last: to stop is proposed anew, or no planned pose is left."""
        said = self.told is not None and self.told.stop.now
        return update.stop.now > said or not any(one.pose is not None for one in update.next)

    def _sought(
        self, campaign: Campaign, doubted: tuple[Mistake, ...] = ()
    ) -> tuple[Update, Result]:
        """Where causes are sought anew, from the usual starts, as `run` does.

        Args:
            campaign: As it is now.
            doubted: What contradicts the last search.
        """
        result = identify(campaign)
        self._search = Standing.of(campaign, result) or self._search
        self._unsearched = None
        return replace(self._judged(campaign, result, doubted), searched=True), result

    def _judged(
        self, campaign: Campaign, result: Result, doubted: tuple[Mistake, ...] = ()
    ) -> Update:
        """Of the newest pose that is measured and not told yet, or of the one being measured."""
        new = [one for one in _ended(result) if one not in self.poses]
        return judged(campaign, result, new[-1] if new else None, doubted)

    def _heard(self, update: Update, result: Result) -> Update | None:
        """It, where it is to be told."""
        self.poses |= {*_ended(result)}
        if update.complete or self._differs(update):
            return self._tell(update)
        self._owed = None if update.pose in self.poses else update
        return None

    def _when_quiet(self, quiet_s: float) -> Update | None:
        """What is owed and was held back, when nothing has changed for so long [s]."""
        owed, open_ = self._owed, self._unsearched
        refused = owed is not None and owed.why is not None
        if quiet_s < (_REFUSED_S if refused else QUIET_S):
            return None
        if open_ is None or refused:
            return None if owed is None else self._tell(owed)
        return self._tried(lambda: self._tell(self._sought(open_)[0]))

    def _differs(self, update: Update) -> bool:
        """Whether others are suspected than before."""
        before = self.told.suspects if self.told else ()
        one, other = ({(s.name, s.where) for s in of} for of in (update.suspects, before))
        return one != other

    def _tell(self, update: Update) -> Update:
        self.told, self._owed = update, None
        return update


def _ended(result: Result) -> list[int]:
    """Poses that are measured, in the order of measuring.

    All but the last, and that one where it has as many readings as any other.
    """
    readings = Counter(measured(result))
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
