"""Parsing of group names: which part is the pose, the state, the repeat.

It is derived from the names alone, and from the targets read in the groups.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import pyarrow as pa

from pipeline.base import patterns
from pipeline.base.arrays import Array
from pipeline.intake import _names_by_place
from pipeline.intake._log_words import is_unloaded
from pipeline.intake._names_by_place import literal
from pipeline.reduction.settings import Naming

STATES = ("unloaded", "loaded")
_TOKENS = (
    re.compile(r"[0-9]+|[^\W\d_]+|[\W_]+"),
    re.compile(r"[0-9]+|[^\W\d_]+(?: [^\W\d_]+)*|[\W_]+"),
    re.compile(r"[0-9]+|[^\W\d_]+(?:[ _-][^\W\d_]+)*|[\W_]+"),
    re.compile(r"[0-9]+|[^\W\d_]+(?: ?\([^\W\d_]+\))?|[\W_]+"),
)
"""A number, a word, or the characters between them; or several words in place of one, with blanks,
hyphens or underscores between them, or with one in parentheses."""
_MOST_LETTERS = 4
"""Maximum number of letters behind the number of a pose that was measured again [1]."""
_ANY_LETTERS = rf"\pL{{0,{_MOST_LETTERS}}}"
_WORDS = re.compile(r"[^\W\d_]+")


@dataclass(frozen=True)
class Group:
    """How group names are read.

    Attributes:
        pattern: Regular expression with the parts pose, state and, where there is one, repeat.
        states: The words of the states in the names: first those of unloaded states, such as before
            and after the pulls, then those of loaded ones, for example for both branches.
        rest: Number of words of unloaded states.
    """

    pattern: str
    states: tuple[str, ...] = STATES
    rest: int = 1

    @property
    def state_of(self) -> dict[str, str]:
        """`unloaded` or `loaded` by word."""
        return {word: STATES[k >= self.rest] for k, word in enumerate(self.states)}


USUAL = Group(Naming().group)
"""As the protocol names groups."""


def states_of(names: Sequence[str], group: Group) -> dict[str, str]:
    """State of each group that names one."""
    found = patterns.parts(pa.array(names, pa.string()), group.pattern).to_pylist()
    word = {own.lower(): state for own, state in group.state_of.items()}
    return {
        name: word[parts["state"].lower()]
        for name, parts in zip(names, found, strict=True)
        if parts is not None and parts["state"].lower() in word
    }


def ways_to_read(rows: Mapping[str, Mapping[str, Array]]) -> tuple[Group, ...]:
    """Possible ways to read group names: the default one, or a number and one of a few words.

    Names of one form are a number for the pose, a word for the state and perhaps a number for the
    repeat. Words whose groups have more targets are loaded: the chain's ends are read only then. If
    several have the fewest, they are states of one kind only if they share a word that no other has
    (`leer_vor`, `leer_nach`). Otherwise any word may be that of the unloaded state: one way each,
    unless one is called so in some language.
    """
    if states_of(list(rows), USUAL):
        return (USUAL,)
    found = _found(rows)
    said = [one for one in found if [*map(is_unloaded, one.states)] == _first_of(one)]
    return (said[0],) if len(found) > 1 and said else found


def _first_of(group: Group) -> list[bool]:
    """For each word of a state whether it is unloaded."""
    return [k < group.rest for k in range(len(group.states))]


def _found(rows: Mapping[str, Mapping[str, Array]]) -> tuple[Group, ...]:
    """The ways for names that are not those of the protocol."""
    ways = [some for token in _TOKENS if (some := _ways(rows, token))]
    found = max(ways, key=lambda some: len(states_of(list(rows), some[0])), default=())
    return found or _by_place(rows)


def _ways(rows: Mapping[str, Mapping[str, Array]], token: re.Pattern[str]) -> tuple[Group, ...]:
    """The ways for names that consist of such parts."""
    tokens, lettered = _parts(rows, token)
    longest = max(tokens.values(), key=len, default=[])
    alike = {name: own for name, own in tokens.items() if _fits(own, longest)}
    numbers = [k for k, token in enumerate(longest) if token.isdigit()]
    for k in range(len(longest)):
        entries = {name: own[k] for name, own in alike.items() if len(own) > k}
        if _states(entries, alike, numbers[0]):
            orders = _orders(entries, rows)
            least = min(map(len, map(alike.__getitem__, entries)))
            found = [
                Group(_pattern(longest, numbers, k, words, least, lettered), words, rest)
                for words, rest in orders
            ]
            whole = [one for one in found if states_of([*entries], one).keys() >= entries.keys()]
            return tuple(one for one in whole if _apart_from_each_other(list(rows), one))
    return ()


def _parts(names: Iterable[str], token: re.Pattern[str]) -> tuple[dict[str, list[str]], bool]:
    """The parts of each name with a number, and whether letters behind that are left out in a few.

    They are part of all names if of half of them.
    """
    parts = {name: token.findall(name) for name in names if re.search("[0-9]", name)}
    without = {name: own for name in parts if (own := _without_letters(parts[name]))}
    few = 0 < 2 * len(without) < len(parts)
    return (parts | without if few else parts), few


def _without_letters(own: Sequence[str]) -> list[str]:
    """The parts of a name without letters right behind its first number; empty if it has none."""
    k = next(k for k, part in enumerate(own) if part.isdigit()) + 1
    short = len(own) > k + 1 and own[k].isalpha() and len(own[k]) <= _MOST_LETTERS
    return [*own[:k], *own[k + 1 :]] if short else []


def _apart_from_each_other(names: Sequence[str], group: Group) -> bool:
    """Whether no two groups are the same pull: numbers may start again for the other branch."""
    found = patterns.parts(pa.array(names, pa.string()), group.pattern).drop_null().to_pylist()
    keys = [(parts["pose"], group.state_of.get(parts["state"]), parts["repeat"]) for parts in found]
    numbered = [key for key in keys if key[2]]
    return len(set(numbered)) == len(numbered)


def _states(stated: Mapping[str, str], alike: Mapping[str, Sequence[str]], place: int) -> bool:
    """Whether a part of the names takes a few words, and most numbers at `place` have two."""
    words = set(stated.values())
    pose = {name: alike[name][place] for name in stated if len(alike[name]) > place}
    both = {(number, stated[name]) for name, number in pose.items()}
    return (
        len(words) > 1 and all(map(_worded, words)) and len(both) >= 1.5 * len(set(pose.values()))
    )


def _worded(part: str) -> bool:
    """Whether a part of a name consists of words."""
    return re.sub("[ _()-]", "", part).isalpha()


def _fits(own: Sequence[str], longest: Sequence[str]) -> bool:
    """Whether numbers and words are in the same positions as in the longest name."""
    return all(
        a.isdigit() == b.isdigit() and _worded(a) == _worded(b)
        for a, b in zip(own, longest, strict=False)
    )


def _orders(
    stated: Mapping[str, str], rows: Mapping[str, Mapping[str, Array]]
) -> list[tuple[tuple[str, ...], int]]:
    """Words of unloaded states, then those of loaded ones, and how many the former are.

    If there is a tie, any word comes first.

    Only words whose groups have a target in common can be states of one effector.
    """
    read: dict[str, list[set[str]]] = {word: [] for word in stated.values()}
    for name, word in stated.items():
        read[word].append({*rows[name]})
    most = {word: _usual(some) for word, some in read.items()}
    ordered = sorted(most, key=lambda word: most[word])
    rest = [*most.values()].count(most[ordered[0]])
    if _are_apart(ordered[:rest], ordered[rest:]):
        return [(tuple(ordered), rest)]
    if not set.intersection(*(set[str]().union(*some) for some in read.values())):
        return []
    return [((one, *(word for word in most if word != one)), 1) for one in most]


def _usual(groups: Sequence[set[str]]) -> int:
    """Number of targets in a quarter of some groups: one that fell off on the way counts."""
    often = Counter(target for one in groups for target in one)
    return sum(4 * count >= len(groups) for count in often.values())


def _are_apart(unloaded: Sequence[str], loaded: Sequence[str]) -> bool:
    """Whether states with the fewest targets are those without load.

    It is one, or they have a word in common or begin with the same (SC, SCF).
    """
    common = set.intersection(*({*_WORDS.findall(word)} for word in unloaded))
    others = common.difference(*map(_WORDS.findall, loaded))
    first = min(unloaded, key=len).lower()
    begin = [word.lower().startswith(first) for word in (*unloaded, *loaded)]
    alike = begin == [True] * len(unloaded) + [False] * len(loaded)
    return bool(loaded) and (len(unloaded) == 1 or bool(others) or alike)


def _pattern(
    tokens: Sequence[str],
    numbers: Sequence[int],
    state: int,
    states: tuple[str, ...],
    least: int,
    lettered: bool,
) -> str:
    """Regular expression for names of one form, the last parts of which may be missing.

    Some poses have letters behind their number if it is `lettered`.
    """
    parts = {
        numbers[0]: f"(?P<pose>[0-9]+{_ANY_LETTERS if lettered else ''})",
        state: f"(?P<state>{'|'.join(map(literal, states))})",
    }
    if len(numbers) > 1:
        parts[numbers[1]] = "(?P<repeat>[0-9]*)" if numbers[1] >= least else "(?P<repeat>[0-9]+)"
    out = []
    for k, token in enumerate(tokens):
        fixed = "[0-9]+" if token.isdigit() else literal(token)
        maybe = f"{fixed}?" if len(fixed) == 1 else f"(?:{fixed})?"
        out.append(parts.get(k, maybe if k >= least else fixed))
    none = "" if len(numbers) > 1 else "(?P<repeat>[0-9]*)"
    return "".join(out) + none


def _by_place(rows: Mapping[str, Mapping[str, Array]]) -> tuple[Group, ...]:
    """The ways to read names whose pose is the number that tells places apart; else none."""
    for found in _names_by_place.parts(rows):
        if (split := _names_by_place.labels(found)) is None:
            continue
        before, behind, own = split
        ways = []
        for rest in _names_by_place.unloaded(own, rows):
            loaded = [label for label in dict.fromkeys(own.values()) if label not in rest]
            words, pull = _names_by_place.pulls(loaded)
            ordered = sorted(rest, key=len, reverse=True)
            some = "|".join(map(literal, (*ordered, *words)))
            pattern = f"{before}(?P<state>{some}){pull}{behind}"
            ways.append(Group(pattern, (*ordered, *words), len(ordered)))
        fitting = [one for one in ways if _apart_from_each_other(list(own), one)]
        if fitting:
            return tuple(fitting)
    return ()
