"""Mistakes in all forces of a campaign: a reversed pull, a wrong unit of the scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array
from pipeline.base.quantities import plain
from pipeline.faults.conventions import aligned, symbol
from pipeline.faults.fault import Fault
from pipeline.faults.labels import chain_distances
from pipeline.faults.mistake import Mistake
from pipeline.readers.logs import FORCE
from pipeline.reduction.case import Case
from pipeline.system.specimen import SURE, Common, common, has_stated_stiffness
from pipeline.system.system import Estimate

_CLEAR = 4.0
"""Minimum size of a compliance in standard uncertainties for its sign to be clear [1]."""

_FEWEST = 3
"""Minimum number of joints to distinguish a wrong unit from deviations of single joints."""


def reversed_pull(case: Case, estimate: Estimate) -> list[Mistake]:
    """The mistake that the chain's ends are exchanged in the whole campaign.

    Every spring then deflects against the force: the work done on the robot is negative, which is
    impossible for a passive structure.
    """
    known = np.isfinite(estimate.std) & (np.abs(estimate.value) > _CLEAR * estimate.std)
    weight = (estimate.value[known] / estimate.std[known]) ** 2
    if not known.any():
        return []
    against = weight[estimate.value[known] < 0].sum() / weight.sum()
    negative = int((estimate.value[known] < 0).sum())
    if against < 0.9 or negative < 0.6 * known.sum():
        return []
    share = _farther(case)
    if share is not None and share < 0.5:
        return []
    evidence, correction = _reversed(case, negative, int(known.sum()), share)
    return [
        Mistake(
            name="sign_or_convention",
            where="pull_reversed",
            evidence=evidence,
            correction=correction,
            before=float(against),
            after=1 - float(against),
            unit="1",
            correct=_turned_round,
        )
    ]


def _reversed(case: Case, negative: int, clear: int, share: float | None) -> tuple[str, str]:
    """Evidence and correction; `share` of the pulls whose first end is farther, if known."""
    if _hangs(case):
        return (
            f"weights pull the other way than [gravity] states: {negative} of "
            f"{clear} clear compliances are negative, the robot would move against them",
            "recomputed with weights pulling the other way in F_b",
        )
    names, raw = " and ".join(case.settings.naming.chain), case.settings.displacements is None
    seen = "" if share is None else f", and in {share:.0%} of the pulls the first end is farther "
    seen += "" if share is None else "from the load point"
    return (
        f"the pull is reversed: {negative} of {clear} clear compliances are "
        f"negative, the robot would move against the force{seen}",
        f"recomputed with {names} exchanged" if raw else "recomputed with all forces reversed",
    )


def _hangs(case: Case) -> bool:
    """Whether the robot is loaded by weights and payloads only, without a chain."""
    return len(case.loads) > 0 and bool(case.loads["force_n"].isna().all())


def _farther(case: Case) -> float | None:
    """Fraction of pulls whose first chain reflector is the farther one from the load point."""
    at = aligned(case)
    if at is None:
        return None
    table = chain_distances(case, *at)
    return float((table["near"] > table["far"]).mean()) if len(table) else None


def _turned_round(case: Case) -> Case:
    """The campaign with all forces reversed."""
    if case.forces is not None:
        return replace(case, forces=_times(case.forces, -1.0))
    if _hangs(case):
        x, y, z = case.settings.gravity.direction
        up = case.settings.gravity.model_copy(update={"direction": (-x, -y, -z)})
        settings = case.settings.model_copy(update={"gravity": up})
        return replace(case, settings=settings, robot=case.robot.under(up.vector))
    chain = case.settings.naming.chain
    naming = case.settings.naming.model_copy(update={"chain": chain[::-1]})
    return replace(case, settings=case.settings.model_copy(update={"naming": naming}))


_OTHERWISE = [(sign, unit) for unit in FORCE if unit != "n" for sign in (1, -1)]
"""Numbers in another unit that were read as N, and the reverse."""


def force_unit(case: Case, estimate: Estimate) -> list[Mistake]:
    """The mistake that the scale's numbers are in another unit, which scales all stiffnesses.

    This shows only on a robot of known stiffnesses. The common factor of all joints (see
    `system.specimen`) must exceed the differences between specimens of a type as the numbers stand,
    and not in one other unit only, each with a probability of `SURE`.
    """
    joints, k = case.robot.joints, len(case.robot.joints)
    x, std = estimate.value[:k], estimate.std[:k]
    known = (
        np.isfinite(std)
        & (x > 3 * std)
        & np.array([has_stated_stiffness(joint) for joint in joints])
    )
    if known.sum() < _FEWEST or _hangs(case):  # a mass is in no unit of force
        return []
    which = [joint for joint, of in zip(joints, known, strict=True) if of]
    stiff, relative = 1 / x[known], std[known] / x[known]

    def off(factor: float) -> Common:
        return common(factor * stiff, factor * stiff * relative, which)

    given = off(1.0)
    if given.beyond < SURE:
        return []
    right = {(s, u): off(FORCE[u] ** s) for s, u in _OTHERWISE}
    second, best = sorted(right, key=lambda one: right[one].within)[-2:]
    if right[best].within < SURE or right[second].within > 1 - SURE:
        return []
    sign, unit = best
    factor = float(FORCE[unit] ** sign)
    said, where, size = {
        1: (f"are {symbol(unit)} and were read as N", unit, "small"),
        -1: (f"are N and were read as {symbol(unit)}", "n", "large"),
    }[sign]
    return [
        Mistake(
            name="unit_mixup",
            where=where,
            evidence=f"the numbers of the scale {said}: all stiffnesses come out "
            f"{plain(np.exp(abs(given.g)), 2)} times too {size} "
            f"against the robot's nominal ones, and 1 {symbol(unit)} is {FORCE[unit]:.4g} N",
            correction=f"recomputed with all forces times {factor:.4g}",
            before=float(np.exp(-given.g)),
            after=float(np.exp(-right[best].g)),
            unit="1",
            correct=times(factor),
        )
    ]


def times(factor: float) -> Callable[[Case], Case]:
    """Correction that multiplies all forces by a factor."""

    def correct(case: Case) -> Case:
        new = {name: case.loads[name] * factor for name in ("force_n", "unit_n")}
        loads = case.loads.assign(**new)
        forces = None if case.forces is None else _times(case.forces, factor)
        return replace(case, loads=loads, forces=forces)

    return correct


def _times(forces: pa.Table, factor: float) -> pa.Table:
    for name in ("fx_n", "fy_n", "fz_n"):
        values: Array = forces[name].to_numpy() * factor
        at = forces.schema.get_field_index(name)
        forces = forces.set_column(at, forces.schema.field(at), pa.array(values))
    return forces


REVERSED = Fault(
    "sign_or_convention",
    lambda asked: reversed_pull(asked.case, asked.estimate),
    in_forces=True,
)

UNIT = Fault("unit_mixup", lambda asked: force_unit(asked.case, asked.estimate), in_forces=True)
