"""Robot files from URDFs: the URDF read by Pinocchio and our robot file agree."""

import tomllib
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model
from pipeline.app import cli
from pipeline.base import toml
from pipeline.base.errors import InputError
from pipeline.exchange import urdf
from pipeline.exchange.agreement import agreement
from pipeline.exchange.command import made
from pipeline.exchange.from_urdf import robot_file
from pipeline.exchange.to_urdf import urdf as as_urdf
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.robot import load
from pipeline.machine.robot.mdh import parse
from pipeline.prediction import model as handover
from pipeline.prediction.model import ModelHypothesis

FROM_PACKAGES = ("ur10", "ur10e", "kr210_l150", "kr210_r2700_2", "irb6640")
LINK = '<link name="{0}"><inertial><mass value="{1}"/><origin xyz="{2}"/>{3}</inertial></link>'
INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'


def joint(name, type_, parent, child, xyz="0 0 0", rpy="0 0 0", more='<axis xyz="0 0 1"/>'):
    """One joint of a URDF."""
    return (
        f'<joint name="{name}" type="{type_}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint>'
    )


def limit(lower, upper, effort=0.0, axis="0 0 1"):
    """Axis and limits of a joint."""
    ends = f'lower="{lower}" upper="{upper}" effort="{effort}" velocity="1"'
    return f'<axis xyz="{axis}"/><limit {ends}/>'


def robot_of(*parts, links=5):
    """A URDF with links l0, l1, ... without mass."""
    bare = "".join(f'<link name="l{k}"/>' for k in range(links))
    return f'<robot name="made up">{bare}{"".join(parts)}</robot>'


def drawn(rng, spread):
    """A URDF of six joints with axes, origins and bodies at random, a fixed joint among them.

    Args:
        rng: Draws them.
        spread: How far each axis is from parallel to the one before [rad]; None for anyhow.
    """
    numbers = lambda values: " ".join(repr(float(v)) for v in values)  # noqa: E731
    parts = [
        LINK.format(f"l{k}", k + 1.0, numbers(rng.normal(0, 0.2, 3)), INERTIA) for k in range(8)
    ]
    types = ["revolute", "continuous", "fixed", "prismatic", "revolute", "revolute", "revolute"]
    for k, type_ in enumerate(types):
        axis = rng.normal(size=3) if spread is None else [*(spread * rng.normal(size=2)), 1.0]
        turn = rng.uniform(-3, 3, 3) if spread is None else [0.0, 0.0, rng.uniform(-3, 3)]
        parts.append(
            joint(
                f"j{k}", type_, f"l{k}", f"l{k + 1}", numbers(rng.normal(0, 0.5, 3)), numbers(turn),
                limit(-0.7 - 0.1 * k, 1.1, 10.0 * k, numbers(axis)),
            )
        )  # fmt: skip
    return f'<robot name="drawn">{"".join(parts)}</robot>'


def table_of(text, base="l0", flange="l7"):
    """The content of the robot file of a URDF."""
    return robot_file(urdf.read(text, "x.urdf"), base, flange, "x.urdf")


def difference(text, base="l0", flange="l7"):
    """Difference between the robot file made from a URDF and the URDF."""
    robot = parse(toml.dumps(table_of(text, base, flange)), "x.toml")
    return agreement(robot, text, base, flange, "x.urdf", np.random.default_rng(1))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("spread", [None, 0.0, 1e-12, 1e-7, 1e-4, 0.011, 0.3])
def test_the_table_of_any_chain_is_the_chain(spread):
    """Skew, parallel and nearly parallel axes: flange and URDF agree to a nanometre."""
    for seed in range(3):
        found = difference(drawn(np.random.default_rng(seed), spread))

        assert found.position_m < 1e-9
        assert found.angle_rad < 1e-9


def test_nearly_parallel_axes_have_short_rows():
    """Common normals kilometres away do not enter the DH parameters."""
    rows = table_of(drawn(np.random.default_rng(2), 1e-5))["joint"]

    assert max(abs(row[key]) for row in rows for key in ("a_m", "d_m")) < 10
    assert any("beta_deg" in row for row in rows)


def test_enormous_limits_are_none():
    """1e16 rad and 1e9 N m mean unknown; other limits are kept."""
    text = robot_of(
        joint("a", "revolute", "l0", "l1", more=limit(-1e16, 1e16, 1e9)),
        joint("b", "revolute", "l1", "l2", "1 0 0", "9000 0 0", limit(-2, 1e16, 80)),
        links=3,
    )
    made_of = table_of(text, flange="l2")
    first, second = made_of["joint"]

    assert not {"lower_deg", "upper_deg", "effort_nm"} & set(first)
    assert "upper_deg" not in second
    assert (second["lower_deg"], second["effort_nm"]) == (pytest.approx(-114.591559026), 80.0)
    assert "the URDF gives no range for theta1" in made_of["assumptions"]
    assert difference(text, flange="l2").position_m < 1e-9


def test_axes_on_one_line_and_opposed_are_a_table():
    """Two rotations about one axis in opposite senses, with the flange off the axis."""
    text = robot_of(
        joint("a", "revolute", "l0", "l1", "0 0 0.4", "0.4 0.7 -1.1", limit(-1, 1)),
        joint("b", "revolute", "l1", "l2", "0 0 0.3", "3.141592653589793 0 0", limit(-1, 1)),
        joint("c", "fixed", "l2", "l3", "0.1 0.2 0.3", "0.3 1.5707963267948966 0.1"),
        links=4,
    )

    assert difference(text, flange="l3").position_m < 1e-11
    assert difference(text, flange="l3").angle_rad < 1e-9


def test_f_b_may_stand_beside_the_chain():
    """A link fixed to one of the chain can be F_b, as the controller's base of many robots is."""
    text = robot_of(
        joint("stand", "fixed", "l0", "l1", "0.1 0.2 0.3", "0.1 0.2 0.3"),
        joint("a", "revolute", "l0", "l2", "0 0.5 0.4", "0.5 0 0", limit(-1, 1, axis="0 1 0")),
        joint("b", "prismatic", "l2", "l3", "1 0 0", "0 0.4 0", limit(-1, 1, axis="1 0 0")),
        links=4,
    )

    assert difference(text, base="l1", flange="l3").position_m < 1e-11


@pytest.mark.parametrize("axis", ["1 0 0", "-1 0 0", "0 1 0", "0.6 0 0.8", "0 0 -1"])
def test_the_first_axis_may_point_anywhere(axis):
    """Through F_b or past it, also along its x, which no row can represent."""
    for xyz in ("0 0 0", "0.1 0.2 0.3"):
        text = robot_of(
            joint("a", "revolute", "l0", "l1", xyz, more=limit(-1, 1, axis=axis)),
            joint("b", "revolute", "l1", "l2", "0.5 0.1 0.2", more=limit(-1, 1)),
            links=3,
        )

        assert difference(text, flange="l2").position_m < 1e-11


def test_a_rail_as_people_write_it_is_plain_rows():
    """If rows can lead from F_b to the flange, there is neither [base] nor [flange] nor beta."""
    text = robot_of(
        joint("rail", "prismatic", "l0", "l1", more=limit(0, 18, 900.0, "0 1 0")),
        joint("a", "revolute", "l1", "l2", "0 0 1.045", more=limit(-3, 3, 50.0)),
        joint("b", "revolute", "l2", "l3", "0.5 0 0", "-1.5707963267948966 0 0", limit(-1, 2)),
    )
    made_of = table_of(text, flange="l3")
    rail, first, second = made_of["joint"]

    assert not {"base", "flange"} & set(made_of)
    assert (rail["lower_m"], rail["upper_m"], rail["effort_n"]) == (0.0, 18.0, 900.0)
    assert first["stiffness_range_nm_per_rad"] == [5000, 50000]
    assert first["lower_deg"] == pytest.approx(-171.887338539, abs=1e-9)
    assert "effort_nm" not in second
    assert (second["alpha_deg"], second["a_m"]) == (-90.0, 0.5)


def test_the_table_of_a_ur10e_is_the_one_that_its_maker_prints():
    """X keeps its direction between parallel axes, so that lengths are negative as printed."""
    square = "1.5707963267948966 0 0"
    back = "1.5707963267948966 3.141592653589793 3.141592653589793"
    places = [
        ("0 0 0.1807", "0 0 0"),
        ("0 0 0", square),
        ("-0.6127 0 0", "0 0 0"),
        ("-0.57155 0 0.17415", "0 0 0"),
        ("0 -0.11985 0", square),
        ("0 0.11655 0", back),
    ]
    arm = (
        joint(f"j{k}", "revolute", f"l{k}", f"l{k + 1}", xyz, rpy, limit(-6, 6))
        for k, (xyz, rpy) in enumerate(places)
    )
    rows = table_of(robot_of(*arm, links=7), flange="l6")["joint"]
    printed = [(0, 0, 0.1807), (90, 0, 0), (0, -0.6127, 0), (0, -0.57155, 0.17415)]
    printed += [(90, 0, 0.11985), (-90, 0, 0.11655)]

    assert [(one["alpha_deg"], one["a_m"], one["d_m"]) for one in rows] == printed
    assert [one["theta_deg"] for one in rows] == [0] * 6


def test_what_the_links_weigh_is_carried():
    """Gravity torques of the robot file are those of the URDF, including fixed bodies."""
    text = drawn(np.random.default_rng(5), None)
    ours = model(parse(toml.dumps(table_of(text)), "x.toml"))
    theirs = pin.buildModelFromXML(text)
    q = np.array([0.3, 0.5, -0.2, 0.7, 0.4, -0.6])
    wide = np.array([0.3, np.cos(0.5), np.sin(0.5), -0.2, 0.7, 0.4, -0.6])  # continuous: cos, sin
    expected = pin.computeGeneralizedGravity(theirs, theirs.createData(), wide)

    assert np.abs(expected).max() > 10
    assert pin.computeGeneralizedGravity(ours, ours.createData(), q) == pytest.approx(
        expected, abs=1e-9
    )


@pytest.mark.parametrize("name", FROM_PACKAGES)
def test_the_urdf_of_a_hand_over_is_the_robot_file(name):
    """The delivered model.urdf agrees with the robot file, with its limits and efforts."""
    robot = load(name)
    robot = replace(robot, controller=tuple(joint.name for joint in robot.joints))
    cell = paper_cell(robot, Tool(np.zeros(3), np.array(["P1"], object), np.zeros((1, 3))))
    known = ModelHypothesis(1.0, cell, robot.nominal_compliance, np.zeros((robot.n, robot.n)))
    text = as_urdf(handover.IdentifiedModel("made", "adequate", {}, (known,))).decode()
    found = agreement(robot, text, "F_b", "F_flange", "model.urdf", np.random.default_rng(2))
    limits = pin.buildModelFromXML(text)

    assert found.position_m < 1e-9
    assert found.angle_rad < 1e-9
    assert limits.lowerPositionLimit == pytest.approx(robot.lower)
    assert limits.effortLimit == pytest.approx([joint.effort or 1e6 for joint in robot.joints])


ARM = (
    joint("a", "revolute", "l0", "l1", more=limit(-1, 1)),
    joint("b", "revolute", "l1", "l2", "1 0 0", more=limit(-1, 1)),
)
LIGHT = '<link name="heavy"><inertial><mass value="-5"/></inertial></link>'
BUSY = "<gazebo " + " ".join(f'a{k}="1"' for k in range(101)) + "/>"


def long_arm(n):
    """An arm of n joints, whose last link is l2."""
    name = lambda k: "l2" if k == n else f"l{k}" if k < 2 else f"l{k + 1}"  # noqa: E731
    turns = (
        joint(f"j{k}", "revolute", name(k), name(k + 1), "1 0 0", more=limit(-1, 1))
        for k in range(n)
    )
    return robot_of(*turns, links=n + 1)


def test_the_comparison_takes_the_memory_of_one_arm(monkeypatch):
    """Pinocchio's data of 100 joints, 20 MB, are made once, and not at each configuration."""
    made_anew = []
    create = pin.Model.createData
    monkeypatch.setattr(pin.Model, "createData", lambda m: made_anew.append(m) or create(m))

    assert difference(long_arm(20), flange="l2").position_m < 1e-9
    assert len(made_anew) == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("format = 1", "x.urdf: is no XML"),
        ("<model/>", "begins with <model>"),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>', "expand it first"),
        (robot_of(*ARM, links=2), 'no link "l2"; its links are l0, l1'),
        (robot_of(ARM[1], links=3), "no chain of joints leads from link l0 to link l2"),
        (robot_of(ARM[0], joint("b", "floating", "l1", "l2"), links=3), "joint b is floating"),
        (
            robot_of(ARM[0], ARM[1].replace("</joint>", '<mimic joint="a"/></joint>'), links=3),
            "joint b follows a",
        ),
        (robot_of(joint("a", "fixed", "l0", "l2"), links=3), "nothing moves between link l0"),
        (
            robot_of(ARM[0], ARM[1].replace("1 0 0", "1 0"), links=3),
            'joint b: xyz = "1 0" is not 3',
        ),
        (robot_of(ARM[0], ARM[1].replace("1 0 0", "1 0 nan"), links=3), "is not 3 numbers"),
        (robot_of(ARM[0], ARM[1].replace("1 0 0", "1 0 1e308"), links=3), "is not 3 numbers"),
        (robot_of(ARM[0], ARM[1].replace("1 0 0", "1500 0 2e5"), links=3), "joint b: its origin"),
        (robot_of(ARM[0], ARM[1].replace("0 0 1", "0 0 0"), links=3), "its axis has no length"),
        (robot_of(ARM[0].replace(' link="l1"', ""), links=3), "joint a has no link"),
        (
            robot_of(*ARM, ARM[0].replace('"a"', '"c"'), links=3),
            "link l1 has several parent joints",
        ),
        (robot_of(*ARM, LIGHT, links=3), "link heavy: its mass is -5 kg"),
        (robot_of(*ARM, links=4), "Pinocchio does not read it"),
        (robot_of(*ARM * 501, links=3), "has 1002 joints, more than the 1000 that are read"),
        (long_arm(101), "101 joints move, more than 100, between link l0 and link l2"),
        (robot_of(*ARM, BUSY, links=3), "a <gazebo> has 101 attributes, more than the 100 read"),
    ],
)
def test_what_is_no_chain_of_joints_is_refused_by_name(tmp_path, text, says):
    """One sentence names the joint or link, and what to do."""
    (tmp_path / "x.urdf").write_text(text)

    with pytest.raises(InputError, match=says):
        made(tmp_path / "x.urdf", "l0", "l2")


def test_the_command_writes_a_robot_file_once(tmp_path, capsys):
    """Its path on stdout, on stderr the largest difference; a second one does not overwrite it."""
    (tmp_path / "arm.urdf").write_text(robot_of(*ARM, links=3))
    asked = [str(tmp_path / "arm.urdf"), "--base", "l0", "--flange", "l2", "--payload", "12.5"]
    out = tmp_path / "arm.toml"

    def exit_code():
        with pytest.raises(SystemExit) as end:
            cli.main(["robot", *asked, "--output", str(out)])
        return end.value.code

    assert exit_code() == 0
    said = capsys.readouterr()
    assert said.out == f"{out}\n"
    assert "at 1000 configurations: " in said.err
    content = tomllib.loads(out.read_text())
    assert (content["name"], content["payload_kg"]) == ("made_up", 12.5)
    assert content["controller"]["axes"] == ["a", "b"]
    assert exit_code() == 2
