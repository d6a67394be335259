"""Whether bad data are identified, and good data are left alone.

Every campaign has its own poses, tracker place, noise model, true stiffnesses and tool points; an
error is planted in its raw files, which pass through ingest and screening like real ones. A result
is right if the first finding has the name and the place of what was planted.
"""

from collections.abc import Iterable

import numpy as np

from pipeline.faults.screen import Screened, files_of, singles_of
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.run import ingested
from pipeline.service.executor import InProcesses, in_order
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory

EACH, CLEAN, PHYSICAL = 200, 1000, 200
INSTRUMENT = {
    "range_m": 8e-6,
    "range_per_m": 0.3e-6,
    "transverse_m": 7.5e-6,
    "transverse_per_m": 3e-6,
}
NOISES = ({"sigma_m": 3e-5}, {"noise": "paper"}, {"noise": INSTRUMENT})
BLUNDERS = ("outlier", "outlier=5e-4", "label_swap", "unit_mixup", "sign_or_convention")
"""What is planted; smaller outliers are in bench_outliers, with their detectability."""


def run() -> Iterable[tuple[str, float, str]]:
    """Fraction named correctly per blunder, fraction of good campaigns with any finding."""
    said = in_order(InProcesses(), _found, [("", seed) for seed in range(CLEAN)])
    yield ("clean campaigns called bad", _share(said), f"aim <= 0.005 of {CLEAN}")
    said = in_order(InProcesses(), _found, [("any", seed) for seed in range(PHYSICAL)])
    yield (
        "campaigns with one effect of the catalogue called bad",
        _share(said),
        f"of {PHYSICAL}; physics is no bad data",
    )
    for blunder in BLUNDERS:
        jobs = [(blunder, 10_000 + seed) for seed in range(EACH)]
        named = [found == wanted for wanted, found, _ in in_order(InProcesses(), _found, jobs)]
        size = "" if "=" in blunder or blunder != "outlier" else " (0.3 mm)"
        yield (f"{blunder}{size}: named with its place", np.mean(named), f"of {EACH}")


def _share(said: list[tuple[str, str, str]]) -> float:
    for wanted, found, what in said:
        if found:
            print(f"    {wanted or 'clean'}: {found} {what}", flush=True)
    return float(np.mean([bool(found) for _, found, _ in said]))


def screen(case: Case, reduced: Reduced) -> Screened:
    """All mistakes, from those of whole files to those of single readings."""
    files = files_of(case, reduced)
    return singles_of(files, None if files.findings else reduced)


def plan(blunder: str, seed: int) -> Plan:
    """A campaign with its own random parameters."""
    rng = np.random.default_rng([77, seed])
    effects = [blunder] if blunder else []
    if blunder == "any":
        known = catalogue(load("kr500_rail"))
        effects = [known[rng.integers(len(known))].label]
    clean = not effects
    return revised(
        Plan(name="league", seed=seed),
        {
            "poses": {"count": int(rng.integers(10, 20))},
            "tracker": {
                **NOISES[rng.integers(len(NOISES))],
                "position": [*rng.uniform((2, 0), (9, 18)).tolist(), float(rng.uniform(0.3, 2))],
                "yaw_deg": float(rng.uniform(-180, 180)),
                "noise_scale": float(rng.uniform(0.8, 1.3)) if clean else 1.0,
            },
            "hidden": {"stiffness_spread": 0.25, "tool_sd_m": 3e-4, "effects": effects},
        },
    )


def _found(job: tuple[str, int]) -> tuple[str, str, str]:
    """What was planted and what was found first, as `name place`, and all evidence."""
    made = simulate(plan(*job))
    raw = in_memory(made.files)
    case = ingested(raw, plausible=False)
    findings = screen(case, bring(case)).findings
    planted = made.truth["effects"]
    wanted = f"{planted[0]['name']} {planted[0]['where']}" if planted else ""
    found = f"{findings[0].name} {findings[0].where}" if findings else ""
    what = "; ".join(f.evidence for f in findings)
    return wanted, found, what
