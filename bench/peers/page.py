"""The tables of docs/peers.md, between marks that preserve the rest."""

import ast
import io
import json
import tokenize
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.peers import cut, judge
from bench.peers.run import DH, FOREIGN, LEARNED, OURS, PAPER, Outcome

BEGIN, END = "<!-- make peers writes from here -->", "<!-- to here -->"
HERE = Path(__file__).parent
MM = 1e3
COMMANDS = 2
"""`pipeline run NAME` and `pipeline predict NAME poses.csv`."""


def record(outcomes: Iterable[Outcome]) -> dict[str, dict[str, dict[str, Any]]]:
    """Errors [mm] by trial and tool, with their intervals, and CPU times [s]."""
    found = list(outcomes)
    ours = {one.trial: one.off for one in found if one.tool == OURS}
    out: dict[str, dict[str, dict[str, Any]]] = {}
    for one in found:
        e = judge.errors(one.off, one.cluster)
        out.setdefault(one.trial, {})[one.tool] = {
            "mean_mm": MM * e.mean,
            "mean_ci95_mm": [MM * v for v in e.mean_ci],
            "rms_mm": MM * e.rms,
            "rms_ci95_mm": [MM * v for v in e.rms_ci],
            "largest_mm": MM * e.most,
            "over_ours": list(judge.ratio(one.off, ours[one.trial], one.cluster)),
            "targets": e.n,
            "clusters": e.clusters,
            "seconds": None if np.isnan(one.seconds) else round(one.seconds, 2),
        }
    return out


def written(said: dict[str, dict[str, dict[str, Any]]], twice: str) -> str:
    """Text between the marks.

    Args:
        said: Record as from `record`.
        twice: Differences from the previous run, from `again`.
    """
    trials = (*cut.TRIALS, *cut.LOADS)
    parts = [_table(one.said, said[one.name]) for one in trials if one.name in said]
    return "\n\n".join([*parts, _typed(), f"## Run again\n\n{twice}"])


def _table(title: str, tools: dict[str, dict[str, Any]]) -> str:
    any_ = tools[OURS]
    head = ("tool", "mean [mm]", "rms [mm]", "largest [mm]", f"mean / {OURS}", "processor [s]")
    return "\n".join(
        [
            f"## {title}",
            "",
            f"*{any_['targets']} targets held out, in {any_['clusters']} clusters.*",
            "",
            *_markdown(head, (_row(*pair) for pair in sorted(tools.items(), key=_worst))),
        ]
    )


def _worst(pair: tuple[str, dict[str, Any]]) -> float:
    return -float(pair[1]["mean_mm"])


def _row(tool: str, one: dict[str, Any]) -> tuple[str, ...]:
    return (
        tool,
        _with(one["mean_mm"], one["mean_ci95_mm"]),
        _with(one["rms_mm"], one["rms_ci95_mm"]),
        f"{one['largest_mm']:.3f}",
        "" if tool == OURS else _with(one["over_ours"][0], one["over_ours"][1:], 2),
        "" if one["seconds"] is None else f"{one['seconds']:.2g}",
    )


def _markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(one)} |" for one in (head, ["---"] * len(head), *rows)]


def _with(value: float, ends: Sequence[float], digits: int = 4) -> str:
    return f"{value:.{digits}f} ({ends[0]:.{digits}f} to {ends[1]:.{digits}f})"


def code_lines(path: Path) -> int:
    """Number of lines of code: neither blank, nor comment, nor docstring."""
    text = path.read_text("utf-8")
    if path.suffix != ".py":
        return sum(bool(line.partition("#")[0].strip()) for line in text.splitlines())
    idle = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
            tokenize.ENDMARKER)  # fmt: skip
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    used = {k for t in tokens if t.type not in idle for k in range(t.start[0], t.end[0] + 1)}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.FunctionDef, ast.ClassDef)) and ast.get_docstring(
            node
        ):
            first = node.body[0]
            used -= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return len(used)


def _typed() -> str:
    """Table of what a user types with each tool, counted in the files that were used."""
    names = ("ur10_ipa", "ur5_tsinghua", "kr500_demo")
    settings = " / ".join(str(code_lines(cut.RAW / t / "campaign.toml")) for t in names)
    arm, dh, more, springs, figaroh = (
        code_lines(HERE / name)
        for name in ("arm.py", "dh.py", "learned.py", "springs.py", "foreign/figaroh_run.py")
    )
    table = code_lines(cut.RAW / "ur5_tsinghua/ur5.toml")
    yaml = code_lines(FOREIGN / "figaroh.yaml")
    metres = "a CSV in metres and radians"
    rows = (
        (f"{OURS}, UR10 / UR5 / KR500", f"{settings} of campaign.toml, {COMMANDS} commands",
         f"ships / a file of {table} lines / ships", "the files as they are"),
        ("FIGAROH", f"{yaml} of YAML, {figaroh} of Python", "a URDF, as makers publish it",
         f"{metres}, under its names"),
        (DH, f"{arm + dh} of Python", "its table", metres),
        (LEARNED, f"{arm + dh + more} of Python", "its table", metres),
        (PAPER, f"{arm + springs} of Python", "its table", "the files of these campaigns"),
    )  # fmt: skip
    head = ("tool", "lines typed", "the robot", "the readings")
    return "\n".join(["## What one types", "", *_markdown(head, rows)])


def again(said: dict[str, Any], before: dict[str, Any] | None) -> str:
    """Differences of this run from the previous one, in words."""
    if before is None:
        return "There is no earlier run to compare with."
    pairs = [
        (f"{tool}, {trial}", one, before[trial][tool])
        for trial, tools in said.items()
        for tool, one in tools.items()
        if tool in before.get(trial, {})
    ]
    off = {name: max(abs(a[k] - b[k]) for k in ("mean_mm", "rms_mm", "largest_mm"))
           for name, a, b in pairs}  # fmt: skip
    times = [a["seconds"] / b["seconds"] for _, a, b in pairs if a["seconds"] and b["seconds"]]
    worst = max(off, key=lambda name: off[name])
    errors = (
        f"no error differs in any digit ({len(off)} rows)"
        if off[worst] == 0
        else f"the errors differ by at most {off[worst]:.2g} mm ({worst})"
    )
    return (
        f"Against the run before {errors}; times of the processor are {min(times):.2f} to "
        f"{max(times):.2f} of what they were then."
    )


def placed(old: str, text: str) -> str:
    """A page with new text between the marks."""
    before, begun, rest = old.partition(BEGIN)
    _, ended, after = rest.partition(END)
    if not (begun and ended):
        before, after = old, "\n"
    return f"{before}{BEGIN}\n\n{text}\n\n{END}{after}"


def dumped(said: dict[str, Any]) -> str:
    """The record as it is stored."""
    return json.dumps(said, indent=1) + "\n"
