"""Summary of many cases on one screen: number of each outcome, then failures by cause."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from statistics import median
from typing import Any

from bench.fuzz.judge import BAD, GOOD

Row = dict[str, Any]

SLOW_MS = 10_000
"""CPU time from which a case is listed as slow [ms]."""


def cause(row: Row) -> str:
    """Key shared by rows of one failure: the place in the code, or the pattern of the sentence."""
    why = str(row.get("why", ""))
    if row["outcome"] == "silent":
        return f"silent {' + '.join(sorted(row['mutations']))}"
    if row["outcome"] == "exit 1":
        kind, _, rest = why.partition(":")
        return f"exit 1 {kind} at {rest.rpartition(' at ')[2]}"
    return f"{row['outcome']} {re.sub(r'[0-9.]+', '#', why)[:110]}"


def failures(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of failures, by cause, the most frequent first."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row["outcome"] not in GOOD:
            groups[cause(row)].append(row)
    return dict(sorted(groups.items(), key=lambda item: -len(item[1])))


def summary(rows: Sequence[Row]) -> list[str]:
    """Lines for the screen."""
    counts = Counter(row["outcome"] for row in rows)
    times = sorted(row.get("ms", 0) for row in rows) or [0]
    lines = [f"{word:12} {counts[word]:6}" for word in (*GOOD, *BAD) if counts[word]]
    late = times[min(len(times) - 1, int(0.95 * len(times)))]
    lines.append(
        f"{len(rows)} cases, {sum(times) / max(len(rows), 1):.0f} ms of a processor each, "
        f"median {median(times):.0f}, "
        f"95 % {late}, longest {times[-1]}"
    )
    warned = Counter(word.partition(":")[0] for row in rows for word in row.get("warned", ()))
    lines += [f"{count} cases with {name}" for name, count in warned.most_common(5)]
    slow = [str(row["case"]) for row in rows if row.get("ms", 0) > SLOW_MS]
    lines += [f"{len(slow)} slow, cases {', '.join(slow[:40])}"] if slow else []
    misled = [str(row["case"]) for row in rows if row["outcome"] == "misled"]
    lines += [f"misled in cases {', '.join(misled[:20])}"] if misled else []
    for name, group in failures(rows).items():
        first = min(group, key=lambda row: len(row.get("mutations", ())))
        lines.append(f"\n{len(group)} x {name}")
        lines.append(
            f"    case {first['case']} --to {first['to']}: {first.get('base', '')}, "
            f"{' + '.join(first.get('mutations', ()))}"
        )
        lines.append(f"    {first.get('why', '')}")
        lines.append(f"    cases {', '.join(str(row['case']) for row in group[:12])}")
    return lines
