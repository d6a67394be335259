"""State in force at each motion (tool, frame, displacement), on whatever branch it is reached.

A program is a sequence of steps in the order of its text. Where two branches lead to the same place
with different values, the state there is unknown; this is then reported, and nothing is corrected.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

StepKind = Literal[
    "set", "open", "loop", "branch", "else", "scope", "routine", "close", "call", "label"
]
"""Kind of a step. `open`, `loop`, `scope` and `routine` begin a block, `branch` and `else` an
alternative within it. At its end, a `scope` restores the state before it; a `call` is that of
another routine of the text."""


_BEGIN = ("open", "loop", "scope", "routine")


@dataclass(frozen=True)
class UnknownState:
    """The state is unknown.

    Attributes:
        why: Reason, worded to be part of a sentence.
    """

    why: str


HeldState = str | UnknownState
"""The state in force, by name."""


class ProgramStep(NamedTuple):
    """One step of a program.

    Attributes:
        at: Index of its first character in the text.
        kind: Kind of step.
        line: Line number, from 1.
        value: State that it sets, for a step of kind `set`.
    """

    at: int
    kind: StepKind
    line: int
    value: HeldState = ""


@dataclass
class _Block:
    """A block that is not yet closed.

    Attributes:
        begun: Its first step.
        entry: State before it.
        ends: State at the end of each branch so far.
        every: Whether one of its branches is always taken (it has an `else`).
    """

    begun: ProgramStep
    entry: HeldState
    ends: list[HeldState] = field(default_factory=list)
    every: bool = False


def holding(steps: Sequence[ProgramStep], first: str, thing: str) -> Callable[[int], HeldState]:
    """Return a function that gives the state in force at a place of the text.

    Args:
        steps: In the order of the text.
        first: State before the first step.
        thing: What the state is, as a noun for messages.
    """
    flow = _Flow(steps, first, thing)
    marks = [(0, flow.now)]
    for step in steps:
        flow.take(step)
        marks.append((step.at, flow.now))
    places = [at for at, _ in marks]
    return lambda at: marks[bisect_right(places, at) - 1][1]


def interrupted(
    steps: Sequence[ProgramStep], motions: Iterable[tuple[int, int]]
) -> list[ProgramStep]:
    """Add a `call` step at each motion: an interrupt or a parallel routine may run there.

    Args:
        steps: Steps without those calls.
        motions: Place and line of each motion.
    """
    calls = [ProgramStep(at, "call", line) for at, line in motions]
    return sorted([*steps, *calls], key=lambda one: one.at)


def _within(steps: Iterable[ProgramStep]) -> tuple[dict[int, set[HeldState]], set[int]]:
    """States set within each block, and blocks that call a routine, by the place where they begin.

    -1 stands for the whole text.
    """
    found: dict[int, set[HeldState]] = {-1: set()}
    calling: set[int] = set()
    open_: list[tuple[int, StepKind]] = [(-1, "routine")]
    for step in steps:
        if step.kind in _BEGIN:
            open_.append((step.at, step.kind))
            found[step.at] = set()
        elif step.kind == "set":
            found[open_[-1][0]].add(step.value)
        elif step.kind == "call":
            calling |= {at for at, _ in open_}
        elif step.kind == "close" and len(open_) > 1:
            at, kind = open_.pop()
            found[open_[-1][0]] |= found[at] if kind != "scope" else set()
    for (outer, _), (at, _) in reversed(list(pairwise(open_))):
        found[outer] |= found[at]
    return found, calling


class _Flow:
    """The state in force as steps are processed one by one."""

    def __init__(self, steps: Sequence[ProgramStep], first: str, thing: str) -> None:
        self.within, self.calling = _within(steps)
        self.first, self.thing = first, thing
        routines = (step.at for step in steps if step.kind == "routine")
        self.setters = Counter(value for at in routines for value in self.within[at])
        self.others: dict[int, set[HeldState]] = {}
        self.now: HeldState = first
        self.blocks: list[_Block] = []
        self.routines = 0
        self.sure: set[HeldState] = set()

    def take(self, step: ProgramStep) -> None:
        """Process the next step."""
        match step.kind:
            case "set":
                self._set(step.value)
            case kind if kind in _BEGIN:
                self._begin(step)
            case "branch" | "else":
                self._turn(step)
            case "close":
                self._end()
            case "call" if self._elsewhere() - {self.now}:
                self.now = UnknownState(
                    f"a routine called in line {step.line} or before may change the {self.thing}"
                )
            case "label" if self.within[-1] - {self.now}:
                self.now = UnknownState(
                    f"line {step.line} can be jumped to with another {self.thing}"
                )

    def _set(self, value: HeldState) -> None:
        self.now = value
        if self.routines <= 1 and all(one.begun.kind == "routine" for one in self.blocks):
            self.sure.add(value)

    def _begin(self, step: ProgramStep) -> None:
        self.blocks.append(_Block(step, self.now))
        sets = self.within[step.at] | (self._elsewhere() if step.at in self.calling else set())
        if step.kind == "routine":
            self.now = self._entered(step)
        elif step.kind == "loop" and sets - {self.now}:
            self.now = self._depends(step)

    def _entered(self, step: ProgramStep) -> HeldState:
        """State where a routine begins; the first is the program, which calls the others."""
        self.routines += 1
        everywhere = self.within[-1]
        if self.routines == 1 or not everywhere:
            return self.first
        if len(everywhere) == 1 and everywhere <= self.sure:
            return next(iter(everywhere))
        why = f"the {self.thing} in the routine of line {step.line} is that of its caller"
        return UnknownState(why)

    def _elsewhere(self) -> set[HeldState]:
        """All states set in routines other than the current one."""
        mine = {one.begun.at for one in self.blocks if one.begun.kind == "routine"}
        key = max(mine, default=-1)
        if key not in self.others:
            own = self.within.get(key, set()) if mine else set()
            self.others[key] = {v for v, times in self.setters.items() if times > (v in own)}
        return self.others[key]

    def _turn(self, step: ProgramStep) -> None:
        if not self.blocks or self.blocks[-1].begun.kind != "open":
            return
        block = self.blocks[-1]
        block.ends.append(self.now)
        block.every |= step.kind == "else"
        self.now = block.entry

    def _end(self) -> None:
        if not self.blocks:
            return
        block = self.blocks.pop()
        if block.begun.kind in ("routine", "scope"):
            self.now = block.entry
            return
        ends = {*block.ends, self.now, *(() if block.every else (block.entry,))}
        if block.begun.kind == "loop":  # a loop may be left at any place
            ends |= self.within[block.begun.at]
        if len(ends) > 1:
            self.now = self._depends(block.begun)

    def _depends(self, step: ProgramStep) -> UnknownState:
        return UnknownState(f"the {self.thing} depends on what line {step.line} decides")
