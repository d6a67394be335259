"""Number of digits in which our values agree with the certified ones."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.base.arrays import Array
from pipeline.reduction.bring import bring
from pipeline.reduction.register import register
from pipeline.run import campaign_answer, ingested
from pipeline.store.campaign import Raw, in_memory
from pipeline.system.estimate import identify

CASES = Path(__file__).with_name("cases")
MOST = 15.0
"""Maximum number of digits: that of the certified values."""


@dataclass(frozen=True)
class Agreement:
    """Digits in which one case agrees, LRE = -log10(|q - c| / |c|) (McCullough 1998).

    Attributes:
        case: Name of the case.
        value: Fewest digits of any parameter; of a rotation matrix and a translation, each as a
            whole.
        std: Fewest digits of any standard uncertainty.
        squares: Digits of the sum of squares.
    """

    case: str
    value: float
    std: float
    squares: float


@dataclass(frozen=True, eq=False)
class Numbers:
    """Numbers to be compared, in parts that each have one norm.

    Attributes:
        value: Parts of the estimates.
        std: Parts of the standard uncertainties.
        squares: Minimised sum of squares.
    """

    value: tuple[Array, ...]
    std: tuple[Array, ...]
    squares: float


def names() -> list[str]:
    """The cases in order of difficulty, as in docs/reference.md."""
    order = "plain few floor scales drowned collinear zeros common weights poses soft placing"
    return order.split()


def content(case: str) -> dict[str, bytes]:
    """The raw files of a case."""
    return {
        path.name: path.read_bytes()
        for path in sorted((CASES / case).iterdir())
        if path.name != "certified.json"
    }


def agreement(case: str) -> Agreement:
    """Estimate a case as the pipeline does, and count digits."""
    return compared(case, estimated(case))


def compared(case: str, ours: Numbers) -> Agreement:
    """Digits in which numbers of a case agree."""
    true = certified(case)
    return Agreement(
        case,
        min(_digits(a, b) for a, b in zip(ours.value, true.value, strict=True)),
        min(_digits(a, b) for a, b in zip(ours.std, true.std, strict=True)),
        _digits(np.array([ours.squares]), np.array([true.squares])),
    )


def _digits(ours: Array, true: Array) -> float:
    """Log relative error of a part: largest difference over its norm."""
    off = float(np.abs(ours - true).max() / np.linalg.norm(true))
    return MOST if off < 10**-MOST else float(-np.log10(off))


def certified(case: str) -> Numbers:
    """The certified numbers of a case; each compliance is a separate part."""
    said = json.loads((CASES / case / "certified.json").read_text("utf-8"))
    value = np.array([float(one["value"]) for one in said["parameters"]])
    std = [None if one["std"] is None else float(one["std"]) for one in said["parameters"]]
    squares = float(said["sum_of_squares"])
    if case == "placing":
        turn = [v for k, v in said["checks"].items() if k.startswith("u(rotation")]
        known = np.array([float(v) for v in turn]), np.array([u for u in std if u is not None])
        return Numbers((value[:9], value[9:]), known, squares)
    return Numbers(
        tuple(value.reshape(-1, 1)), tuple(np.array([u], dtype=float) for u in std), squares
    )


def estimated(case: str) -> Numbers:
    """Values of the estimator, with noise as stated and c = B x alone."""
    raw = in_memory(content(case))
    return _placed(raw) if case == "placing" else _springs(raw)


def _springs(raw: Raw) -> Numbers:
    case = ingested(raw, plausible=False)
    data = bring(case).data
    estimate = identify(case.cell, data, case.robot.nominal_compliance)[1]
    squares = estimate.chi2 if data.noise_stated else float(np.sum(estimate.residual**2))
    return Numbers(
        tuple(estimate.value.reshape(-1, 1)), tuple(estimate.std.reshape(-1, 1)), squares
    )


def _placed(raw: Raw) -> Numbers:
    case = ingested(raw, plausible=False)
    found = register(raw.settings, case.readings)
    x, y, z = found.t - found.centre
    arm = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    move = np.hstack([arm, np.eye(3)])  # of t due to (w, s): w x (t - centre) + s
    std = np.sqrt(np.diag(found.cov)[:3]), np.sqrt(np.diag(move @ found.cov @ move.T))
    assert found.chi2 is not None  # the case states its noise
    return Numbers((found.R.ravel(), found.t), std, found.chi2)


def away(case: str) -> float:
    """Largest difference of result.json's joint springs from the certified values [certified u].

    They answer a larger question: their weights include noise found in the data, its tails and its
    wander, and what c = B x neglects.
    """
    said = campaign_answer(case, in_memory(content(case))).answer.as_json()["joint_springs"]
    ours = np.array([one["compliance"] for one in said["stiffness"]], dtype=float)
    true = certified(case)
    value, std = np.concatenate(true.value), np.concatenate(true.std)
    return float(np.nanmax(np.abs(ours - value) / std))
