"""How far it is: a bar on the terminal, with the time that remains."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from pipeline.base.shown import printable

_SHARES = {"ingest": 0.01, "screen": 0.07, "fit": 0.14, "diagnose": 0.2, "render": 0.8}
"""How much of a campaign's time has passed when a stage begins, about."""


class Progress:
    """A bar on stderr over campaigns, with the time that remains; on a terminal only."""

    def __init__(self, total: int) -> None:
        """Make a bar for so many campaigns."""
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
            redirect_stdout=False,  # else what is printed would go to stderr, the bar's console
            redirect_stderr=False,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._bar.add_task("", total=total)
        self._done, self._name = 0, ""

    def __enter__(self) -> Progress:
        """Make it ready."""
        return self

    def __exit__(self, *_: object) -> None:
        """Take it away."""
        self._bar.stop()

    def now(self, name: str) -> None:
        """Say which campaign is being computed."""
        self._name = printable(name, 40)
        self._bar.update(self._task, description=self._name)
        self._bar.start()

    def at(self, stage: str) -> None:
        """Say which of its stages begins."""
        if stage in _SHARES:
            done = max(self._done + _SHARES[stage], self._bar.tasks[0].completed)
            self._bar.update(self._task, completed=done, description=f"{self._name}: {stage}")

    def done(self) -> None:
        """One campaign further; the bar makes room for what is said about it."""
        self._done += 1
        self._bar.update(self._task, completed=self._done)
        self._bar.stop()


Tell = Callable[[str], object]
"""Hears the name of every stage before it is carried out."""


def told(tell: Tell, stage: Callable[..., Any]) -> Callable[..., Any]:
    """A stage that says its name before it begins."""

    def carried_out(*given: Any, **named: Any) -> Any:
        tell(stage.__name__)
        return stage(*given, **named)

    return carried_out
