"""Laws outside the catalogue, and machines that have them, for tests of several rooms."""

from dataclasses import replace

import numpy as np

from bench.league.machine import Machine, Spring
from pipeline.diagnosis.isolability import rich_pulls, rich_tool
from pipeline.machine.cell import paper_cell
from pipeline.machine.law import Law
from pipeline.machine.robot import load as robot_of

KR500 = robot_of("kr500_rail")
RNG = np.random.default_rng(36)
CELL = paper_cell(KR500, rich_tool(RNG))
PULLS = rich_pulls(KR500, RNG, 40)
ENDS = (-10.0, 10.0)


def law(where, part, kind, variable, source=0, order=1.0, ends=ENDS, at=0.0):
    """A law valid between some limits."""
    return Law(where, part, kind, variable, source, order, *ends, at)


def turning(joint, amount, axis=(0, 0, 1), slides=False, fixed=False):
    """One spring of the league's machine: own force, those of all others -> deflection."""
    return [Spring(f"j{joint}", joint, axis, slides, amount, fixed=fixed)]


def with_and_without(springs, eps):
    """A machine with compliant springs, and the same with rigid ones."""

    def yielding(one, much):
        return replace(one, law=lambda own, every: much * one.law(own, every))

    return [Machine(KR500, [yielding(one, much) for one in springs]) for much in (eps, 0.0)]
