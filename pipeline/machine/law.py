"""What a law that nobody listed is of, in words and numbers that a file can hold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

Kind = Literal["periodic", "smooth", "step", "coupling"]
Variable = Literal["angle", "torque", "position", "direction", "time", "force", "temperature"]

_AND = " + "


@dataclass(frozen=True)
class Law:
    """One law of one place, without its amplitudes.

    Attributes:
        where: The place: joint number from 1, `rail`, `scale` or `tracker`.
        part: What of that place follows the law: `spring`, `friction`, `roll`, ...
        kind: `periodic`, `smooth`, `step` or `coupling`.
        variable: What it is of: angle [rad], torque [N m], position [m] along the rail, direction
            of the force [1], time [s], force [N].
        source: Joint whose angle, torque or position that is, from 1; 0 for all else.
        order: Periods per turn, or per metre; power of a smooth law; of a step
            0 where it is there beyond its place, 1 where it is there up to it.
        low: Smallest value of the variable where it was taught.
        high: The largest.
        at: Where a step or a knee sits, in the unit of the variable.
        beyond: It stands for what the law may be outside of where it was taught.
        more: A further shape of the same part and variable, with amplitudes of its own behind those
            of this one, as the second harmonic of a wave is; None where there is none.
    """

    where: int | str
    part: str
    kind: Kind
    variable: Variable
    source: int
    order: float
    low: float
    high: float
    at: float = 0.0
    beyond: bool = False
    more: Law | None = None

    @property
    def form(self) -> str:
        """The law as a word for a file; `parse` reads it."""
        what = f"{self.part} {self.kind} {self.variable} {self.source}"
        own = f"{what} {self.order} {self.low} {self.high} {self.at} {self.beyond}"
        return own if self.more is None else f"{own}{_AND}{self.more.form}"

    @property
    def shapes(self) -> tuple[Law, ...]:
        """Each of its shapes as a law by itself."""
        if self.more is None:
            return (self,)
        return (replace(self, more=None), *self.more.shapes)

    @property
    def of(self) -> tuple[object, ...]:
        """What it is a law of: place, part, variable and whose that is."""
        return self.where, self.part, self.variable, self.source

    def extends(self, other: Law) -> bool:
        """Whether it is another law with a further shape."""
        return self.more is not None and self.shapes[:-1] == other.shapes

    @property
    def family(self) -> tuple[object, ...]:
        """Laws of one family differ in their order, or in where they step."""
        return self.where, self.part, self.kind, self.variable, self.source


def parse(where: str, form: str) -> Law:
    """A law from the place of its label and its form.

    Raises:
        ValueError: It is none.
    """
    own, _, more = form.partition(_AND)
    part, kind, variable, source, order, low, high, at, beyond = own.split()
    if kind not in get_args(Kind) or variable not in get_args(Variable):
        raise ValueError(form)
    return Law(
        int(where) if where.isdigit() else where,
        part,
        cast("Kind", kind),
        cast("Variable", variable),
        int(source),
        float(order),
        float(low),
        float(high),
        float(at),
        beyond == str(True),
        parse(where, more) if more else None,
    )
