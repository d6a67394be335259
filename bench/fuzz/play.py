"""Run a campaign of arbitrary bytes through the pipeline, and record the result as plain facts."""

from __future__ import annotations

import json
import tempfile
import tomllib
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pyarrow as pa

from bench.fuzz.mutation import Files
from pipeline.answer.results import CampaignAnswer
from pipeline.base.errors import InputError, PipelineError
from pipeline.exchange.files import simulators
from pipeline.library.model_file import dumps
from pipeline.machine.robot import Robot
from pipeline.reduction.bring import conformed
from pipeline.report.render import render
from pipeline.run import campaign_answer
from pipeline.store.campaign import CampaignFolder, dump

SCREENED, ANSWER = "screened", "answer"
DEPTHS = (SCREENED, ANSWER)


@dataclass
class Reported:
    """What the pipeline reports of a campaign.

    Attributes:
        verdict: Verdict; empty if the run was stopped before.
        reason: Reason for the recommended values.
        words: Everything reported against data or model, each as a comparable word.
        blind: Names of the blind spots.
        rejected: Number of rejected rows.
        compliance: Compliance of every joint [SI]; None if there is none.
        std: Their standard uncertainties; None if not determined.
        p_value: Of the misfit; None without a stated noise.
        nominal: Whether the robot file states stiffnesses.
        factor: Whether all stiffnesses are said to be one factor off the file's.
        not_finite: Columns with numbers that are not finite although their schema excludes that.
    """

    verdict: str = ""
    reason: str = ""
    words: set[str] = field(default_factory=set)
    blind: set[str] = field(default_factory=set)
    rejected: int = 0
    compliance: tuple[float | None, ...] = ()
    std: tuple[float | None, ...] = ()
    p_value: float | None = None
    nominal: bool = True
    factor: bool = False
    not_finite: list[str] = field(default_factory=list)


@dataclass
class Played:
    """Result of a campaign.

    Attributes:
        reported: What was reported, as far as it got.
        refused: Sentence of a rejection.
        exit_code: Exit code of the rejection.
        file: File that the rejection names.
        way_out: Remedy that it proposes.
        error: Type and message of an exception other than a rejection.
        where: Innermost line of the project's code.
        not_finite: Keys of result.json with numbers that are not finite.
        unreadable: Output files that a reader of their format rejects.
        warned: Warnings of the libraries.
        trace: Traceback of an error.
    """

    reported: Reported = field(default_factory=Reported)
    refused: str = ""
    exit_code: int = 0
    file: str | None = None
    way_out: str = ""
    error: str = ""
    where: str = ""
    not_finite: tuple[str, ...] = ()
    unreadable: tuple[str, ...] = ()
    warned: tuple[str, ...] = ()
    trace: str = ""


class _Far(BaseException):
    """Stops a run before the diagnosis."""


@dataclass(eq=False)
class Watch:
    """Executes stages and keeps tables, and records what they return.

    Attributes:
        further: Called before the diagnosis; returns whether it is needed.
        reported: What was recorded.
    """

    further: Callable[[Reported], bool]
    reported: Reported = field(default_factory=Reported)

    def step(self, stage: Callable[..., Any]) -> Callable[..., Any]:
        """The stage with recording."""

        @wraps(stage)
        def watched(*args: Any, **kwargs: Any) -> Any:
            if stage.__name__ == "diagnose":
                self._springs(args[2])
                if not self.further(self.reported):
                    raise _Far
            got = stage(*args, **kwargs)
            if stage.__name__ in ("files_of", "singles_of"):
                self.reported.words |= {f"mistake {m.name}" for m in got.findings}
            return got

        return watched

    def keep(
        self, name: str, table: pd.DataFrame | pa.Table | None, promise: pa.Schema
    ) -> pd.DataFrame:
        """The table in its schema, with its numbers checked."""
        kept = conformed(name, table, promise)
        if name == "13_rejected":
            self.reported.rejected = len(kept)
        for column in promise:
            if pa.types.is_floating(column.type) and not _may_be_nan(promise, column):
                values = kept[column.name].to_numpy(float)
                if not np.isfinite(values).all():
                    self.reported.not_finite.append(f"{name}.{column.name}")
        return kept

    def _springs(self, estimate: Any) -> None:
        std = np.sqrt(np.abs(np.diag(estimate.cov)))
        known = np.isfinite(std)
        self.reported.compliance = tuple(estimate.value.tolist())
        self.reported.std = tuple(float(s) if k else None for s, k in zip(std, known, strict=True))
        self.reported.p_value = estimate.p_value


_OPEN = (
    *("estimate", "covariance", "diagnosis", "separability", "examined"),
    *("validation", "workspace"),
)
"""Tables in which infinity is allowed: what is not determined has infinite uncertainty."""

_TIMES = ("time_s", "zero_time_s")
"""NaN if an export has no times, although only one table's schema states that."""


def _may_be_nan(promise: pa.Schema, column: pa.Field) -> bool:
    about, table = column.metadata[b"meaning"].decode(), promise.metadata[b"table"].decode()
    if column.name in _TIMES or table in _OPEN:
        return True
    return column.nullable or "NaN" in about or "infinite" in about


def play(files: Files, to: str, further: Callable[[Reported], bool], shown: bool = False) -> Played:
    """Run a campaign as far as asked, or as far as it gets.

    Args:
        files: Content of its folder.
        to: One of `DEPTHS`.
        further: Whether a campaign to be screened only must be diagnosed, given the results so far.
        shown: Whether a report of the answer is made.
    """
    watch = Watch(lambda reported: to == ANSWER or further(reported))
    played = Played(reported=watch.reported)
    with warnings.catch_warnings(record=True) as warned, tempfile.TemporaryDirectory() as root:
        warnings.simplefilter("always")
        try:
            raw = _folder(Path(root), files).read()
            watch.reported.nominal = _states_stiffness(raw.robot)
            found = campaign_answer("fuzzed", raw, watch.keep, watch.step)
            _read(played, found, shown)
        except _Far:
            pass
        except PipelineError as problem:
            played.refused, played.exit_code = str(problem), problem.exit_code
            played.where = _innermost(problem)
            if isinstance(problem, InputError):
                played.file, played.way_out = problem.file, problem.way_out
        except Exception as problem:
            played.error = f"{type(problem).__name__}: {problem}"
            played.where = _innermost(problem)
            played.trace = "".join(traceback.format_exception(problem)[-60:])
    played.warned = tuple(sorted({f"{w.category.__name__}: {w.message}"[:200] for w in warned}))
    return played


def _folder(root: Path, files: Files) -> CampaignFolder:
    folder = root / "data" / "raw" / "fuzzed"
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return CampaignFolder(root, folder)


def _states_stiffness(robot: Robot) -> bool:
    return "stiffness_n" in robot.text


def _read(played: Played, found: CampaignAnswer, shown: bool) -> None:
    """Record an answer, from its result.json alone."""
    reported, answer = played.reported, found.answer.as_json()
    played.not_finite = tuple(_not_finite(answer))
    dump(answer)
    diagnosis = answer["diagnosis"]
    reported.verdict, reported.reason = diagnosis["verdict"], answer["recommended"]["reason"]
    reported.words |= {f"reason {reason}" for reason in diagnosis["reasons"]}
    reported.words |= {f"cause {cause['name']}:{cause['where']}" for cause in diagnosis["causes"]}
    reported.words |= {f"noise from {answer['noise']['from']}"}
    for spring in answer["stiffness"]:
        reported.words |= {f"{spring['name']} {remark['odd']}" for remark in spring["remarks"]}
        if spring["value"] is None:
            reported.words.add(f"{spring['name']} has no value")
    reported.words |= {
        "finding " + "".join(c for c in f if c.isalpha())[:40] for f in answer["findings"]
    }
    reported.blind = {spot["name"] for spot in diagnosis["blind_spots"]}
    reported.rejected = len(answer["rejected"])
    reported.compliance = tuple(spring["compliance"] for spring in answer["stiffness"])
    reported.std = tuple(spring["compliance_std"] for spring in answer["stiffness"])
    reported.p_value = answer["fit"]["p_value"]
    reported.factor = "common_factor" in answer
    played.unreadable = tuple(
        _unreadable({"model.toml": dumps(found.model).encode(), **simulators(found.model)})
    )
    if shown:
        pages = render(found.answer, found.shown, 0.0, None)
        pages["index.html"].decode("utf-8")


def _not_finite(part: Any, path: str = "result.json") -> list[str]:
    """Keys of numbers that are not finite."""
    if isinstance(part, dict):
        return [bad for key, each in part.items() for bad in _not_finite(each, f"{path}.{key}")]
    if isinstance(part, list):
        return [bad for each in part for bad in _not_finite(each, f"{path}[]")]
    return [path] if isinstance(part, float) and not np.isfinite(part) else []


def _unreadable(products: dict[str, bytes]) -> Sequence[str]:
    """Output files whose content is not valid in their format."""
    bad = []
    try:
        tomllib.loads(products["model.toml"].decode())
    except ValueError as problem:
        bad.append(f"model.toml: {problem}"[:200])
    for name in ("model.urdf", "model.xml", "model.sdf"):
        try:
            ElementTree.fromstring(products[name])
        except (ElementTree.ParseError, ValueError) as problem:
            bad.append(f"{name}: {problem}"[:200])
    return bad


def _innermost(problem: BaseException) -> str:
    """The last line of the project's own code on the way to an error."""
    frames = traceback.extract_tb(problem.__traceback__)
    own = [frame for frame in frames if "/pipeline/" in frame.filename]
    if not own:
        return ""
    last = own[-1]
    return f"{last.filename.rpartition('/pipeline/')[2]}:{last.lineno} {last.name}"


def as_row(played: Played) -> dict[str, Any]:
    """What is kept of the result, as JSON."""
    kept = {
        "verdict": played.reported.verdict,
        "refused": played.refused[:1200],
        "where": played.where,
        "warned": list(played.warned),
    }
    return json.loads(json.dumps({name: value for name, value in kept.items() if value}))
