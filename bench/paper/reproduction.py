"""`make paper`: the paper's numbers compared with ours, printed and as a page."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.paper.tables import ASSUMPTIONS, MISPRINTS, Entry, Reproduction, reproduce
from pipeline.base import files
from pipeline.base.quantities import plain
from pipeline.machine.robot import load as load_robot
from pipeline.store.campaign import dump

ROBOTS = ("kr500_rail", "kr500_rail_kuka")
"""Table I as printed, and the real arm."""


@dataclass(frozen=True, eq=False)
class Made:
    """Both reproductions.

    Attributes:
        parts: One for each robot.
        seconds: Wall time [s].
    """

    parts: tuple[Reproduction, ...]
    seconds: float

    def content(self) -> dict[str, Any]:
        """Content printed by --json."""
        return {
            "assumptions": ASSUMPTIONS,
            "misprints": MISPRINTS,
            "robots": {
                part.robot: [asdict(one) | {"ratio": one.ratio} for one in part.entries]
                for part in self.parts
            },
            "seconds": round(self.seconds, 3),
        }

    def as_json(self) -> str:
        """One line of JSON."""
        return json.dumps(self.content(), ensure_ascii=False, allow_nan=False)

    def as_text(self) -> str:
        """Readable text: assumptions, misprints, then entry by entry."""
        lines = ["Assumptions", *(f"  {line}" for line in ASSUMPTIONS), ""]
        lines += ["Misprints and gaps", *(f"  {line}" for line in MISPRINTS)]
        for part in self.parts:
            lines += ["", part.robot, _line("entry", "paper", "ours", "ratio", "better plan", "")]
            lines += [_shown(one) for one in part.entries]
        return "\n".join(lines)


def run(seed: int, repetitions: int, poses: int, say: Callable[[str], None]) -> Made:
    """Reproduce the paper for both robots.

    Args:
        seed: Determines every draw and search.
        repetitions: Repetitions of Table IV.
        poses: Validation poses of each set of Table V.
        say: Called with one line of progress at a time.
    """
    began = time.perf_counter()
    parts = []
    for name in ROBOTS:
        say(f"{name} ...")
        parts.append(reproduce(load_robot(name), seed, repetitions, poses))
    return Made(tuple(parts), time.perf_counter() - began)


def write(root: Path, made: Made) -> Path:
    """Write the page, the PDF and the numbers to reports/paper; return the page."""
    from bench.paper.page import paper_files  # matplotlib takes half a second to import

    folder = root / "reports" / "paper"
    for inner, data in paper_files(made.parts, made.seconds).items():
        files.write(folder / inner, data)
    files.write(folder / "paper.json", dump(made.content()))
    return folder / "index.html"


def _shown(one: Entry) -> str:
    words = f"{one.table}: {one.what}" + (f" [{one.unit}]" if one.unit != "1" else "")
    paper, ours, better = plain(one.paper, 4), plain(one.ours, 4), plain(one.better, 4)
    return _line(words, paper, ours, plain(one.ratio, 4), better, one.note)


def _line(what: str, paper: str, ours: str, ratio: str, better: str, note: str) -> str:
    return f"  {what:58} {paper:>9} {ours:>9} {ratio:>8} {better:>11}  {note}".rstrip()
