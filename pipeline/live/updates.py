"""Repeated looks at a growing campaign: an update after every pose, and at once for a suspect."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipeline.base.errors import InputError
from pipeline.faults.mistake import Mistake
from pipeline.library.campaign import Campaign, Result, identify, load_campaign
from pipeline.live.complete_lines import snapshot
from pipeline.live.last_search import LastSearch
from pipeline.live.update import Update, measured, update_of

QUIET_S = 180.0
"""Time without a reading after which an incomplete pose is reported [s], a matter of taste:
tightening a chain takes some minutes."""

_REFUSED_S = 20.0
"""Time without a reading after which it is reported why there is no result [s]: a tracker takes
some eight seconds per reading."""


@dataclass
class LiveState:
    """State of the live judgement of a campaign.

    Attributes:
        name: Name of the campaign.
        files: Files at the last look.
        told: The last update.
        poses: Poses already reported.
    """

    name: str
    files: Mapping[str, bytes] = field(default_factory=dict)
    told: Update | None = None
    poses: set[int] = field(default_factory=set)
    _since: float = 0.0
    _owed: Update | None = None
    _search: LastSearch | None = None
    _unsearched: Campaign | None = None

    def look(self, files: Mapping[str, bytes], now: float) -> Update | None:
        """Update due for the present files; None if there is none.

        A pose is reported when the next one begins, or when it has as many readings as any before;
        if there is no reading for `QUIET_S`, as one that is still being measured. Suspects are
        reported at once, an input error when it persists. Causes are sought again when readings
        contradict the last search, before it is proposed to stop, when no planned pose is left, and
        after a quiet time.

        Args:
            files: Content by name, complete lines.
            now: Time by a monotonic clock [s].
        """
        if dict(files) == dict(self.files):
            return self._when_quiet(now - self._since)
        self.files, self._since = dict(files), now
        return self._tried(lambda: self._looked(load_campaign(files, name=self.name)))

    def _tried(self, look: Callable[[], Update | None]) -> Update | None:
        """Update of a look; an input error is kept and reported if it persists."""
        try:
            return look()
        except InputError as problem:
            pose, poses = (self.told.pose, self.told.poses) if self.told else (None, 0)
            self._owed = Update(pose, poses, accepted=False, why=str(problem))
            return None

    def _looked(self, campaign: Campaign) -> Update | None:
        """Update, from the last search if no new one is needed."""
        found = self._search.beside(campaign) if self._search else ()
        if isinstance(found, Result) and not (self.told and self.told.suspects):
            update = self._judged(campaign, found)
            if not (update.complete and self._may_end(update)):
                self._unsearched = campaign
                return self._heard(update, found)
        return self._heard(*self._sought(campaign, () if isinstance(found, Result) else found))

    def _may_end(self, update: Update) -> bool:
        """Whether it may be the last: it newly proposes to stop, or no planned pose is left."""
        decided = self.told is not None and self.told.stop.now
        return update.stop.now > decided or not any(one.pose is not None for one in update.next)

    def _sought(
        self, campaign: Campaign, doubted: tuple[Mistake, ...] = ()
    ) -> tuple[Update, Result]:
        """Update and result of a new search for causes, from the usual starts, as by `run`.

        Args:
            campaign: The campaign so far.
            doubted: What contradicts the last search.
        """
        result = identify(campaign)
        self._search = LastSearch.of(campaign, result) or self._search
        self._unsearched = None
        return replace(self._judged(campaign, result, doubted), searched=True), result

    def _judged(
        self, campaign: Campaign, result: Result, doubted: tuple[Mistake, ...] = ()
    ) -> Update:
        """Judge the newest complete pose not yet reported, or else the one being measured."""
        new = [one for one in _ended(result) if one not in self.poses]
        return update_of(campaign, result, new[-1] if new else None, doubted)

    def _heard(self, update: Update, result: Result) -> Update | None:
        """The update if it is to be reported now; otherwise it is kept."""
        self.poses |= {*_ended(result)}
        if update.complete or self._differs(update):
            return self._tell(update)
        self._owed = None if update.pose in self.poses else update
        return None

    def _when_quiet(self, quiet_s: float) -> Update | None:
        """Update that was kept, or of a new search, if it has been quiet long enough [s]."""
        owed, open_ = self._owed, self._unsearched
        refused = owed is not None and owed.why is not None
        if quiet_s < (_REFUSED_S if refused else QUIET_S):
            return None
        if open_ is None or refused:
            return None if owed is None else self._tell(owed)
        return self._tried(lambda: self._tell(self._sought(open_)[0]))

    def _differs(self, update: Update) -> bool:
        """Whether the suspects differ from those reported last."""
        before = self.told.suspects if self.told else ()
        one, other = ({(s.name, s.where) for s in of} for of in (update.suspects, before))
        return one != other

    def _tell(self, update: Update) -> Update:
        self.told, self._owed = update, None
        return update


def _ended(result: Result) -> list[int]:
    """Completely measured poses, in the order of measurement.

    All but the last, and the last if it has as many readings as any other.
    """
    readings = Counter(measured(result))
    *before, last = readings or {0: 0}
    whole = before and readings[last] >= max(readings[pose] for pose in before)
    return [*before, last] if whole else before


def live(
    folder: Path, every_s: float, sleep: Callable[[float], None] = time.sleep
) -> Iterator[Update]:
    """Yield updates of a campaign until the caller stops.

    Args:
        folder: Folder of its growing files.
        every_s: Interval between two looks [s].
        sleep: Waits; replaced in tests.
    """
    state = LiveState(folder.resolve().name)
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
