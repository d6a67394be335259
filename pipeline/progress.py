"""How far it is: a bar on the terminal, with the time that remains."""

from __future__ import annotations

import sys
from typing import Any


class Progress:
    """A bar on stderr over campaigns, with the time that remains; on a terminal only."""

    def __init__(self, total: int) -> None:
        """Make a bar for so many campaigns."""
        self._total = total
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
        if self._bar is not None:
            self._bar.update(self._task, description=name)
            self._bar.start()

    def done(self) -> None:
        """One campaign further; the bar makes room for what is said about it."""
        if self._bar is not None:
            self._bar.advance(self._task)
            self._bar.stop()
