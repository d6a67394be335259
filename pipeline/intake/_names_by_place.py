"""Parsing of group names by where the groups were read: the pose is what tells places apart.

Loads move an effector by millimetres, poses by metres: groups of one pose are in one place. What is
left of their names is the state and the number of the pull, in whatever order and words.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from pipeline.base.arrays import Array

Rows = Mapping[str, Mapping[str, Array]]
"""Position of each target in each group."""

NEAR = 0.01
"""Largest distance within a pose, relative to the extent of all readings [1]."""
_LOOKED_AT = 500
"""Number of groups: their names repeat from pose to pose."""
_NUMBER = re.compile("[0-9]+")
_FEWEST = 2
"""Minimum number of places, and of groups in most of them."""
_PULL = re.compile(r"(.*?)([0-9]+)([^0-9]*)")
"""What a loaded state is called, its number, and what stands behind it."""


def places(rows: Rows) -> dict[str, int]:
    """Number of the place of each group of the body that was in most places, the effector.

    Groups that read the same targets are of one body; the extent of its readings is the scale.
    """
    bodies: list[tuple[set[str], list[str]]] = []
    for name, at in itertools.islice(rows.items(), _LOOKED_AT):
        mine = [one for one in bodies if one[0] & at.keys()]
        joined = ({*at}.union(*(one[0] for one in mine)), [n for one in mine for n in one[1]])
        bodies = [one for one in bodies if one not in mine] + [(joined[0], [*joined[1], name])]
    found = (_places({name: rows[name] for name in names}) for _, names in bodies)
    return max(found, key=lambda one: len({*one.values()}), default={})


def _places(rows: Rows) -> dict[str, int]:
    every = np.array([at for own in rows.values() for at in own.values()])
    near = NEAR * float(np.ptp(every, axis=0).max())
    first: list[Mapping[str, Array]] = []
    found = {}
    for name, own in rows.items():
        for k, other in enumerate(first):
            both = own.keys() & other.keys()
            if any(  # the names of two may have been exchanged
                np.linalg.norm(np.subtract(own[one], other[one])) < near for one in both
            ):
                found[name] = k
                break
        else:
            found[name] = len(first)
            first.append(own)
    return found


def parts(rows: Rows) -> Iterator[dict[str, tuple[str, str, str]]]:
    """What stands before the number of the pose, the number, and what is behind, by group name.

    One number of each name, counted from its front or its end, is the pose if groups of one number
    are in one place, and most have several groups; those with the fewest numbers come first.
    """
    place = places(rows)
    numbers = {name: [*_NUMBER.finditer(name)] for name in place}
    least = min((len(one) for one in numbers.values()), default=0)
    ways = []
    for k in (*range(least), *range(-least, 0)):
        at = {name: int(one[k][0]) for name, one in numbers.items()}
        pairs = {(at[name], place[name]) for name in place}
        often = Counter(at.values())
        if len(pairs) == len(often) >= _FEWEST and len(at) >= 2 * len(often):
            ways.append((len(often), {n: (n[: m[k].start()], m[k][0], n[m[k].end() :])
                                      for n, m in numbers.items()}))  # fmt: skip
    yield from (way for _, way in sorted(ways, key=lambda both: both[0]))


def labels(found: Mapping[str, tuple[str, str, str]]) -> tuple[str, str, dict[str, str]] | None:
    """Expression before the state, the one behind it, and the state of each name, with its number.

    None if there are states on both sides of the pose.
    """
    before, behind = ({one[k] for one in found.values()} for k in (0, 2))
    pose = "(?P<pose>[0-9]+)"
    if len(before) == 1:
        fixed = re.match(r"[\W_]*", common(behind))[0]  # type: ignore[index]
        own = {name: one[2][len(fixed) :] for name, one in found.items()}
        return f"{literal(*before)}{pose}{literal(fixed)}", "", own
    if len(behind) == 1:
        shared = common([one[::-1] for one in before])[::-1]
        fixed = re.sub(r"^[^\W_]+(?=[\W_])", "", shared) if re.search(r"[\W_]", shared) else ""
        own = {name: one[0][: len(one[0]) - len(fixed)] for name, one in found.items()}
        return "", f"{literal(fixed)}{pose}{literal(*behind)}", own
    return None


def common(texts: Collection[str]) -> str:
    """What all texts begin with: what the first and the last in order do."""
    both = zip(min(texts), max(texts), strict=False)
    return "".join(a for a, _ in itertools.takewhile(lambda two: two[0] == two[1], both))


def unloaded(own: Mapping[str, str], rows: Rows) -> list[set[str]]:
    """The labels of unloaded states, in each way that is possible.

    Those with fewer targets than others, as the ends of a chain are read under load only; else
    those whose number is 0; else any.
    """
    most = defaultdict[str, int](int)
    for name, label in own.items():
        most[label] = max(most[label], len(rows[name]))
    if len({*most.values()}) > 1:
        return [{label for label, count in most.items() if count == min(most.values())}]
    numbers = {label: "".join(_NUMBER.findall(label)) for label in most}
    zero = {label for label, number in numbers.items() if {*number} == {"0"}}
    if zero or len(most) == 1:
        return [zero] if zero < most.keys() else []
    return [{label} for label in sorted(most, key=lambda label: numbers[label] != "")]


def pulls(loaded: Sequence[str]) -> tuple[list[str], str]:
    """The words of loaded states, and the expression for what follows: the number of the pull."""
    cut = [_PULL.fullmatch(label) for label in loaded]
    if all(cut) and len({one[3] for one in cut if one}) == 1:
        words = dict.fromkeys(one[1] for one in cut if one)
        behind = cut[0][3]  # type: ignore[index]
        return [*words], "(?P<repeat>[0-9]*)" + (f"(?:{literal(behind)})?" if behind else "")
    return [*dict.fromkeys(loaded)], "(?P<repeat>[0-9]*)"


def literal(text: str) -> str:
    """Expression for a text itself."""
    return re.escape(text).replace("\\ ", " ").replace("\\-", "-")
