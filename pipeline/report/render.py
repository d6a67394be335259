"""From an answer and its tables to the bytes of page, PDF and figures; no file is written."""

from __future__ import annotations

import base64
import contextlib
import gc
import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, replace
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup

from pipeline.answer.contract import Answer
from pipeline.base import doors
from pipeline.base.appearance import PLAIN, Appearance
from pipeline.base.language import spoken
from pipeline.base.quantities import typeset
from pipeline.base.shown import runs
from pipeline.base.version import __version__
from pipeline.report.record import Block, Report, ReportTable

_HERE = files("pipeline.report")

_PRINTED = "pipeline.annex.paper:printed"
"""Door of the annex: which of its tables and figures are printed."""


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """Suspend the collection of cyclic garbage, which takes a tenth of the time of a report.

    Figures consist of reference cycles that all live until the report is done; they are then
    collected at once.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@_uncollected()
def render(
    answer: Answer,
    tables: Mapping[str, pd.DataFrame],
    run_time_s: float | None = None,
    previous: Answer | None = None,
    beside: Collection[str] = (),
    wear: str | None = None,
    look: Appearance = PLAIN,
) -> dict[str, bytes]:
    """Render every file of a campaign's report.

    Args:
        answer: The answer to the campaign.
        tables: Tables by their lower-case names, in SI units; the report omits what needs a table
            that is missing.
        run_time_s: Run time [s]; the only input that may differ between two runs.
        previous: The answer to the robot's previous campaign, to report changes since then.
        beside: Names of further files in the report's folder, for links to them.
        wear: Result of all campaigns of the robot together, from `fleet.sentences.told`.
        look: Language of the certificate, and what the house adds; the annexes are in English.

    Returns:
        Content by path relative to the report's folder: index.html, report.pdf, figures/*.svg.
    """
    from pipeline.report.figures.catalogue import draw, live  # matplotlib imports for half a second
    from pipeline.report.model import compose

    there = {*beside, "report.pdf"} if beside else ()
    report = compose(answer, tables, run_time_s, previous, there, wear, look)
    say = spoken(look.language)
    drawings = {one.name: draw(one.name, answer, tables, say) for one in report.figures}
    turned = {name: live(name, answer, tables) for name in drawings}
    return {
        "index.html": page(report, {n: d.inline for n, d in drawings.items()}, turned).encode(),
        "report.pdf": pdf(report, {n: d.svg for n, d in drawings.items()}),
        **{f"figures/{n}.svg": d.svg.encode() for n, d in drawings.items()},
    }


def page(
    report: Report, drawings: Mapping[str, str], turned: Mapping[str, Any] = MappingProxyType({})
) -> str:
    """The report as one self-contained HTML page.

    The page allows only its own script, by hash, so that text from a file could not run as a script
    even if it were not escaped.

    Args:
        report: Content of the page.
        drawings: Its figures as SVG, by name.
        turned: Data of the figures that the page redraws while its reader turns them, by name.
    """
    script = _text("page.js") + (_text("scene.js") if any(turned.values()) else "")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    safe = {name: Markup(svg) for name, svg in drawings.items()}
    return _template().render(
        report=_typeset(report),
        drawings=safe,
        turned=turned,
        style=Markup(_text("page.css")),
        script=Markup(script),
        script_hash=digest,
        version=__version__,
    )


@cache
def _template() -> jinja2.Template:
    """The compiled template of the page; compiling takes a third of the time of a page."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["words"] = _words
    environment.filters["base64"] = lambda text: base64.b64encode(text.encode()).decode()
    return environment.from_string(_text("page.html.jinja"))


def _words(text: str) -> Markup:
    """A sentence in HTML, with commands to type set as code."""
    code = Markup("<code>{}</code>")
    return Markup().join(code.format(one) if typed else one for one, typed in runs(text))


def pdf(report: Report, drawings: Mapping[str, str]) -> bytes:
    """The printed part of a report as tagged PDF (PDF/UA-1); texts are passed as data, not markup.

    Args:
        report: The report.
        drawings: Its figures as SVG, by name.
    """
    import typst

    from pipeline.report.svg import FONTS

    printed = doors.found(_PRINTED)
    worst, report = report.worst, printed(report) if printed else report
    content = asdict(_typeset(report)) | {"version": __version__, "worst": worst}
    shown = {one.name: drawings[one.name] for one in report.figures}
    compiled = typst.compile(  # type: ignore[call-overload]  # its own stub lacks bytes
        _text("page.typ").encode(),
        sys_inputs={"report": json.dumps(content), "figures": json.dumps(shown)},
        font_paths=[FONTS],
        ignore_system_fonts=True,
        pdf_standards="ua-1",
        timestamp=0,
    )
    return bytes(compiled)


def _typeset(report: Report) -> Report:
    """The report with numbers and units in its tables typeset for print."""
    parts = [
        replace(part, blocks=tuple(_block(block) for block in part.blocks))
        for part in report.sections
    ]
    return replace(report, sections=tuple(parts))


def _block(block: Block) -> Block:
    if not isinstance(block, ReportTable):
        return block
    rows = tuple(
        tuple(
            cell if column.code else replace(cell, text=typeset(cell.text))
            for cell, column in zip(row, block.columns, strict=True)
        )
        for row in block.rows
    )
    return replace(block, rows=rows, note=typeset(block.note))


def _text(name: str) -> str:
    return _HERE.joinpath(name).read_text(encoding="utf-8")
