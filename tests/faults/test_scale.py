"""One mistyped reading of the scale is named with its place; effects of force or joints are not."""

import numpy as np
import pytest
from small_case import screen

from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.fit import fit

PLAN = Plan(name="typed", seed=12, poses={"count": 9}, pulls={"steps_n": [1500.0, 3000.0]})
LINE = 8
"""Line of loads.csv: pose 4, first pull."""


def campaign(*effects, **changes):
    """A campaign of nine poses, each pulled twice."""
    return simulate(revised(PLAN, {"hidden": {"effects": list(effects)}, **changes}))


def mistyped(files, change, line=LINE):
    """The same with another force in a line of the scale's log."""
    rows = files["loads.csv"].decode().splitlines()
    column = rows[0].split(",").index("force_n")
    cells = rows[line - 1].split(",")
    cells[column] = change(cells[column])
    rows[line - 1] = ",".join(cells)
    return {**files, "loads.csv": "\n".join(rows).encode()}


def screened(files):
    case = ingested(in_memory(files), plausible=False)
    return screen(case, bring(case))


def times(factor):
    return lambda typed: str(factor * float(typed))


def exchanged(typed):
    """With the first two digits exchanged."""
    assert typed[0] != typed[1]
    return typed[1] + typed[0] + typed[2:]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("change", "changes"),
    [
        (times(1.1), {}),
        (times(2), {"tracker": {"stated": False}}),
        (times(10), {}),
        (exchanged, {}),
    ],
    ids=["a tenth more", "twice, no noise stated", "ten times", "digits exchanged"],
)
def test_a_mistyped_reading_is_named_and_left_out(change, changes):
    """With its group and line; the stiffnesses without it are those of the machine."""
    made = campaign(**changes)

    said = screened(mistyped(made.files, change))

    assert [(f.name, f.where) for f in said.findings] == [("outlier", "loads.csv pose04 rep1")]
    (finding,) = said.findings
    assert f"(line {LINE})" in finding.evidence
    right = next(p["force_n"] for p in made.truth["pulls"] if (p["pose"], p["repeat"]) == (4, 1))
    fits = float(finding.evidence.split("agree with ")[-1].split(" ±")[0])
    assert fits == pytest.approx(np.linalg.norm(right), rel=0.03)
    found = fit(said.case, bring(said.case)).estimate
    truth = np.array([1 / joint["value"] for joint in made.truth["stiffness"]])
    assert np.all(np.abs(found.value - truth) < 4 * found.std)


@pytest.mark.whole
def test_it_is_named_beside_a_fault_of_the_model():
    """Twice the force in one line, while the rail has an unreported backlash."""
    said = screened(mistyped(campaign("rail_backlash").files, times(2)))

    assert [f.where for f in said.findings] == ["loads.csv pose04 rep1"]


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "effect",
    [
        "scale_curvature=8x",
        "joint_hysteresis:2=4x",
        "scale_zero=8x",
    ],
)
def test_what_is_wrong_in_many_pulls_is_no_mistyped_reading(effect):
    """A bent scale or a joint with play affects all pulls alike."""
    assert not screened(campaign(effect).files).findings


@pytest.mark.whole
def test_a_bad_reading_of_the_tracker_is_not_laid_on_the_scale():
    """One reflector off by 2 mm contradicts its own pull more than any force could correct."""
    said = screened(campaign("outlier:pose04_rep1_loaded/P2=2e-3").files)

    assert [f.where for f in said.findings] == ["pose04_rep1_loaded/P2"]


@pytest.mark.whole
def test_a_tracker_knocked_during_a_pull_is_not_laid_on_the_scale():
    """All reflectors of one pull are displaced by a millimetre along and across."""
    files = campaign().files
    rows = [line.split(",") for line in files["tracker.csv"].decode().splitlines()]
    column = [rows[0].index(f"{axis}_mm") for axis in "xyz"]

    def at(group, target):
        return np.array([[float(r[c]) for c in column] for r in rows if r[:2] == [group, target]])

    along = at("pose04_rep1_loaded", "P1") - at("pose04_rep0_unloaded", "P1")
    unit = along[0] / np.linalg.norm(along[0])
    shift = unit + np.cross(unit, [0, 0, 1])
    for row in rows:
        if row[0] == "pose04_rep1_loaded" and row[1] in ("P1", "P2", "P3"):
            for c, more in zip(column, shift, strict=True):
                row[c] = f"{float(row[c]) + more:.4f}"
    knocked = "\n".join(",".join(row) for row in rows).encode()

    assert not screened({**files, "tracker.csv": knocked}).findings


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("factor", "named"), [(4.0, 3), (0.8, 0)])
def test_a_pose_that_is_off_by_one_factor_has_no_mistyped_readings(factor, named):
    """Not all its pulls are mistyped alike, unless the factor exceeds any compliance."""
    pulls = {"steps_n": [1000.0, 2000.0, 3000.0]}
    files = simulate(revised(PLAN, {"poses": {"count": 16}, "pulls": pulls})).files
    for line in (5, 6, 7):
        files = mistyped(files, times(factor), line)

    places = [f"loads.csv pose02 rep{k}" for k in (1, 2, 3)]
    assert sorted(f.where for f in screened(files).findings) == places[:named]
