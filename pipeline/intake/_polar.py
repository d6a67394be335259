"""Whether three numbers without titles may be two angles and a distance, and the evidence for it.

Ranges alone never prove that numbers are angles; they often prove that they are not. A point read
in both faces of the instrument proves it, and so does a tool that keeps its size while it moves.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.base.tails import chi2_beyond
from pipeline.dialects._circle import FACE, FULL, circles
from pipeline.dialects._coordinates import PACKED, ZEROS, cartesian, may_be_packed
from pipeline.dialects._kinds import NEAR
from pipeline.readers._reader import Meaning
from pipeline.readers._units import USUAL_UNITS, metres

_NEAREST_M, _FARTHEST_M = 0.05, 2000.0
"""Range of distances of an instrument with two angles [m]: from a T-Mac's cover to a total
station."""
_OVERHEAD = 30.0 / 360.0
"""Angle from the zenith within which not all readings can lie [full circles]: no instrument looks
up more steeply than some 75 degrees without a special eyepiece, and none stands below all its
targets."""
_RIGID = 1e-3
"""Maximum change of a distance over the movement of its ends for a rigid body [1]: a millimetre in
a metre, as bending may cause; a tool and its targets are a hundred times better."""
_SOFTER = 10.0
"""Factor by which the distances must change more in the other kind of coordinates [1]."""
_BY_CHANCE, _UNUSUAL = 1e-3, 0.05
"""Probability, for random directions, of movements this much along the beam, below which it is not
a beam [1]: for usual orders of the columns, and for those that hardly any program writes."""
_DIGITS = 20.0
"""Minimum movement across the beam, in units of the last digit, for its direction to be known
[1]."""
_MOVED = 0.01
"""Minimum movement over distance for a pair of targets to count [1]: noise and bending are
smaller."""
_FEW = 3
"""Minimum number of changes of distances for a conclusion."""
_MOST = 0.75
"""Minimum fraction of the distances that must be kept [1]: ends of a chain and damaged readings
keep none."""


@dataclass(frozen=True)
class Polar:
    """One way to read three columns as angles and a distance.

    Attributes:
        order: Places of distance, azimuth and vertical angle among the three.
        angle: Unit of the angles.
        vertical: `zenith` or `elevation`.
    """

    order: tuple[int, int, int]
    angle: str
    vertical: str

    def meaning(self, unit: str) -> Meaning:
        """Meaning of the numbers with a unit of length; the sense of azimuths is left open."""
        return Meaning(unit, "spherical", self.angle, self.vertical)


_USUAL = ((2, 0, 1), (0, 1, 2))
"""Column orders that programs write: Hz V D of surveyors, and R Theta Phi."""


def _possible(numbers: Array, unit: str | None) -> list[Polar]:
    """Every way in which three columns may be angles and a distance, usual orders first.

    Args:
        numbers: Shape (n, 3).
        unit: Unit of length, None if unknown.
    """
    orders = sorted(
        itertools.permutations(range(3)),
        key=lambda o: _USUAL.index(o) if o in _USUAL else len(_USUAL),
    )
    ways = itertools.product(orders, FULL, ZEROS)
    return [
        Polar((d, a, v), angle, vertical)
        for (d, a, v), angle, vertical in ways
        if (angle != "rad" or (d, a, v) in _USUAL)  # instruments show degrees, programs radians
        and (angle != PACKED or may_be_packed(numbers[:, [a, v]]))
        and _is_distance(numbers[:, d], unit)
        and _is_azimuth(numbers[:, a], angle)
        and _is_vertical(numbers[:, v], angle, vertical)
    ]


def _is_distance(values: Array, unit: str | None) -> bool:
    """Whether an instrument may have measured these lengths."""
    return any(
        bool(np.all((m >= _NEAREST_M) & (m <= _FARTHEST_M)))
        for m in (metres(values, one) for one in ((unit,) if unit else USUAL_UNITS))
    )


def _is_azimuth(values: Array, angle: str) -> bool:
    return bool(np.all(np.abs(circles(values, angle)) <= 1.0))


def _is_vertical(values: Array, angle: str, vertical: str) -> bool:
    """Whether these may be vertical angles, including readings in the second face."""
    turns = circles(values, angle)
    if vertical == "zenith":
        return bool(np.all((turns >= 0.0) & (turns <= 1.0)) and np.any(turns > _OVERHEAD))
    return bool(np.all((turns >= -1 / 4) & (turns <= 3 / 4)))


def beams(numbers: Array, names: Sequence[str], unit: str | None) -> list[Polar]:
    """The ways in which targets do not seem to move along the beam only."""
    return [way for way in _possible(numbers, unit) if not _only_along(numbers, names, way)]


def in_two_faces(numbers: Array, names: Sequence[str], groups: Sequence[str]) -> list[Polar]:
    """The ways by which most targets were read in both faces; none if no target was.

    Both readings are in one group, or in two successive rounds of names.
    """
    found: list[Polar] = []
    for keys in (list(zip(groups, names, strict=True)), list(names)):
        pairs = [] if not any(names) else list(_again(keys))
        if pairs and not found:
            one, other = (numbers[[pair[k] for pair in pairs]] for k in (0, 1))
            ways = {w: int(_faces(one, other, w).sum()) for w in _possible(numbers, None)}
            most = max([1, *ways.values()])
            found = [way for way, count in ways.items() if count == most]
    return found


def _again(keys: Sequence[object]) -> Iterator[tuple[int, int]]:
    """Pairs of rows with the same key: the previous such row, and the row."""
    last: dict[object, int] = {}
    for k, key in enumerate(keys):
        if key in last:
            yield last[key], k
        last[key] = k


def _faces(one: Array, other: Array, way: Polar) -> Bools:
    """Which pairs are a reading in each face, shape (pairs,)."""
    d, *angles = way.order
    (a, v), (other_a, other_v) = (circles(side[:, angles].T, way.angle) for side in (one, other))
    turned = np.abs((other_a - a) % 1.0 - 1 / 2) < FACE
    both = 1.0 if way.vertical == "zenith" else 1 / 2
    plunged = np.abs((v + other_v - both + 1 / 2) % 1.0 - 1 / 2) < FACE
    same = np.abs(one[:, d] - other[:, d]) <= FACE * np.abs(one[:, d])
    return np.asarray(turned & plunged & same)


def _as_polar(numbers: Array, way: Polar, unit: str) -> Array:
    """Cartesian coordinates [m] of the columns read in this way, shape (n, 3)."""
    return cartesian([numbers[:, k] for k in way.order], way.meaning(unit))


def softness(position: Array, names: Sequence[str], groups: Sequence[str]) -> float | None:
    """Change of the distance between targets over their movement, the `_MOST` quantile.

    About 0 for targets on one rigid body. None if too few targets move from group to group.

    Args:
        position: Cartesian coordinates [any unit], shape (n, 3).
        names: Target of each.
        groups: What was read together, in the order of reading.
    """
    before: dict[tuple[str, str], tuple[Array, Array]] = {}
    found = []
    for k in range(len(names) - 1):
        pair = names[k], names[k + 1]
        if groups[k] != groups[k + 1] or pair[0] == pair[1]:
            continue
        here = position[k], position[k + 1]
        if pair in before:
            there = before[pair]
            moved = (_length(here[0] - there[0]) + _length(here[1] - there[1])) / 2
            apart, was = _length(here[0] - here[1]), _length(there[0] - there[1])
            if moved > _MOVED * apart:
                found.append(abs(apart - was) / moved)
        before[pair] = here
    return float(np.quantile(found, _MOST)) if len(found) >= _FEW else None


def some_keep(groups: Sequence[Mapping[str, Array]]) -> bool:
    """Whether any two targets keep their distance, relative to it and to their movement.

    A place before and after a load is no such pair: their movement is all that changes.

    Args:
        groups: Position of each target in each group [any unit].
    """
    names = dict.fromkeys(name for at in groups for name in at)
    for one, other in itertools.combinations(names, 2):
        read = np.array([(at[one], at[other]) for at in groups if one in at and other in at])
        if len(read) <= _FEW:
            continue
        apart = np.linalg.norm(read[:, 0] - read[:, 1], axis=1)
        moved = np.linalg.norm(np.diff(read, axis=0), axis=2).mean(axis=1)
        counts = moved > _MOVED * apart[1:]
        least = np.minimum(moved, apart[1:])[counts]
        if len(least) >= _FEW and least.all():
            changes = np.abs(np.diff(apart))[counts] / least
            if keeps(float(np.quantile(changes, _MOST))):
                return True
    return False


def _length(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))


def rigid_ways(
    numbers: Array, names: Sequence[str], groups: Sequence[str], ways: Sequence[Polar], unit: str
) -> list[Polar]:
    """The ways to read angles and a distance in which targets keep their distances.

    Empty if they keep them as x, y, z, too.
    """
    own = softness(numbers, names, groups)
    if own is None or keeps(own):
        return []
    found = {way: softness(_as_polar(numbers, way, unit), names, groups) for way in ways}
    keeping = [way for way, soft in found.items() if soft is not None and soft <= _RIGID]
    return keeping if keeping and _rigid(found[keeping[0]], [own]) else []


def rigid_space(
    numbers: Array, names: Sequence[str], groups: Sequence[str], ways: Sequence[Polar], unit: str
) -> bool:
    """Whether targets keep their distances as x, y, z, and in none of the other ways."""
    own = softness(numbers, names, groups)
    if not keeps(own):
        return False
    return _rigid(own, [softness(_as_polar(numbers, way, unit), names, groups) for way in ways])


def in_part(numbers: Array, names: Sequence[str], groups: Sequence[str], unit: str) -> int | None:
    """The row where angles and a distance end and x, y, z begin, or the other way round.

    The first, or last, rows are angles if only then targets keep their distances to the other rows.
    None if all rows are of one kind, or it cannot be decided.
    """
    own = softness(numbers, names, groups)
    edges = [k for k in range(1, len(groups)) if groups[k] != groups[k - 1]]
    if own is None or keeps(own):
        return None
    row, lengths = np.arange(len(numbers)), metres(numbers, unit)
    found: dict[int, float] = {}
    for parts in ([(k, row < k) for k in edges], [(k, row >= k) for k in reversed(edges)]):
        for k, angles, way in _while_possible(numbers, parts, unit):
            place = np.where(angles[:, None], _as_polar(numbers, way, unit), lengths)
            soft = softness(place, names, groups)
            if soft is not None and _rigid(soft, [own]):
                found[k] = min(soft, found.get(k, soft))
    return min(found, key=found.__getitem__, default=None)


def _while_possible(
    numbers: Array, parts: Sequence[tuple[int, Bools]], unit: str
) -> Iterator[tuple[int, Bools, Polar]]:
    """Every way to read rows of growing parts as angles; ends at the first part without one."""
    for k, angles in parts:
        ways = _possible(numbers[angles], unit)
        if not ways:
            return
        yield from ((k, angles, way) for way in ways)


def keeps(soft: float | None) -> bool:
    """Whether a softness is that of a rigid body."""
    return soft is not None and soft <= _RIGID


def _rigid(soft: float | None, others: Sequence[float | None]) -> bool:
    """Whether targets keep their distances in one kind of coordinates, and in no other."""
    if soft is None or not keeps(soft) or None in others:
        return False
    return all(other > _SOFTER * max(soft, _RIGID / 2) for other in others if other is not None)


def _only_along(numbers: Array, names: Sequence[str], way: Polar) -> bool:
    """Whether targets would move along the beam only, which real ones do not: then it is none.

    If lengths in metres are taken for degrees, movements seem fifty times smaller than along the
    third axis. For random directions, P(|cos| > c) = 1 - c (Archimedes), pairs combined by Fisher's
    method.
    """
    found = list(_along(numbers, names, way))
    chance = _BY_CHANCE if way.order in _USUAL else _UNUSUAL
    if not found or np.median(found) > chance ** (1 / 2):
        return False
    statistic = -2.0 * float(np.sum(np.log(np.maximum(found, _BY_CHANCE / _DIGITS))))
    return bool(chi2_beyond(statistic, 2 * len(found)) < chance)


def _along(numbers: Array, names: Sequence[str], way: Polar) -> Iterator[float]:
    """1 - |cos| between beam and movement, for each small movement with enough digits."""
    _, a, v = way.order
    position = _as_polar(numbers, way, "m")
    last = max(_last_digit(numbers[:, a]), _last_digit(numbers[:, v]))
    digit = 2 * np.pi * float(circles(np.array([last]), way.angle)[0])
    for j, k in _again(names) if any(names) else ():
        moved, far = position[k] - position[j], _length(position[k])
        if _DIGITS * digit * far < _length(moved) < NEAR * far:
            yield 1.0 - abs(float(moved @ position[k])) / (_length(moved) * far)


def _last_digit(values: Array) -> float:
    """The last decimal place that is written, at least 1e-12."""
    for place in (10.0**-k for k in range(12)):
        scaled = values / place
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-3):
            return place
    return 1e-12
