"""An unlisted law: its place, variable and shape, in words and numbers that a file can hold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

_Kind = Literal["periodic", "smooth", "step", "coupling"]
_Variable = Literal["angle", "torque", "position", "direction", "time", "force", "temperature"]

_AND = " + "


@dataclass(frozen=True)
class Law:
    """One law of one place, without its amplitudes.

    Attributes:
        where: Its place: joint number from 1, `rail`, `scale` or `tracker`.
        part: Part of that place that follows the law: `spring`, `friction`, `roll`, ...
        kind: `periodic`, `smooth`, `step` or `coupling`.
        variable: Independent variable: angle [rad], torque [N m], position [m] along the rail,
            direction of the force [1], time [s], force [N].
        source: Joint whose angle, torque or position that is, from 1; 0 for all else.
        order: Periods per turn, or per metre; power of a smooth law, order of the harmonics of a
            direction; of a step 0 if it acts above `at`, 1 if it acts below.
        low: Smallest value of the variable in the data.
        high: Largest value of the variable in the data.
        at: Position of a step or a knee, in the unit of the variable.
        beyond: It represents the law outside the range of the data.
        more: A further shape of the same part and variable, such as the second harmonic of a wave;
            its amplitudes follow those of this one. None if there is none.
    """

    where: int | str
    part: str
    kind: _Kind
    variable: _Variable
    source: int
    order: float
    low: float
    high: float
    at: float = 0.0
    beyond: bool = False
    more: Law | None = None

    @property
    def form(self) -> str:
        """The law as text for a file; `parse` reads it."""
        what = f"{self.part} {self.kind} {self.variable} {self.source}"
        own = f"{what} {self.order} {self.low} {self.high} {self.at} {self.beyond}"
        return own if self.more is None else f"{own}{_AND}{self.more.form}"

    @property
    def shapes(self) -> tuple[Law, ...]:
        """Each of its shapes as a separate law."""
        if self.more is None:
            return (self,)
        return (replace(self, more=None), *self.more.shapes)

    @property
    def of(self) -> tuple[object, ...]:
        """Key of what the law describes: place, part, variable and source joint."""
        return self.where, self.part, self.variable, self.source

    @property
    def driver(self) -> str:
        """What it depends on: its variable, or of a joint that slips for good, an overload."""
        return "overload" if self.part == "slips" else self.variable

    def extends(self, other: Law) -> bool:
        """Whether it is the other law plus one further shape."""
        return self.more is not None and self.shapes[:-1] == other.shapes

    @property
    def family(self) -> tuple[object, ...]:
        """Key of its family, whose laws differ only in order or in the position of a step."""
        return self.where, self.part, self.kind, self.variable, self.source


def parse(where: str, form: str) -> Law:
    """Create a law from the place of its label and its form.

    Raises:
        ValueError: The form does not describe a law.
    """
    own, _, more = form.partition(_AND)
    part, kind, variable, source, order, low, high, at, beyond = own.split()
    if kind not in get_args(_Kind) or variable not in get_args(_Variable):
        raise ValueError(form)
    return Law(
        int(where) if where.isdigit() else where,
        part,
        cast("_Kind", kind),
        cast("_Variable", variable),
        int(source),
        float(order),
        float(low),
        float(high),
        float(at),
        beyond == str(True),
        parse(where, more) if more else None,
    )
