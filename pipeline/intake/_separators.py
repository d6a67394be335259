"""How names may combine group and target, where no file says it."""

from __future__ import annotations

import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from scipy.sparse import coo_array, csgraph

from pipeline.base import patterns
from pipeline.base.arrays import Array
from pipeline.intake import _polar
from pipeline.intake._group_names import USUAL, ways_to_read
from pipeline.intake._names_by_place import common, literal
from pipeline.readers._reader import Export, part

_SEPARATOR = re.compile(r"[\W_]+")
LOOKED_AT = 100_000
"""Maximum number of readings used to analyse names: they repeat from pose to pose."""


def separators(exports: Sequence[Export]) -> list[str]:
    """Possible patterns for `names` of [tracker], for exports whose names combine group and target.

    The last or the first part of every name is one of a few that repeat together with the others.
    Of several such ways those whose groups tell most of their states are returned, and of these
    those in which targets keep their distances, if there are any. Names in which target and group
    have changed places (`B1_tour1` beside `P08_AV_R1`) are read the other way round.
    """
    names, places = _joined(exports)
    ways = itertools.chain.from_iterable(map(_ways, _in_all(names)))
    read = {way: pairs for way in ways if (pairs := _pairs(names, way))}
    few = {way: pairs for way, pairs in read.items() if _come_again({*pairs})}
    rows = {way: _read(pairs, places) for way, pairs in few.items()}
    state_names = {way: _rank_of_states(groups) for way, groups in rows.items()}
    best = [way for way in few if state_names[way] == max(state_names.values())]
    found = [way for way in best if _polar.some_keep([*rows[way].values()])] or best
    return [_with_turned(way, rows[way]) for way in found]


def in_some(exports: Sequence[Export]) -> list[str]:
    """Patterns for names of which some have a separator; the others are targets of no group."""
    names = {*_joined(exports)[0]}
    signs = dict.fromkeys(sign for name in names for sign in _SEPARATOR.findall(name))
    other = "(?P<group{0}>)(?P<target{0}>[^{1}]+)"
    return [
        f"{way}|{other.format(patterns.OTHERWISE, re.escape(sign))}"
        for sign in signs
        if len(sign) == 1
        for way in _ways(sign)
    ]


def _joined(exports: Sequence[Export]) -> tuple[list[str], list[Array]]:
    """Names that have no group, and where each was read."""
    names, places = list[str](), list[Array]()
    for one in exports:
        if one.group is None and one.target is not None:
            names += one.target[:LOOKED_AT].cast(pa.string()).to_pylist()
            places += [*one.position[:LOOKED_AT]]
    return names, places


def _rank_of_states(groups: Mapping[str, Mapping[str, Array]]) -> int:
    """2 if groups are called as the protocol has it, 1 if they tell states in other words."""
    ways = ways_to_read(groups)
    return (USUAL in ways) + bool(ways)


def _in_all(names: Sequence[str]) -> list[str]:
    """Characters between letters that all names contain, in the order of the first name."""
    signs = dict.fromkeys(_SEPARATOR.findall(names[0].strip()) if names else ())
    return [sign for sign in signs if all(sign in name for name in {*names})]


def _ways(sign: str) -> tuple[str, str]:
    """Patterns that cut a name at the last, and at the first, occurrence of a separator."""
    between = re.sub(r"[.^$*+?{}\[\]\\|()]", r"\\\g<0>", sign)
    return (
        f"(?P<group>.+){between}(?P<target>.+)",
        f"(?P<target>.+?){between}(?P<group>.+)",
    )


def _pairs(names: Sequence[str], pattern: str) -> list[tuple[str, str]] | None:
    """Group and target of each name; None if a name does not match."""
    found = patterns.parts(pa.array(names, pa.string()), pattern)
    if found.null_count:
        return None
    groups, targets = (part(found, name).to_pylist() for name in ("group", "target"))
    return list(zip(groups, targets, strict=True))


def _read(pairs: Sequence[tuple[str, str]], places: Sequence[Array]) -> dict[str, dict[str, Array]]:
    """Position of each target in each group."""
    groups = defaultdict[str, dict[str, Array]](dict)
    for (group, target), at in zip(pairs, places, strict=True):
        groups[group][target] = at
    return groups


def _with_turned(way: str, rows: Mapping[str, Mapping[str, Array]]) -> str:
    """A pattern with an alternative for names that it reads the wrong way round."""
    own = _pattern(_rounds(rows), rows)
    parts = re.fullmatch(r"\(\?P<(\w+)>\.\+\??\)(.+)\(\?P<(\w+)>\.\+\)", way)
    if not own or parts is None:
        return way
    first, between, second = parts.groups()
    turned = {first: ".+?", second: own} if second == "target" else {first: own, second: ".+"}
    a, b = (f"(?P<{'group' if one == 'target' else 'target'}{patterns.OTHERWISE}>{turned[one]})"
            for one in (first, second))  # fmt: skip
    return f"{a}{between}{b}|{way}"


def _pattern(words: set[str], rows: Mapping[str, Mapping[str, Array]]) -> str:
    """What matches these words and none of the other targets; empty if nothing does."""
    stem = re.split("[0-9]", common(words))[0] if words else ""
    if not stem:
        return "|".join(map(literal, sorted(words)))
    others = {target for at in rows.values() for target in at} - words
    return "" if any(other.startswith(stem) for other in others) else f"{literal(stem)}.*"


def _still(rows: Mapping[str, Mapping[str, Array]], near: float) -> dict[str, Array]:
    """Mean position of the groups whose readings are all in one place."""
    places = {name: np.array([*own.values()]) for name, own in rows.items()}
    return {name: at.mean(axis=0) for name, at in places.items() if np.ptp(at, axis=0).max() < near}


def _rounds(rows: Mapping[str, Mapping[str, Array]]) -> set[str]:
    """What is read as targets, but is in one place in most groups, these in different places.

    Two targets of one group cannot be in one place: they are rounds in which one was read.
    """
    every = np.array([at for own in rows.values() for at in own.values()])
    near = _ONE_PLACE * float(np.ptp(every, axis=0).max())
    still = _still(rows, near)
    often = Counter(itertools.chain(*rows.values()))
    alone = Counter(itertools.chain(*(rows[name] for name in still)))
    words = {target for target, count in alone.items() if 2 * count > often[target]}
    at = [place for name, place in still.items() if words >= rows[name].keys()]
    apart = all(np.linalg.norm(a - b) > near for a, b in itertools.combinations(at, 2))
    return words if apart and len(at) >= _BASE else set()


_ONE_PLACE = 1e-3
"""Largest distance between readings of one target, relative to the extent of all [1]: a few mm,
less than the size of a reflector."""
_BASE = 3
"""Minimum number of base reflectors."""


def _come_again(pairs: set[tuple[str, str]]) -> bool:
    """Whether there are fewer targets than groups, and most connected pairs of both occur."""
    groups, targets = (
        {name: k for k, name in enumerate({*some})} for some in zip(*pairs, strict=True)
    )
    if not 1 < len(targets) < len(groups):
        return False
    rows, columns = zip(*((groups[group], targets[target]) for group, target in pairs), strict=True)
    n = len(groups) + len(targets)
    shared = coo_array((np.ones(len(pairs)), (rows, np.add(columns, len(groups)))), shape=(n, n))
    body = csgraph.connected_components(shared, directed=False)[1]  # body of each group and target
    often, size = (np.bincount(some, minlength=n) for some in np.split(body, [len(groups)]))
    return bool(2 * len(pairs) > often @ size)
