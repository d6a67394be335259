"""Progress of a run: a bar on the terminal, with the remaining time."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from pipeline.base.shown import printable

_SHARES = {"ingest": 0.01, "screen": 0.07, "fit": 0.14, "diagnose": 0.2, "render": 0.8}
"""Approximate share of a campaign's run time that has passed when a stage begins [1]."""


class Progress:
    """A bar over campaigns on stderr, with the remaining time; on a terminal only."""

    def __init__(self, total: int) -> None:
        """Make a bar for `total` campaigns."""
        from rich import progress
        from rich.console import Console

        self._bar = progress.Progress(
            progress.SpinnerColumn(),
            progress.TextColumn("{task.description}", markup=False),
            progress.BarColumn(),
            progress.MofNCompleteColumn(),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
            redirect_stdout=False,  # otherwise output would go to stderr, the console of the bar
            redirect_stderr=False,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._bar.add_task("", total=total)
        self._done, self._name = 0, ""

    def __enter__(self) -> Progress:
        """Return the bar; it appears with the first campaign."""
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the bar."""
        self._bar.stop()

    def now(self, name: str) -> None:
        """Show which campaign is being computed."""
        self._name = printable(name, 40)
        self._bar.update(self._task, description=self._name)
        self._bar.start()

    def at(self, stage: str) -> None:
        """Show which stage of the campaign begins."""
        if stage in _SHARES:
            done = max(self._done + _SHARES[stage], self._bar.tasks[0].completed)
            self._bar.update(self._task, completed=done, description=f"{self._name}: {stage}")

    def done(self) -> None:
        """Advance by one campaign; the bar is hidden, so that its result can be printed."""
        self._done += 1
        self._bar.update(self._task, completed=self._done)
        self._bar.stop()


Tell = Callable[[str], object]
"""Function that is called with the name of every stage before it is executed."""


def reporting(tell: Tell, stage: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a stage so that `tell` is called with its name before it begins."""

    def carried_out(*given: Any, **named: Any) -> Any:
        tell(stage.__name__)
        return stage(*given, **named)

    return carried_out
