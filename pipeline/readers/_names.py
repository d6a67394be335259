"""Names that hold group and target in one: `Group::Target`, or as [tracker] names says."""

from __future__ import annotations

import itertools
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from scipy.sparse import coo_array, csgraph

from pipeline.base import patterns
from pipeline.base.arrays import Array, Ints
from pipeline.readers import _polar
from pipeline.readers._reader import Export, kept

_JOINED = r"(?:.+?::)?(?P<group>[^:]+(?::[^:]+)*)::(?P<target>[^:]+(?::[^:]+)*)"
"""SpatialAnalyzer's way; a collection in front is not used."""
_SEPARATOR = re.compile(r"[\W_]+")
LOOKED_AT = 100_000
"""Readings from which names are understood: they repeat from pose to pose."""


def split(export: Export, pattern: str | None) -> Export:
    """The export with the group taken out of its target names, where it has no other groups.

    Args:
        export: Readings with targets but without groups; others stay as they are.
        pattern: Expression with the parts group and target, None for `Group::Target`.
    """
    if export.group is not None or export.target is None:
        return export
    found = patterns.parts(export.target.dictionary, pattern or _JOINED)
    matched = np.asarray(found.is_valid())
    if not matched.any() or (pattern is None and not matched.all()):
        return export
    at = export.target.indices
    group, target = (_part(found, name).take(at) for name in ("group", "target"))
    split_up = replace(export, group=group.dictionary_encode(), target=target.dictionary_encode())
    fits = matched[np.asarray(at)]
    return kept(
        split_up,
        fits,
        "the name has no group and target by names in [tracker]; correct the name or names",
    )


def separators(exports: Sequence[Export]) -> list[str]:
    """What [tracker] names may say of exports whose names hold group and target with any sign.

    The last or the first part of every name is one of a few that come again with the others. Of
    several such ways those in which targets keep their distances, where there are some.
    """
    names, places = list[str](), list[Array]()
    for one in exports:
        if one.group is None and one.target is not None:
            names += one.target[:LOOKED_AT].cast(pa.string()).to_pylist()
            places += [*one.position[:LOOKED_AT]]
    ways = itertools.chain.from_iterable(map(_ways, _in_all(names)))
    read = {way: pairs for way in ways if (pairs := _pairs(names, way))}
    few = {way: pairs for way, pairs in read.items() if _come_again({*pairs})}
    return [way for way, pairs in few.items() if _polar.some_keep(_read(pairs, places))] or [*few]


def _in_all(names: Sequence[str]) -> list[str]:
    """Signs between letters that all names have, in the order of the first."""
    signs = dict.fromkeys(_SEPARATOR.findall(names[0].strip()) if names else ())
    return [sign for sign in signs if all(sign in name for name in {*names})]


def _ways(sign: str) -> tuple[str, str]:
    """A name cut where a sign stands last, and where it stands first."""
    between = re.sub(r"[.^$*+?{}\[\]\\|()]", r"\\\g<0>", sign)
    return (
        f"(?P<group>.+){between}(?P<target>.+)",
        f"(?P<target>.+?){between}(?P<group>.+)",
    )


def _pairs(names: Sequence[str], pattern: str) -> list[tuple[str, str]] | None:
    """Group and target of each name; None where a name has none."""
    found = patterns.parts(pa.array(names, pa.string()), pattern)
    if found.null_count:
        return None
    groups, targets = (_part(found, name).to_pylist() for name in ("group", "target"))
    return list(zip(groups, targets, strict=True))


def _read(pairs: Sequence[tuple[str, str]], places: Sequence[Array]) -> list[dict[str, Array]]:
    """Where each target of a group was read."""
    groups = defaultdict[str, dict[str, Array]](dict)
    for (group, target), at in zip(pairs, places, strict=True):
        groups[group][target] = at
    return [*groups.values()]


def _come_again(pairs: set[tuple[str, str]]) -> bool:
    """Whether targets are fewer than groups, and most that belong together come in each of them."""
    groups, targets = (
        {name: k for k, name in enumerate({*some})} for some in zip(*pairs, strict=True)
    )
    if not 1 < len(targets) < len(groups):
        return False
    rows, columns = zip(*((groups[group], targets[target]) for group, target in pairs), strict=True)
    n = len(groups) + len(targets)
    shared = coo_array((np.ones(len(pairs)), (rows, np.add(columns, len(groups)))), shape=(n, n))
    body = csgraph.connected_components(shared, directed=False)[1]  # of what is read together
    often, size = (np.bincount(some, minlength=n) for some in np.split(body, [len(groups)]))
    return bool(2 * len(pairs) > often @ size)


def rounds(target: Ints) -> Ints:
    """Number of the round of each reading, from 1: a round ends where a name comes again."""
    out = np.ones(len(target), dtype=np.int64)
    seen: set[int] = set()
    for k, name in enumerate(target.tolist()):
        out[k] = out[k - 1] if k else 1
        if name in seen:
            seen.clear()
            out[k] += 1
        seen.add(name)
    return out


def _part(found: pa.StructArray, name: str) -> pa.StringArray:
    return pc.fill_null(pc.struct_field(found, name), "")
