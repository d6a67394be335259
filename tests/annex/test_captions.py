"""Captions and tables of the annexes state what was put into the readings."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import report_sample

from pipeline.annex.figures.stiffness import _extremes
from pipeline.annex.position_tables import _held_out
from pipeline.annex.sections.geometry import _letters
from pipeline.answer.contract import TableLetter
from pipeline.positions.cross_validation import Partition
from pipeline.positions.readings import PositionReadings
from pipeline.positions.study import ModelStage, StageResult, Study
from pipeline.report.model import compose


def _spoilt():
    """Tables of the sample with one remarkable value in each."""
    tables = {name: table.copy() for name, table in report_sample.tables().items()}

    rows = tables["residuals"].assign(residual_m=1e-6, left_out_m=1e-6, whitened=0.0)
    here = (rows["pose"] == 7) & (rows["repeat"] == 3) & (rows["target"] == "P2")
    rows.loc[here, "residual_m"] = [3e-4, 0.0, -4e-4]
    there = (rows["pose"] == 9) & (rows["repeat"] == 2) & (rows["target"] == "P1")
    rows.loc[there & (rows["axis"] == "y"), "left_out_m"] = 2.5e-4
    rows.loc[20:26, "whitened"] = -5.0
    tables["residuals"] = rows

    steps = {"nominal_m": 8e-4, "joint_springs_m": 9e-4, "recommended_m": 9.5e-4}
    tables["models"] = tables["models"].assign(measured_m=1e-3, **steps)

    vectors = tables["vectors"].assign(left_x_m=1e-6, left_y_m=1e-6, left_z_m=1e-6)
    one = (vectors["pose"] == 3) & (vectors["target"] == "P1")
    vectors.loc[one, ["left_x_m", "left_y_m", "left_z_m"]] = [0.0, -3e-4, 4e-4]
    tables["vectors"] = vectors

    enough = tables["enough"].assign(relative_std=0.01)
    for poses, std in ((8, 0.12), (16, 0.08), (32, 0.05)):
        enough.loc[
            (enough["poses"] == poses) & (enough["parameter"] == "k_theta3"), "relative_std"
        ] = std
    tables["enough"] = enough

    names = tables["covariance"]["parameter"]
    sizes = 10.0 ** -np.arange(8)
    corr = np.eye(8)
    corr[0, 4] = corr[4, 0] = 0.9
    cov = pd.DataFrame(corr * sizes * sizes[:, None], columns=list(names))
    tables["covariance"] = cov.assign(parameter=names)

    read = pd.DataFrame({"target": ["B1", "B2"] * 3, "dx_m": 1e-5, "dy_m": 0.0, "dz_m": 0.0})
    read.loc[3, ["dx_m", "dy_m"]] = [3e-4, -4e-4]
    tables["registration"] = read

    for name, worst in (("workspace", 2e-5), ("workspace_joint_springs", 3e-5)):
        plane = tables[name].assign(worst_m_per_n=5e-6)
        plane.loc[10, ["reach_m", "height_m", "worst_m_per_n"]] = [1.5, 1.3, worst]
        plane.loc[20, "worst_m_per_n"] = 1e-6
        plane.loc[0, ["worst_m_per_n", "std_m_per_n"]] = [4e-6, 1e-7]
        plane.loc[0, ["direction_x", "direction_y", "direction_z"]] = [0.1, 0.2, -0.9]
        tables[name] = plane

    law = {"x": [1.0, 2.0, 3.0], "law": [1e-6, 1e-6, 2e-6], "y": [2e-6, 1e-6, 2e-6]}
    tables["laws"] = tables["laws"].head(3).assign(**law, y_std=[5e-7, 1e-6, 1e-6])

    shares = {"test_pose": 0.004, "global": 0.03}
    tables["validation"] = tables["validation"].assign(mu=lambda t: t["set"].map(shares))

    tables["diagnosis"].loc[0, "log_evidence"] = 40.0
    return tables


def _answer():
    """The sample whose third joint has half of its stiffness."""

    def soften(content):
        one = content["stiffness"][2]
        low, high = 0.4 * one["nominal"], 0.6 * one["nominal"]
        one |= {"value": 0.5 * one["nominal"], "ci95": [low, high], "std": 0.05 * one["nominal"]}

    return report_sample.revised(report_sample.answer(), soften)


@pytest.fixture(scope="module")
def report():
    return compose(_answer(), _spoilt())


def _plain(text):
    return text.replace("\u00a0", " ")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("models", "nominal 0.200 mm, joint springs 0.100 mm, with the identified causes 0.0500"),
        ("measured", "the largest error is 0.250 mm, at P1 y in pose 9"),
        ("prediction", "Around the test pose half of the poses are predicted within 0.40 %"),
        ("prediction", "Over the workspace half of the poses are predicted within 3.0 %"),
        # weights 4, 1, 1: 1 - 4 * 1 / (4 * 4 + 1 + 4) = 17/21
        ("laws", "roll of the carriage about the rail: 81 %"),
        ("evidence", "tilt of the bearing in joint 2 has the strongest evidence, 40; 2 of 4"),
        ("path", "Of 6 points 4 pass, 1 fail, 1 undecided; the load point deflects by up to 0.610"),
        ("workspace", "4.00 ± 0.10 µm in its most compliant direction, mostly along z"),
        ("workspace", "1.0 µm to 20 µm, most at a reach of 1.5 m and a height of 1.3 m"),
        ("workspace-joint-springs", "1.0 µm to 30 µm"),
        ("stiffness", "k_theta3 is at 50.0 % and k_theta6 at 104 % of its nominal value"),
        ("stiffness", "k_theta3 has the widest interval"),
        ("scene", "The longest residual vector is 0.500 mm, at P1 in pose 3"),
        # nine coordinates by three pulls: sqrt((9 + 16) / 27) 0.1 mm
        ("pose-rms", "Pose 7 is the worst with 0.0962 mm; the median of all 16 poses is 0.00100"),
        ("residual-force", "1000 N to 3000 N and the largest residual of a coordinate is 0.400"),
        ("whitened", "7 of 432 lie beyond ±3"),
        ("arrows", "The longest of 48 arrows is 0.500 mm, at P2 in pose 7"),
        ("enough", "With all 16 poses k_theta3 is the least certain, 8.0 %; half of them would "
                   "have given 12 %, and measuring all of them once more would give 5.0 %"),
        ("correlation", "c_theta5 and c_r1 are correlated most strongly, by +0.90; 1 of"),
        ("registration", "The largest deviation is 0.500 mm at B2, in 6 readings of 2 reflectors"),
    ],
)  # fmt: skip
def test_a_caption_names_what_is_remarkable(report, name, said):
    """Each value is planted where no other has it."""
    caption = next(one for one in report.figures if one.name == name).caption

    assert said in _plain(caption)


@pytest.mark.parametrize(
    ("name", "row", "cells"),
    [
        ("registration", 0, ["B1", "3", "0.010", "0", "0", "0.010", "0.010"]),
        # mean (10 + 10 + 300) / 3 um; rms sqrt((2 * 10^2 + 500^2) / 3) um
        ("registration", 1, ["B2", "3", "0.11", "-0.13", "0", "0.29", "0.50"]),
        ("stretches", 0, ["1", "4", "4", "pass", "0.410", "0.066", "4"]),
        ("stretches", 1, ["5", "5", "1", "undecided", "0.480", "0.066", "5"]),
        ("stretches", 2, ["6", "6", "1", "fail", "0.610", "0.066", "6"]),
    ],
)
def test_a_table_has_the_numbers_of_its_row(report, name, row, cells):
    """Of the same values, worked by hand."""
    table = next(
        b for s in report.sections for b in s.blocks if getattr(b, "columns", 0) and b.name == name
    )

    assert [_plain(cell.text) for cell in table.rows[row]] == cells


def test_the_pose_of_the_picture_that_is_worst_is_so_in_the_table(report):
    """0.5 mm at P1 of pose 3 is the largest residual of that pose."""
    table = next(
        b
        for s in report.sections
        for b in s.blocks
        if getattr(b, "columns", 0) and b.name == "poses"
    )
    residual = {row[0].text: row[-1].text for row in table.rows}

    assert residual["3"] == "0.500"
    assert len(residual) == 16
    assert max(set(residual) - {"3"}, key=lambda pose: float(residual[pose])) != "3"


def test_every_target_of_every_left_out_pose_has_its_own_row():
    """Two series of two poses with three targets each: the distance names where it was read."""
    at = np.zeros((4, 3, 3))
    readings = PositionReadings(
        series=np.array([0, 0, 1, 1]),
        names=np.array(["a", "b"], dtype=object),
        pose=np.array([1, 2, 1, 3]),
        file=np.full(4, "p.csv", dtype=object),
        line=np.arange(4),
        q=np.zeros((4, 6)),
        targets=np.array(["P1", "P2", "P3"], dtype=object),
        six=np.zeros(3, dtype=bool),
        at=at,
        turn=np.broadcast_to(np.eye(3), (4, 3, 3, 3)),
        payload=np.zeros(4, dtype=np.int64),
        payloads=np.array([], dtype=object),
        temperature=np.full(4, np.nan),
    )
    off = np.arange(12.0).reshape(4, 3)
    stages = [
        StageResult(step, SimpleNamespace(readings=readings), {Partition.BETWEEN: off + k})
        for k, step in enumerate(ModelStage)
    ]
    table = _held_out(Study(tuple(stages), (), ()))

    key = ["model", "series", "pose", "target"]
    distance = table.set_index(key)["distance_m"]
    first, second = (step.value for step in list(ModelStage)[:2])
    assert not table.duplicated(key).any()
    assert distance[first, "a", 2, "P3"] == 5.0
    assert distance[first, "b", 1, "P2"] == 7.0
    assert distance[second, "b", 3, "P1"] == 10.0


def test_a_single_nominal_value_is_compared_once():
    """Neither as softest and stiffest nor as the least certain."""
    joint = report_sample.answer().stiffness[1].model_copy(update={"value": 4.0e6, "std": 1e4})

    assert _extremes([joint]) == "k_theta2 is at 105 % of its nominal value."


def test_a_nominal_entry_is_shown_in_full():
    """A robot file is exact, and no uncertainty rounds it."""
    rows = [
        TableLetter(
            name=name, where=3, nominal=nominal, value=nominal, std=1e-5, prior_std=1e-4, unit=unit,
            identifiable=True,
        )
        for name, nominal, unit in (
            ("link_length", 1.075, "m"),
            ("link_offset", 1.1425, "m"),
            ("link_twist", np.pi / 2, "rad"),
        )
    ]  # fmt: skip
    table = _letters(SimpleNamespace(geometry=rows))

    assert [row[2].text for row in table.rows] == ["1075", "1142.5", "90"]


def test_poses_that_do_not_adjoin_make_no_map():
    """Every second row and column of the grid, and the test pose: there is no cell to shade."""
    tables = report_sample.tables()
    grid = tables["workspace"]
    apart = grid[(grid["row"] < 0) | ((grid["row"] % 2 == 0) & (grid["column"] % 2 == 0))]
    assert len(apart) >= 20

    names = {one.name for one in compose(_answer(), tables | {"workspace": apart}).figures}

    assert "workspace" not in names
    assert "workspace" in {one.name for one in compose(_answer(), tables).figures}
