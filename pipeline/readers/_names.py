"""Names that hold group and target in one: `Group::Target`, or as [tracker] names says."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa

from pipeline.readers._reader import Export, kept

_JOINED = r"(?:.+?::)?(?P<group>[^:]+(?::[^:]+)*)::(?P<target>[^:]+(?::[^:]+)*)"
"""SpatialAnalyzer's way; a collection in front is not used."""


def split(export: Export, pattern: str | None) -> Export:
    """The export with the group taken out of its target names, where it has no other groups.

    Args:
        export: Readings with targets but without groups; others stay as they are.
        pattern: Expression with the parts group and target, None for `Group::Target`.
    """
    if export.group is not None or export.target is None:
        return export
    compiled = re.compile(pattern or _JOINED)
    matches = [compiled.fullmatch(name) for name in export.target.dictionary.to_pylist()]
    if not any(matches) or (pattern is None and not all(matches)):
        return export
    at = export.target.indices
    group, target = (_part(matches, name).take(at) for name in ("group", "target"))
    split_up = replace(export, group=group.dictionary_encode(), target=target.dictionary_encode())
    fits = np.array(list(map(bool, matches)), dtype=bool)[np.asarray(at)]
    return kept(
        split_up,
        fits,
        "the name has no group and target by names in [tracker]; correct the name or names",
    )


def _part(matches: Sequence[re.Match[str] | None], name: str) -> pa.StringArray:
    return pa.array([match[name] if match else "" for match in matches], pa.string())
