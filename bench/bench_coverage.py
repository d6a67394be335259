"""Coverage of the 95 % intervals for one scene.

Tracker, registration, shared zeros, force and gain errors are drawn again each time and pass
through raw files and every stage, like a real campaign.
"""

import numpy as np
from scipy import stats

from bench.reduced import reduce
from pipeline.machine.cell import paper_cell
from pipeline.machine.robot import load
from pipeline.reduction.bring import conformed
from pipeline.reduction.effector import tool
from pipeline.service.executor import InProcesses, in_order
from pipeline.simulate import Plan, build, draw, raw_files, revised
from pipeline.store.campaign import in_memory
from pipeline.system.estimate import identify

CAMPAIGNS = 2000
NOISES = {"sigma": {"sigma_m": 3e-5}, "paper": {"noise": "paper"}}


def run() -> list[tuple[str, float, str]]:
    """Coverage per joint and noise model, and that of unweighted least squares."""
    out = []
    for noise in NOISES:
        parts = in_order(
            InProcesses(), _hits, [(noise, start) for start in range(0, CAMPAIGNS, 100)]
        )
        ours, plain, p = (np.concatenate([part[i] for part in parts]) for i in range(3))
        for joint, (a, b) in enumerate(zip(ours.mean(axis=0), plain.mean(axis=0), strict=True), 1):
            out.append(
                (
                    f"{noise}: 95 % interval of joint {joint} holds the truth",
                    a,
                    f"aim 0.93-0.97; plain least squares, naive covariance: {b:.3f}",
                )
            )
        out.append((f"{noise}: share of campaigns with p < 0.05", (p < 0.05).mean(), "aim 0.05"))
    return out


def _hits(job: tuple[str, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    noise, start = job
    plan = revised(
        Plan(name="bench"),
        {
            "tracker": NOISES[noise],
            "scale": {"sigma_n": 4.0, "sigma_rel": 1e-3, "gain_sigma": 2e-3},
        },
    )
    robot = load(plan.robot)
    scene = build(plan, robot, np.random.default_rng(plan.seed))
    draws = draw(scene, np.random.default_rng([plan.seed, start]), 100)
    ours, plain, p = [], [], []
    truth = robot.nominal_compliance
    for which in range(100):
        raw = in_memory(raw_files(scene, draws, which))
        data = reduce(raw, conformed).data
        system, found = identify(paper_cell(robot, tool(raw.settings)), data, truth)
        ours.append(np.abs(found.value - truth) < found.quantile * found.std)
        p.append(found.p_value)
        plain.append(_naive(system, truth))
    return np.array(ours), np.array(plain), np.array(p)


def _naive(system, truth):
    """Eq. (21) with s^2 (B'B)^-1: coordinates with equal variances and independent."""
    B = system.B * truth
    x, rest, *_ = np.linalg.lstsq(B, system.c, rcond=None)
    s2 = rest[0] / (len(B) - B.shape[1])
    std = np.sqrt(s2 * np.diag(np.linalg.inv(B.T @ B)))
    return np.abs(x - 1) < stats.t.ppf(0.975, len(B) - B.shape[1]) * std
