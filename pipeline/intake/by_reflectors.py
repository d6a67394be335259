"""Settle ambiguities of an export where only one answer fits the positions of reflectors.

Reflectors of one body keep their mutual positions, whatever moves it. Moved rigidly onto their
positions in campaign.toml, they miss by metres in a wrong unit, by wrong angles or in wrong
columns; in a mirrored frame only if there are four that are not in one plane.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import InputError
from pipeline.base.linear import rigid
from pipeline.base.quantities import plain
from pipeline.dialects.mapped import until
from pipeline.intake.offer import proposal
from pipeline.intake.question import TableProposal
from pipeline.readers import Export, ExportSettings, opened_as_text, read
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M, ReflectorSet

_LOOKED_AT = 1000
"""Number of lines used: some hundred rounds of base reflectors, or thirty poses with their
pulls."""
_PAIR = 2
"""Minimum number of reflectors of a body that have a distance."""


@dataclass(frozen=True)
class _Way:
    """One answer to every question.

    Attributes:
        chosen: Number of the answer to each question.
        said: Text of each answer.
        hints: Statements of [tracker] after each.
        off: Resulting residual of the reflectors [m]; infinite if the export cannot be read this
            way, NaN if it contains no known reflectors.
    """

    chosen: tuple[int, ...]
    said: tuple[str, ...]
    hints: tuple[ExportSettings, ...]
    off: float = np.nan


def settled(
    name: str, data: bytes, hints: ExportSettings, bodies: Sequence[ReflectorSet]
) -> tuple[ExportSettings, tuple[str, ...]]:
    """Statements of [tracker] with all that known reflectors settle, and the reasons, in sentences.

    Questions are settled in the order in which they are asked, up to the first that stays open.

    Args:
        name: File name, for messages.
        data: Content of the file.
        hints: Statements so far.
        bodies: The known reflectors.
    """
    ways = _judged(name, data, hints, bodies) if bodies else []
    if not ways:
        return hints, ()
    by, out = " and ".join(body.table for body in bodies), list[str]()
    while (depth := len(out)) < len(ways[0].chosen):
        best, off, beyond = _nearest(ways, depth)
        if off >= GROSS_DISTANCE_M or beyond < max(GROSS_DISTANCE_M, CLEARLY_NEARER * off):
            break
        ways = [way for way in ways if way.chosen[depth] == best]
        other = f", and {_length(beyond)} with any other answer" if beyond < np.inf else ""
        out.append(f"{ways[0].said[depth]}: so reflectors are {_length(off)} off {by}{other}")
    return ways[0].hints[len(out)], tuple(out)


def _judged(
    name: str, data: bytes, hints: ExportSettings, bodies: Sequence[ReflectorSet]
) -> list[_Way]:
    """Every combination of answers with the resulting residual of the reflectors.

    Empty where nothing is asked, and where one of the combinations leaves no known reflectors.
    """
    try:
        sample = until(opened_as_text(name, data, hints), _LOOKED_AT).data
        if not _asked(name, sample, hints):
            return []
    except InputError:  # the reader reports it better
        return []
    ways = []
    for way in _ways(_Way((), (), (hints,)), name, sample, bodies):
        if np.isnan(way.off):
            return []
        ways.append(way)
    return ways


def _nearest(ways: Sequence[_Way], depth: int) -> tuple[int, float, float]:
    """The best answer to a question, its residual, and the smallest with any other answer [m]."""
    nearest: dict[int, float] = {}
    for way in ways:
        nearest[way.chosen[depth]] = min(way.off, nearest.get(way.chosen[depth], np.inf))
    best, *others = sorted(nearest, key=nearest.__getitem__)
    return best, nearest[best], min((nearest[k] for k in others), default=np.inf)


def _asked(name: str, data: bytes, hints: ExportSettings) -> bool:
    """Whether only a question prevents an export from being read."""
    try:
        read(name, data, hints)
    except InputError as wrong:
        found = proposal(name, data, hints)
        return bool(found and found.questions and found.questions[0].problem().thing == wrong.thing)
    return False


def _ways(way: _Way, name: str, data: bytes, bodies: Sequence[ReflectorSet]) -> Iterator[_Way]:
    """Every answer to every question that is open after some are answered."""
    try:
        found = proposal(name, data, way.hints[-1])
        questions = found.questions if found else ()
        way = replace(way, hints=(*way.hints[:-1], _with_settled(way.hints[-1], found)))
        if not questions:
            yield replace(way, off=_off(read(name, data, way.hints[-1]), bodies))
            return
    except InputError:
        yield replace(way, off=np.inf)
        return
    for k, answer in enumerate(questions[0].answers):
        after = way.hints[-1].model_copy(update=dict(answer.hints))
        text = f"{questions[0].about} {answer.said}"
        chosen = _Way((*way.chosen, k), (*way.said, text), (*way.hints, after))
        yield from _ways(chosen, name, data, bodies)


def _with_settled(hints: ExportSettings, found: TableProposal | None) -> ExportSettings:
    """Statements including what a table settles itself, which its mapping does not contain."""
    opened: set[str] = {question.about for question in found.questions} if found else set()
    if found is None or hints.mapping is None or not opened <= {*ExportSettings.model_fields}:
        return hints
    return found.hints.model_copy(update=dict.fromkeys(opened))


def _off(export: Export, bodies: Sequence[ReflectorSet]) -> float:
    """Residual of reflectors read together, moved rigidly: median, of the worst body [m]."""
    if export.target is None or not len(export.line):
        return np.nan
    target = np.array(export.target.to_pylist())
    if export.group is None:
        group = rounds(export.target.indices.to_numpy())
    else:
        group = export.group.indices.to_numpy()
    off = []
    for body in bodies:
        mine = np.isin(target, [*body.places])
        rows = (np.flatnonzero(mine & (group == one)) for one in np.unique(group[mine]))
        together = [k for k in rows if len({*target[k]}) >= _PAIR]
        if together:
            nominal = np.array([body.places.get(one, (np.nan,) * 3) for one in target])
            off.append(float(np.median([_away(nominal[k], export.position[k]) for k in together])))
    return max(off, default=np.nan)


def _away(nominal: Array, position: Array) -> float:
    """Largest residual distance between points after the best rigid motion [m]."""
    R, t = rigid(nominal, position)
    return float(np.linalg.norm(position - nominal @ R.T - t, axis=1).max())


def _length(metres: float) -> str:
    return f"{plain(metres, 3)} m" if metres >= 1.0 else f"{plain(1e3 * metres, 2)} mm"


def rounds(target: Ints) -> Ints:
    """Number of the round of each reading, from 1: a round ends where a name repeats."""
    out = np.ones(len(target), dtype=np.int64)
    seen: set[int] = set()
    for k, name in enumerate(target.tolist()):
        out[k] = out[k - 1] if k else 1
        if name in seen:
            seen.clear()
            out[k] += 1
        seen.add(name)
    return out
