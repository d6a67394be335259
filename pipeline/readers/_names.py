"""Split names that hold group and target: `Group::Target`, or as [tracker] names says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base import patterns
from pipeline.readers._reader import Export, kept

_JOINED = r"(?:.+?::)?(?P<group>[^:]+(?::[^:]+)*)::(?P<target>[^:]+(?::[^:]+)*)"
"""Names as SpatialAnalyzer writes them; a collection in front is ignored."""


def split(export: Export, pattern: str | None) -> Export:
    """Split the group off the target names of an export that has no other groups.

    Args:
        export: Readings with targets but without groups; others are returned unchanged.
        pattern: Regular expression with the parts group and target, None for `Group::Target`.
    """
    if export.group is not None or export.target is None:
        return export
    found = patterns.parts(export.target.dictionary, pattern or _JOINED)
    matched = np.asarray(found.is_valid())
    if not matched.any() or (pattern is None and not matched.all()):
        return export
    at = export.target.indices
    group, target = (part(found, name).take(at) for name in ("group", "target"))
    split_up = replace(export, group=group.dictionary_encode(), target=target.dictionary_encode())
    fits = matched[np.asarray(at)]
    return kept(
        split_up,
        fits,
        "the name has no group and target by names in [tracker]; correct the name or names",
    )


def part(found: pa.StructArray, name: str) -> pa.StringArray:
    """One part of the names matched by an expression, empty where it does not match."""
    return pc.fill_null(pc.struct_field(found, name), "")
