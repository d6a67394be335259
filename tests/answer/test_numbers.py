"""NaN never appears: typing errors by factors, too few poses, rows without information.

Each ends in an answer that JSON can hold and a report, or in one sentence.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from first_poses import TABLES, first

from pipeline.answer.diagnosis import best_pose
from pipeline.base.errors import InputError
from pipeline.diagnosis.facts import Determining, ProposedPose
from pipeline.machine.robot import load
from pipeline.report.render import render
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import dump, in_memory

STATED = Plan(name="kr", seed=3, poses={"count": 6}, pulls={"steps_n": [1500.0, 3000.0]})
UNSTATED = Plan(
    name="kr", seed=5, poses={"count": 8}, pulls={"steps_n": [1500.0]}, tracker={"stated": False}
)


@pytest.fixture(scope="module")
def files():
    """Raw files of each plan, made once."""
    return {id(plan): simulate(plan).files for plan in (STATED, UNSTATED)}


def scaled(content, factor, column, row=None):
    """Numbers of a column, or of one row, multiplied by a factor."""
    lines = content.decode().splitlines()
    at = lines[0].split(",").index(column)
    for k in range(1, len(lines)) if row is None else [row]:
        cells = lines[k].split(",")
        cells[at] = repr(float(cells[at]) * factor)
        lines[k] = ",".join(cells)
    return ("\n".join(lines) + "\n").encode()


def answer(raw):
    """The answer, through JSON and the report, as a run writes them."""
    found = campaign_answer("c", in_memory(raw))
    assert b"NaN" not in dump(found.answer.as_json())
    return found


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("plan", "file", "column", "row", "cause"),
    [
        (UNSTATED, "tracker.csv", "x_mm", 21, "outlier"),
        (UNSTATED, "loads.csv", "force_n", 4, "outlier"),
        (UNSTATED, "loads.csv", "force_n", None, "unit_mixup"),
        (STATED, "loads.csv", "force_n", 3, "outlier"),
    ],
    ids=["reading", "force", "forces", "force beside stated noise"],
)
def test_a_number_by_a_thousand_is_found(files, plan, file, column, row, cause):
    """One reading, one force or all of them: named, and the values are right again."""
    raw = files[id(plan)]
    found = answer({**raw, file: scaled(raw[file], 1e3, column, row)}).answer

    assert cause in [one.name for one in found.diagnosis.causes]
    known = [one for one in found.stiffness if one.value and one.identifiable]
    assert len(known) >= 5
    assert all(0.3 < one.value / one.nominal < 3 for one in known)


@pytest.mark.slow
def test_millimetres_read_as_metres_end_in_a_report(files):
    """The most frequent blunder: a finding, a verdict, page and PDF."""
    raw = files[id(UNSTATED)]
    metres = raw["tracker.csv"].replace(b"_mm", b"_m")
    found = answer({**raw, "tracker.csv": metres})
    pages = render(found.answer, found.shown, 1.0, None)

    assert found.answer.diagnosis.verdict == "bad_data"
    assert {"index.html", "report.pdf"} <= {*pages}
    assert b"nan" not in pages["index.html"].split(b"<svg")[0]


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("poses", "sigma"), [(3, False), (2, True), (4, False)])
def test_few_poses_get_an_honest_answer(poses, sigma):
    """With two poses of one reflector nothing can be tested, and no cause is named."""
    found = answer(first(poses, sigma)).answer

    assert found.fit.dof == 3 * poses - 6
    assert not found.diagnosis.causes


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda raw: first(2), "6 displacement coordinates for 6 stiffnesses leave none"),
        *(
            (lambda raw, n=n: {**raw, n: raw[n].splitlines()[0]}, f"{n}: there is no row")
            for n in TABLES
        ),
        *((lambda raw, n=n: {**raw, n: b""}, f"{n}: the file is empty") for n in TABLES),
        (
            lambda raw: {
                **raw,
                "forces.csv": b"pose,repeat,fx_n,fy_n,fz_n\n1,1,0,0,0\n2,1,0,1e-320,0\n",
            },
            "the force is zero",
        ),
    ],
)
def test_tables_that_say_nothing_get_a_sentence(spoil, said):
    """Two poses without a noise, headers only, nothing at all, no force."""
    with pytest.raises(InputError, match=said):
        campaign_answer("c", in_memory(spoil(first(3))))


@pytest.mark.parametrize("apart", [-4e-16, 0.0, 4e-16, 1e-7])
def test_a_proposed_force_does_not_hang_on_the_last_digit(apart):
    """The scale read 3032.50 N: every processor proposes the same whole newtons."""
    robot = load("ur10")
    force = np.array([0.0, 0.0, 3032.5 * (1 + apart)])
    at = ProposedPose(np.zeros(robot.n), np.array([2.0, 0.0, 0.0]), force, 4, 1.0)
    found = SimpleNamespace(determining=[Determining(at, 0.3, 0.2)])
    joint = SimpleNamespace(joint=1, name="k_theta1", value=1e6, relative_std=0.1)

    assert best_pose(found, robot, joint).force_n == 3032.0
