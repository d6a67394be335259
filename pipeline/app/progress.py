"""How far it is: a bar on the terminal, with the time that remains."""

from __future__ import annotations

import sys
from typing import Any

_SHARES = {"ingest": 0.01, "screen": 0.07, "fit": 0.14, "diagnose": 0.2, "render": 0.8}
"""How much of a campaign's time has passed when a stage begins, about."""


class Progress:
    """A bar on stderr over campaigns, with the time that remains; on a terminal only."""

    def __init__(self, total: int) -> None:
        """Make a bar for so many campaigns."""
        self._total, self._done, self._name = total, 0, ""
        self._bar: Any = None

    def __enter__(self) -> Progress:
        """Make it ready."""
        if sys.stderr.isatty():
            from rich import progress
            from rich.console import Console

            self._bar = progress.Progress(
                progress.SpinnerColumn(),
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.MofNCompleteColumn(),
                progress.TimeElapsedColumn(),
                progress.TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
                redirect_stdout=False,  # else what is printed would go to stderr, the bar's console
                redirect_stderr=False,
            )
            self._task = self._bar.add_task("", total=self._total)
        return self

    def __exit__(self, *_: object) -> None:
        """Take it away."""
        if self._bar is not None:
            self._bar.stop()

    def now(self, name: str) -> None:
        """Say which campaign is being computed."""
        self._name = name
        if self._bar is not None:
            self._bar.update(self._task, description=name)
            self._bar.start()

    def at(self, stage: str) -> None:
        """Say which of its stages begins."""
        if self._bar is not None and stage in _SHARES:
            done = max(self._done + _SHARES[stage], self._bar.tasks[0].completed)
            self._bar.update(self._task, completed=done, description=f"{self._name}: {stage}")

    def done(self) -> None:
        """One campaign further; the bar makes room for what is said about it."""
        self._done += 1
        if self._bar is not None:
            self._bar.update(self._task, completed=self._done)
            self._bar.stop()
