"""Timing of two alternatives in turn, so that a drifting machine favours neither."""

import statistics
import time
from collections.abc import Callable


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call [s]."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def ratio(ours: Callable[[], object], theirs: Callable[[], object], runs: int = 7) -> float:
    """Median of theirs / ours over `runs` pairs, after one call of each to warm up."""
    ours(), theirs()
    return statistics.median(seconds(theirs) / seconds(ours) for _ in range(runs))
