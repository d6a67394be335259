"""A figure of the report: its texts and its drawing in one record."""

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
"""Texts shown at the marks of an artist, in drawing order, by id of the artist."""


@dataclass(frozen=True)
class Plot:
    """One figure.

    Attributes:
        name: File name without ending.
        needs: Tables that the figure requires.
        write: Gives title, caption and alternative text with the numbers of a campaign; None if
            the campaign has no data for it.
        draw: Draws the figure and returns the texts of its marks by id of their artist.
        live: Gives the data from which the page redraws the figure while its reader turns it; None
            for a still picture.
        by_hand: Returns the figure as SVG, in place of `draw`.
        spoken: Returns a figure of the certificate as SVG, with its texts translated.
    """

    name: str
    needs: tuple[str, ...]
    write: Callable[[Answer, Tables], Figure | None]
    draw: Callable[[Canvas, Answer, Tables], Tips] = lambda *_: {}
    live: Callable[[Answer, Tables], dict[str, Any]] | None = None
    by_hand: Callable[[Answer, Tables], str] | None = None
    spoken: Callable[[Answer, Tables, Say], str] | None = None
