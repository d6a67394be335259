"""Whether the stated uncertainty is right: Monte Carlo of the chain, and coverage in the hall.

First the GUM's Supplement 1: the demo campaign's own estimate is taken as truth, its raw readings
are drawn again many times, and every stage is run on each; the scatter of the stiffnesses is
compared with the propagated covariance. Then campaigns, each with a tracker at another place of the
hall, with another yaw and tilt, other poses and other stiffnesses, measured with an instrument
whose noise grows along and across the beam.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pipeline.machine.robot import load
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.service.executor import InProcesses, in_order
from pipeline.simulate import build, draw, parse, raw_files, revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.budget import budget
from pipeline.system.estimate import identify
from pipeline.system.fit import fit

PLAN = Path(__file__).parents[1] / "data" / "plans" / "kr500_demo.toml"
DRAWS, CAMPAIGNS, BATCH = 2000, 500, 25
INSTRUMENT = {
    "range_m": 8e-6,
    "range_per_m": 0.3e-6,
    "transverse_m": 7.5e-6,
    "transverse_per_m": 3e-6,
}


def run() -> Iterable[tuple[str, float, str]]:
    """Budget, scatter over claim and coverage per stiffness; noise named wrongly or rightly."""
    yield from _budget()
    yield from _supplement_one()
    yield from _coverage()
    yield from _noise()


def _budget() -> Iterable[tuple[str, float, str]]:
    """Relative standard uncertainty of each stiffness, and each source's share of its variance."""
    case = ingested(in_memory(simulate(parse(PLAN.read_text("utf-8"))).files))
    system, estimate = identify(case.cell, bring(case).data, case.robot.nominal_compliance)
    parts = budget(system, estimate)
    for joint in range(case.robot.n):
        shares = zip(parts.source, parts.share[:, joint], strict=True)
        said = ", ".join(f"{source} {share:.1%}" for source, share in shares)
        std = estimate.std[joint] / estimate.value[joint]
        yield (f"demo: relative standard uncertainty of stiffness {joint + 1}", std, said)


def _supplement_one() -> Iterable[tuple[str, float, str]]:
    parts = in_order(InProcesses(), _redrawn, range(DRAWS // BATCH))
    x, std = (np.concatenate([part[i] for part in parts]) for i in range(2))
    ratio = x.std(axis=0, ddof=1) / std.mean(axis=0)
    for joint, value in enumerate(ratio, 1):
        yield (
            f"demo: scatter of {len(x)} redrawn chains / claim, joint {joint}",
            value,
            f"aim 0.95-1.05; chance {1 / np.sqrt(2 * len(x)):.3f}",
        )


def _redrawn(number: int) -> tuple[np.ndarray, np.ndarray]:
    plan = parse(PLAN.read_text("utf-8"))
    made = simulate(plan)
    stiffness = (1 / _identified(made.files)[0]).tolist()
    plan = revised(plan, {"hidden": {"stiffness": stiffness}})
    # the poses of the demo campaign itself: its scene uses the first of its two streams
    scene = build(plan, load(plan.robot), np.random.default_rng(plan.seed).spawn(2)[0])
    draws = draw(scene, np.random.default_rng([plan.seed, 1, number]), BATCH)
    found = [_identified(raw_files(scene, draws, k)) for k in range(BATCH)]
    x, std = zip(*found, strict=True)
    return np.array(x), np.array(std)


def _identified(files: dict[str, bytes]) -> tuple[np.ndarray, np.ndarray]:
    case = ingested(in_memory(files))
    _, estimate = identify(case.cell, bring(case).data, case.robot.nominal_compliance)
    return estimate.value, estimate.std


def _hall(seed: int, noise_scale: float = 1.0) -> dict[str, object]:
    rng = np.random.default_rng([5, seed])
    return {
        "seed": seed,
        "tracker": {
            "noise": INSTRUMENT,
            "sigma_m": None,
            "position": [
                float(rng.choice([-1, 1]) * rng.uniform(3, 12)),
                float(rng.uniform(-3, 21)),
                float(rng.uniform(-0.5, 3)),
            ],
            "yaw_deg": float(rng.uniform(-180, 180)),
            "pitch_deg": float(rng.uniform(-10, 10)),
            "roll_deg": float(rng.uniform(-10, 10)),
            "noise_scale": noise_scale,
        },
        "scale": {"sigma_n": 3.0, "sigma_rel": 1e-3, "gain_sigma": 2e-3},
        "hidden": {"stiffness_spread": 0.25},
    }


def _coverage() -> Iterable[tuple[str, float, str]]:
    hits, z = zip(*in_order(InProcesses(), _covered, range(CAMPAIGNS)), strict=True)
    for joint, share in enumerate(np.mean(hits, axis=0), 1):
        yield (
            f"tracker anywhere: 95 % interval of joint {joint} holds the truth",
            share,
            f"aim 0.93-0.97 of {CAMPAIGNS}; chance 0.010",
        )
    yield ("the same, all joints", float(np.mean(hits)), "aim 0.93-0.97")
    yield ("rms of (estimate - truth) / std", float(np.sqrt(np.mean(np.square(z)))), "aim 1")


def _covered(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Whether each interval contains the truth, and the error of the estimate in units of std."""
    plan = revised(parse(PLAN.read_text("utf-8")), _hall(seed))
    made = simulate(plan)
    case = ingested(in_memory(made.files))
    estimate = fit(case, bring(case)).estimate
    truth = np.array([1 / entry["value"] for entry in made.truth["stiffness"]])
    off = (estimate.value - truth) / estimate.std
    return np.abs(off) < estimate.quantile, off


def _noise() -> Iterable[tuple[str, float, str]]:
    for scale, aim in ((1.0, "aim <= 0.01 of"), (1.3, "aim 1, 1.3 planted, of")):
        jobs = [(seed, scale) for seed in range(CAMPAIGNS)]
        named, found = zip(*in_order(InProcesses(), _named, jobs), strict=True)
        said = f"{aim} {CAMPAIGNS}; scale found {np.mean(found):.3f} +- {np.std(found):.3f}"
        yield (f"tracker noise times {scale}: named tracker_noise", float(np.mean(named)), said)


def _named(job: tuple[int, float]) -> tuple[bool, float]:
    plan = revised(parse(PLAN.read_text("utf-8")), _hall(*job))
    case = ingested(in_memory(simulate(plan).files))
    noise = fit(case, bring(case)).noise
    return bool(noise.larger[0]), noise.of("tracker")
