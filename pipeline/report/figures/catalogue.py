"""Every figure of the report: the annex draws them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

from pipeline.answer.contract import Answer
from pipeline.base import doors
from pipeline.base.errors import PipelineError
from pipeline.base.language import Say
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure, present
from pipeline.report.summaries import Tables, has
from pipeline.report.svg import Drawing, by_hand, drawn

_ANNEX = "pipeline.annex.figures:PLOTS"
"""Door of the annex: all figures."""
CATALOGUE: tuple[Plot, ...] = doors.found(_ANNEX) or ()
_PLOTS = {plot.name: plot for plot in CATALOGUE}


def figures(names: Sequence[str], answer: Answer, tables: Tables) -> list[Figure]:
    """The named figures that are installed and for which the campaign has data."""
    plots = [_PLOTS[name] for name in names if name in _PLOTS]
    return list(present(one.write(answer, tables) for one in plots if has(tables, *one.needs)))


def draw(name: str, answer: Answer, tables: Tables, say: Say = str) -> Drawing:
    """Draw one figure of the report; `say` translates the texts of those on the certificate.

    One that cannot be drawn costs neither report nor answer: a sentence stands in its place.
    """
    try:
        return _drawn(_PLOTS[name], answer, tables, say)
    except (MemoryError, PipelineError):  # the run has ended: a limit, Ctrl-C
        raise
    except Exception as problem:
        lost = f"The figure {name} could not be drawn (internal error, {type(problem).__name__})"
        warnings.warn(f"{lost}; the answer and its other figures are complete.", stacklevel=1)
        return by_hand(_LOST.format(lost))


_LOST = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 560 40" width="560" height="40">'
    '<text x="8" y="24" font-size="12">{}.</text></svg>'
)


def _drawn(plot: Plot, answer: Answer, tables: Tables, say: Say) -> Drawing:
    if plot.spoken:
        return by_hand(plot.spoken(answer, tables, say))
    if plot.by_hand:
        return by_hand(plot.by_hand(answer, tables))
    return drawn(plot.name, lambda canvas: plot.draw(canvas, answer, tables))


def live(name: str, answer: Answer, tables: Tables) -> dict[str, Any] | None:
    """Data of a figure that the page itself draws; None for a still picture."""
    of = _PLOTS[name].live
    return of and of(answer, tables)
