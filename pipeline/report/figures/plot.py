"""A figure of the report: what is said of it and how it is drawn, in one record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure as Canvas

from pipeline.answer.contract import Answer
from pipeline.base.language import Say
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables

Tips = dict[str, list[str]]
"""By id of an artist, the words of each of its marks in drawing order."""


def _nothing(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    return {}


@dataclass(frozen=True)
class Plot:
    """One figure.

    Attributes:
        name: File name without ending.
        needs: Tables without which there is no such figure.
        write: Title, caption and alternative text with the numbers of a campaign in them; None
            where the campaign has no data for it.
        draw: Draws it, and gives what its marks say, by the name of their group.
        live: Numbers from which the page draws it anew as its reader turns it; None for a still.
        by_hand: Gives it as SVG, in place of `draw`.
        spoken: The same of a figure of the certificate, in a language.
    """

    name: str
    needs: tuple[str, ...]
    write: Callable[[Answer, Tables], Figure | None]
    draw: Callable[[Canvas, Answer, Tables], Tips] = _nothing
    live: Callable[[Answer, Tables], dict[str, Any]] | None = None
    by_hand: Callable[[Answer, Tables], str] | None = None
    spoken: Callable[[Answer, Tables, Say], str] | None = None
