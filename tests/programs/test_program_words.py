"""What is read of robot programs, what is left alone, and what is said where nothing is done."""

import re
import time

import numpy as np
import pinocchio as pin
import pytest
from bending_robot import BendingRobot
from made_programs import frame
from test_programs import TIP, identified, unstamped

from pipeline.app import cli
from pipeline.base.errors import InputError, UsageError
from pipeline.machine.robot import load
from pipeline.programs import read
from pipeline.programs.aim import Refusal
from pipeline.programs.notation import ABB, FANUC, KUKA, UR
from pipeline.programs.on_disk import CorrectionOptions, ForceFrame, program
from pipeline.programs.program import _rewritten

KR = load("kr500_rail")
START = "3000,10,-70,100,20,40,-30"
POSE = "X 2000.0,Y 3000.0,Z 1500.0,A 10.0,B 60.0,C 5.0"


def said(file, text, other=None):
    """What is not corrected of a program, and why."""
    beside = None if other is None else (other[0], other[1].encode())
    return [(one.line, one.why) for one in read(file, text.encode(), beside).left]


def targets(file, text, other=None):
    """Name, tool and frame of each target."""
    beside = None if other is None else (other[0], other[1].encode())
    found = read(file, text.encode(), beside).targets
    return [(one.name, one.line, one.tool, one.base) for one in found]


# --- languages ------------------------------------------------------------------------------------


def test_krl_leaves_what_it_computes():
    """Each motion whose target the controller works out is named with its line, and the reason."""
    text = f"""DEF p()
LIN_REL {{Z 10.0}}
LIN XP1:{{X 1,Y 2}}
LIN {{X 100.0}}
LIN {{X IX,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}}
LIN XP2
LIN XP3
LIN XP4
$IPO_MODE=#TCP
LIN {{{POSE}}}
$IPO_MODE=#BASE
LIN {{{POSE}}}
XP3.Z=XP3.Z+1
END
"""
    dat = f"DEFDAT p\nDECL E6POS XP3={{{POSE}}}\nDECL POS XP4={{{POSE}}}\nENDDAT\n"

    assert said("p.src", text, ("p.dat", dat)) == [
        (2, "LIN_REL moves by a distance"),
        (3, "XP1:{X 1,Y 2} is computed at run time"),
        (4, "the target in line 4 has no Y, Z, A, B, C of its own"),
        (5, "the target in line 5 is computed at run time"),
        (6, "XP2 is not in this program"),
        (10, f"{{{POSE}}} moves the workpiece at a fixed tool"),
    ]
    assert said("p.dat", dat, ("p.src", text)) == [(2, "XP3 is changed at run time on line 13")]
    assert [line for _, line, *_ in targets("p.src", text)] == [12]
    with pytest.raises(InputError, match=r"p\.dat:2: none of its targets can be corrected: XP3 is"):
        read("p.dat", dat.partition("DECL POS")[0].encode(), ("p.src", text.encode()))


def test_krl_frames_are_those_in_force():
    """The last assignment in the text holds, of whatever kind; a computed frame is no frame."""
    lines = [
        "$BASE=BASE_DATA[3]", "$TOOL=TOOL_DATA[2]", f"LIN {{{POSE}}}",
        "BAS(#TOOL,7)", f"LIN {{{POSE}}}",
        "FDAT_ACT=FP9", f"LIN {{{POSE}}}",
        "$BASE={X 1.0,Y 2,Z 3,A 0,B 0,C 90}", f"LIN {{{POSE}}}",
        "$BASE=BASE_DATA[1]:FR", f"LIN {{{POSE}}}", "$BASE.X=10", f"LIN {{{POSE}}}",
        "$BASE=$NULLFRAME", f"LIN {{{POSE}}}",
    ]  # fmt: skip
    dat = "DECL FDAT FP9={TOOL_NO 4,BASE_NO 5,IPO_FRAME #BASE}\n"
    dat += "BASE_DATA[5]={X 7,Y 0,Z 0,A 0,B 0,C 0}"
    found = read("p.src", "\n".join(lines).encode(), ("p.dat", dat.encode()))

    assert [(one.tool, one.base) for one in found.targets] == [
        ("2", "3"), ("7", "3"), ("4", "5"), ("4", "line 8"), ("4", "0"),
    ]  # fmt: skip
    assert found.bases["line 8"][:3, 3] == pytest.approx([1e-3, 2e-3, 3e-3])
    assert found.bases["line 8"][:2, 0] == pytest.approx([1, 0])
    assert found.bases["5"][0, 3] == 7e-3
    assert set(found.bases) == {"5", "line 8", "0"}


def test_points_of_a_dat_alone_are_targets_and_frames_are_none():
    """Without its .src nothing says which are used: all points are, tables and frames are not."""
    dat = f"DECL FRAME TABLE={{X 1,Y 2,Z 3,A 0,B 0,C 0}}\nDECL POS XP1={{{POSE},S 2,T 0}}\n"
    dat += (
        "DECL E6AXIS H={A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0,E1 5}\nLOAD_DATA[1]={M 5,CM {X 0,Y 0}}\n"
    )

    assert [name for name, *_ in targets("p.dat", dat)] == ["XP1", "H"]


POINT = "[[1200,0,800.5],[0,0,1,0],[0,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def test_rapid_leaves_what_it_computes():
    """Offsets, displacements, points that are changed and unknown motions are named by line."""
    text = f"""MODULE M
CONST robtarget p1:={POINT};
VAR robtarget p2:={POINT};
PERS tooldata tA:=[TRUE,[[0,0,200],[1,0,0,0]],[1,[0,0,0],[1,0,0,0],0,0,0]];
PERS tooldata tB:=[FALSE,[[0,0,200],[1,0,0,0]],[1,[0,0,0],[1,0,0,0],0,0,0]];
PROC main()
MoveL Offs(p1,0,0,1),v1,z1,tA;
MoveL p1,v1,z1,tA;
MoveL p2,v1,z1,tA;
PDispSet pose1;
MoveL {POINT},v1,z1,tA;
PDispOff;
MoveL {POINT},v1,z1,tA;
MovePnP p1,v1,z1,tA;
MoveL pGone,v1,z1,tA;
TriggIO gun,0\\DOp:=do1,1;
moved:=TRUE; IF moved THEN displ:=1; ENDIF
MoveHome(3);
MoveL CRobT(),v1,z1,tA;
p2.trans.z:=3;
ENDPROC
"""
    found = read("m.mod", text.encode())

    assert said("m.mod", text) == [
        (3, "p2 is changed at run time on line 20"),
        (7, "Offs(p1,0,0,1) is computed at run time"),
        (11, f"{POINT} is displaced by the program"),
        (14, "MovePnP is no motion known here"),
        (15, "pGone is not in this program"),
        (19, "CRobT() is computed at run time"),
    ]
    assert [one.line for one in found.targets] == [2, 13]
    assert set(found.tools) == {"tool0", "ta"}
    assert found.tools["ta"][2, 3] == 0.2


def test_configurations_of_rapid_hold_unless_they_are_switched_off():
    """ConfL frees linear motions and ConfJ the others; On takes it back."""
    move = f"{{}} {POINT},v1,z1,tool0;\n"
    text = move.format("MoveL") + "ConfL\\Off;\n" + move.format("MoveL") + move.format("MoveJ")
    text += "ConfJ \\Off;\n" + move.format("MoveJ") + "CONFL \\On;\n" + move.format("movel")
    found = read("m.mod", text.encode())

    assert [len(one.ranges) for one in found.targets] == [6, 0, 6, 0, 6]
    assert not found.left


def test_a_point_with_two_tools_has_no_one_correction():
    """A robtarget that two motions use with different frames is left, and both are named."""
    text = f"CONST robtarget p1:={POINT};\nMoveL p1,v1,z1,tA;\nMoveL p1,v1,z1,tB\\WObj:=w;\n"
    text += f"MoveL {POINT},v1,z1,tA;"

    assert said("m.mod", text) == [
        (1, "p1 is used with different tools or frames (ta in wobj0, tb in w)")
    ]


def test_tp_leaves_increments_offsets_and_registers():
    """A distance is no place, a register is known at run time, an untaught point has no numbers."""
    text = """/PROG T
/MN
   1:J P[1] 100% FINE ;
   2:L P[2] 5mm/sec FINE INC ;
   3:L P[3] 5mm/sec
    :  FINE Tool_Offset,PR[1] ;
   4:L PR[7] 5mm/sec FINE ;
   5:L P[R[1]] 5mm/sec FINE ;
   6://L P[3] 5mm/sec FINE ;
   7:L P[4] 5mm/sec FINE ;
/POS
"""
    pose = "P[{}]{{\n GP1:\n UF : 1, UT : 2, CONFIG : 'N U T, 0, 0, 0',\n"
    pose += " X = {} mm, Y = .000 mm, Z = 1.000 mm,\n W = .000 deg, P = 1.0 deg, R = 1.0 deg\n}};\n"
    text += "".join(pose.format(k, "********" if k == 4 else "5.000") for k in (1, 2, 3, 4))

    assert said("t.ls", text) == [
        (4, "P[2] is a distance"),
        (5, "Tool_Offset moves the point at run time"),
        (7, "PR[7] is known at run time only"),
        (8, "P[R[1]] is known at run time only"),
        (30, "P[4] has no X"),
    ]
    assert targets("t.ls", text) == [("P[1]", 12, "2", "1")]


def test_urscript_leaves_what_it_computes():
    """Variables that change, expressions and speeds are named; a list of poses is one each."""
    text = """def p():
  a = p[0.4,0.2,0.3,0,3.14,0]
  b = pose_add(a, p[0,0,0.1,0,0,0])
  c = p[0.4,0.2,0.3,0,3.14,0]
  c[2] = 0.5
  many = [p[0.4,0.2,0.3,0,3.14,0], p[0.4,0.2,0.35,0,3.14,0]]
  movel(a, a=1.2)
  movel(b)
  movel(c)
  movel(p[0.1,0.2,0.3,0,d2r(90),0])
  movel(many[i])
  speedl([0,0,0.1,0,0,0], 0.5, 1)
  movej(get_inverse_kin(a, qnear=[0,-1,1,-1,-1,0]))
end
"""

    assert said("p.script", text) == [
        (4, "c is changed at run time on line 5"),
        (8, "b is computed at run time"),
        (10, "the target in line 10 is computed at run time"),
        (12, "speedl has a speed and no target"),
    ]
    assert [one[:2] for one in targets("p.script", text)] == [
        ("a", 2),
        ("many[0]", 6),
        ("many[1]", 6),
    ]


@pytest.mark.parametrize(
    ("old", "value", "new"),
    [
        ("100.0", 100.234, "100.234"),
        ("100", 100.0004, "100"),
        ("5.", 5.0, "5."),
        ("-0.0", 0.0004, "-0.0"),
        ("100", 99.876, "99.876"),
        ("'H64'", 99.876, "99.876"),
        ("'B1100100'", 100.0001, "'B1100100'"),
        ("1234.567", 1234.5678, "1234.568"),
        ("-.500", -0.49844, "-.498"),
        (".250", -0.0004, ".000"),
        ("0.250", 1.2499, "1.250"),
        ("+5.00", 5.0166, "+5.017"),
        ("+0.01", -0.25, "-0.250"),
        ("5.", 5.26, "5.260"),
        ("0.000", 0.0004, "0.000"),
        ("0.000", -0.0004, "0.000"),
        ("1.20000E+03", 1200.4567, "1.200457E+03"),
        ("-1.2e-4", -1.26e-4, "-1.3e-4"),
    ],
)
def test_numbers_keep_their_manner(old, value, new):
    """Decimals or as many as a micrometre takes, sign, missing zero, exponent; else untouched."""
    assert _rewritten(old, value, 1e-3) == new


@pytest.mark.parametrize("notation", [KUKA, FANUC, ABB, UR])
def test_numbers_of_a_pose_come_back_nearest_to_what_stood_there(notation):
    """Of all numbers that mean a turn, those a hair from the old ones; level arms included."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        turn = pin.exp3(rng.normal(0, 2, 3))
        count = 4 if notation is ABB else 3
        old = rng.normal(0, 2, count) if notation in (ABB, UR) else rng.uniform(-360, 360, 3)
        if notation is ABB:
            old /= np.linalg.norm(old)
        before = notation.frame([1.0, 2.0, 3.0, *old])
        small = pin.exp3(rng.normal(0, 1e-5, 3))
        after = before.copy()
        after[:3, :3] = small @ before[:3, :3]
        new = notation.values(after, [1.0, 2.0, 3.0, *old])

        assert notation.frame(new) == pytest.approx(after, abs=1e-12)
        assert notation.frame(new)[:3, :3] != pytest.approx(turn)
        if notation in (ABB, UR) or abs(np.sin(np.deg2rad(old[1]))) < 0.99:
            assert new[3:] == pytest.approx(old, abs=0.1)


# --- on a robot -----------------------------------------------------------------------------------


@pytest.fixture
def kuka(tmp_path):
    """A root with the model of a KR500 on its rail, its truth and a way to correct a text."""
    bending = identified(tmp_path, KR)

    def correct(text, file="p.src", **given):
        (tmp_path / file).write_bytes(text.encode())
        data, remarks = program(
            tmp_path,
            KR.name,
            tmp_path / file,
            CorrectionOptions(**{"force": "600,-800,-900"} | given),
        )
        return unstamped(data).decode(), remarks

    correct.root, correct.bending = tmp_path, bending
    return correct


def pose_at(bending, q, tool=None, world=None):
    """A KRL pose of the tool in a frame, with all digits."""
    at = (world or pin.SE3.Identity()).inverse() * bending.flange(q) * (tool or pin.SE3.Identity())
    c, b, a = np.rad2deg(pin.rpy.matrixToRpy(at.rotation))
    numbers = [*(1e3 * at.translation), a, b, c]
    words = (f"{k} {v:.7f}" for k, v in zip("XYZABC", numbers, strict=True))
    return f"LIN {{{','.join(words)},E1 {1e3 * q[0]:.4f}}}\n"


Q = KR.controller_matrix @ np.array([3.0, *np.deg2rad([10, -70, 100, 20, 40, -30])])
Q = Q + KR.controller_offset
NO_TOOL = {"tool": ["0,0,0,0,0,0"], "base": ["0,0,0,0,0,0"]}


def test_world_and_flange_of_the_controller_are_where_they_are_said(kuka):
    """The same pose in a world and at a flange that are turned: the same correction in F_b."""
    world = pin.SE3(pin.utils.rotate("z", 0.5), np.array([0.2, 0.1, 0.67]))
    flange = pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3))
    letters = "200,100,670,28.64788975654116,0,0"
    plain, _ = kuka(pose_at(kuka.bending, Q), start=START, **NO_TOOL)
    turned, _ = kuka(
        pose_at(kuka.bending, Q, flange, world),
        start=START,
        world=letters,
        flange="0,0,0,180,0,0",
        **NO_TOOL,
    )
    first, second = (xyz(text) for text in (plain, turned))

    assert world.act(1e-3 * second) == pytest.approx(1e-3 * first, abs=1e-9)


def xyz(text):
    """X, Y, Z of the first point [mm]."""
    return np.array([float(word.split()[1]) for word in text.partition("{")[2].split(",")[:3]])


def test_a_force_in_the_tool_frame_turns_with_the_tool(kuka):
    """What the tool feels along its own z is the same as the force in F_b that it means."""
    tool = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.1])), np.array([0.05, 0.0, 0.3]))
    c, b, a = np.rad2deg(pin.rpy.matrixToRpy(tool.rotation))
    given = {"tool": [f"50,0,300,{a!r},{b!r},{c!r}".replace("np.float64(", "").replace(")", "")]}
    given |= {"base": ["0,0,0,0,0,0"], "start": START}
    text = pose_at(kuka.bending, Q, tool)
    force = (kuka.bending.flange(Q) * tool).rotation @ np.array([0.0, 0.0, -1000.0])
    in_tool, _ = kuka(text, force="0,0,-1000", frame=ForceFrame.TOOL, **given)
    in_base, _ = kuka(text, force=",".join(map(repr, force.tolist())), **given)

    assert xyz(in_tool) == pytest.approx(xyz(in_base), abs=2e-7)
    assert np.linalg.norm(xyz(in_tool) - xyz(text)) > 0.2


def test_what_nothing_says_is_asked(kuka):
    """Tool, frame, carriage and arm configuration: each with the line and the option to type."""
    text = pose_at(kuka.bending, Q)
    numbered = "$TOOL=TOOL_DATA[4]\n" + text
    without_rail = text.partition(",E1")[0] + "}\n"

    for given, wrong in (
        ({"start": START}, r"p.src:1: the target in line 1: its tool is not defined; "
         r"give it as --tool X,Y,Z,A,B,C\."),
        ({"start": START, "tool": NO_TOOL["tool"]}, r"its frame is not defined; .* --base X,Y"),
        (NO_TOOL, r"2 arm configurations reach it.*--start"),
    ):  # fmt: skip
        with pytest.raises(Refusal, match=wrong):
            kuka(text, **given)
    with pytest.raises(
        Refusal, match=r"p.src:2: .* tool 4 is not defined; give it as --tool 4=X,Y"
    ):
        kuka(numbered, start=START, base=NO_TOOL["base"])
    with pytest.raises(Refusal, match=r"the position of E1 is not stated"):
        kuka(without_rail, **NO_TOOL)
    with pytest.raises(UsageError, match="--force FX,FY,FZ"):
        kuka(text, force=None)
    with pytest.raises(UsageError, match="--start has 2 numbers: give E1, A1"):
        kuka(text, start="1,2", **NO_TOOL)
    with pytest.raises(UsageError, match='--tool "1,2": give 6 finite numbers'):
        kuka(text, tool=["1,2"])


def test_the_turn_that_a_point_states_is_held_to(kuka):
    """T picks the configuration without any start; one that no configuration has is refused."""
    bits = sum(int(axis < 0) << k for k, axis in enumerate([10, -70, 100, 20, 40, -30]))
    text = pose_at(kuka.bending, Q).replace(",E1", f",S 2,T {bits},E1")
    stated, _ = kuka(text, **NO_TOOL)
    started, _ = kuka(pose_at(kuka.bending, Q), start=START, **NO_TOOL)

    assert xyz(stated) == pytest.approx(xyz(started), abs=1e-6)
    wrong = text.replace(f"T {bits}", f"T {bits ^ 0b111111}")
    said = rf"no arm configuration that reaches it is the one it states: .*\(T {bits}\)"
    with pytest.raises(Refusal, match=said):
        kuka(wrong, **NO_TOOL)
    with pytest.raises(Refusal, match=r"p.src:2: .* the one it states"):
        kuka(text + wrong.replace("LIN", "PTP"), **NO_TOOL)
    straight, _ = kuka(text + wrong, **NO_TOOL)  # LIN keeps the configuration, whatever T says
    assert xyz(straight.splitlines()[1]) == pytest.approx(xyz(stated), abs=1e-6)


def test_a_stretched_arm_is_refused_where_it_is_a_pose_and_told_where_it_is_axes(kuka):
    """Stretched along the rail the arm cannot give back what the carriage's spring gives way."""
    stretched = [9.0, *np.deg2rad([90, 0, np.rad2deg(np.arctan2(0.055, 1.525)), 20, 40, -30])]
    q = KR.controller_matrix @ np.array(stretched) + KR.controller_offset
    given = {"force": "0,3000,0", "start": "9000,90,0,2.0656,20,40,-30", **NO_TOOL}
    joints = "PTP {A1 90.0,A2 0.0,A3 2.0656,A4 20.0,A5 40.0,A6 -30.0,E1 9000}\n"
    deflection = r"p\.src:1: the target in line 1: .*singularity.* 0\.02\d mm .*--partial"

    with pytest.raises(Refusal, match=r"p.src:1: .*the robot is at a singularity.* 0\.02\d mm"):
        kuka(pose_at(kuka.bending, q), **given)
    with pytest.raises(Refusal, match=deflection):
        kuka(joints, **given)
    _, remarks = kuka(joints, partial=True, **given)
    assert any("p.src:1: the target in line 1: the robot is at a singularity" in r for r in remarks)


def test_a_level_wrist_is_corrected_without_a_swing(kuka):
    """With axis 5 near zero, axes 4 and 6 turn alike: neither is asked to turn for the other."""
    joints = (
        "PTP {A1 10.00000,A2 -70.00000,A3 100.00000,A4 20.00000,A5 0.01000,A6 -30.00000,E1 3000}"
    )
    text, remarks = kuka(joints + "\n")
    axes = np.array([float(word.split()[1]) for word in text.partition("{")[2].split(",")[:6]])

    assert np.abs(axes - [10, -70, 100, 20, 0.01, -30]).max() < 1.0
    assert not any("singularity" in remark for remark in remarks)


def test_every_line_that_is_wrong_is_said_and_nothing_is_written(kuka, capsys):
    """Exit code 5, a line for each target out of reach, no file, an old one as it was."""
    far = "LIN {X 9000.0,Y 0,Z 0,A 0,B 0,C 0,E1 3000}\n"
    low = "PTP {A1 0.0,A2 40.0,A3 100.0,A4 0.0,A5 10.0,A6 0.0,E1 3000}\n"
    text = pose_at(kuka.bending, Q) + far + pose_at(kuka.bending, Q) + low + far
    (kuka.root / "p.src").write_text(text)
    out = kuka.root / "out.src"
    out.write_text("old")
    words = ["compensate", KR.name, str(kuka.root / "p.src"), "--force", "0,0,-900"]
    words += ["--start", START, "--tool", "0,0,0,0,0,0", "--base", "0,0,0,0,0,0"]
    code = cli._exit_code([*words, "--output", str(out), "--root", str(kuka.root)])
    seen = capsys.readouterr()

    assert code == 5
    assert out.read_text() == "old"
    assert seen.out == ""
    lines = seen.err.splitlines()
    assert [line.split(": ")[0] for line in lines] == ["p.src:2", "p.src:4", "p.src:5"]
    assert "the robot cannot reach it" in lines[0]
    assert "theta3 is 20.00 deg beyond its limit" in lines[1]


def test_a_program_goes_to_stdout_byte_by_byte(kuka, capfdbinary):
    """Without --output the bytes are those of the file, umlauts and line ends as they are."""
    text = "; Fräser\r\n" + pose_at(kuka.bending, Q).replace("\n", "\r\n")
    (kuka.root / "p.src").write_bytes(text.encode("cp1252"))
    words = [
        "compensate",
        KR.name,
        str(kuka.root / "p.src"),
        "--force",
        "0,0,-900",
        "--start",
        START,
    ]
    words += ["--tool", "0,0,0,0,0,0", "--base", "0,0,0,0,0,0", "--root", str(kuka.root)]

    assert cli._exit_code(words) == 0
    out, told = capfdbinary.readouterr()
    out = unstamped(out)
    assert out.startswith(b"; Fr\xe4ser\r\nLIN {X ")
    assert out.endswith(b",E1 3000.0000}\r\n")
    assert len(out) == pytest.approx(len(text), abs=6)
    assert b"1 points: the load moves the tip" in told


def test_the_other_file_of_a_program_is_read_and_named(kuka):
    """A .src whose points stand in its .dat has none to correct, and says where they are."""
    (kuka.root / "q.dat").write_text(pose_at(kuka.bending, Q).replace("LIN ", "DECL E6POS XP1="))
    given = {"start": START, **NO_TOOL}
    both, remarks = kuka("LIN XP1\n" + pose_at(kuka.bending, Q), file="q.src", **given)

    assert both.startswith("LIN XP1\nLIN {X ")
    assert "q.dat has targets of this program, too: correct it as well." in remarks
    with pytest.raises(InputError, match=r"q\.src: contains no motion.*; correct q\.dat"):
        kuka("LIN XP1\n", file="q.src", **given)


def standing_at(bending, numbers, joint):
    """Joint values that a controller takes for six axes or for a pose."""
    if joint:
        axes = np.array([3.0, *np.deg2rad(numbers)])
        return KR.controller_matrix @ axes + KR.controller_offset
    return bending.commanded(frame("abc", numbers), Q)


@pytest.mark.parametrize("text", ["PTP {A1 10,A2 -70,A3 100,A4 20,A5 40,A6 -30,E1 3000}\n", None])
def test_whole_numbers_get_the_digits_that_the_correction_takes(kuka, text):
    """The loaded tool of a point in whole degrees or millimetres is a micrometre from its place."""
    given = {"start": START, **NO_TOOL}
    whole = re.sub(r"\.\d+", "", pose_at(kuka.bending, Q))
    corrected, remarks = kuka(text or whole, **given)
    taught, new = (
        [float(word.split()[1]) for word in one.partition("{")[2].split(",")[:6]]
        for one in (text or whole, corrected)
    )
    force = np.array([600.0, -800.0, -900.0])
    taught, new = (standing_at(kuka.bending, one, text is not None) for one in (taught, new))
    there = kuka.bending.flange(taught).translation
    before, after = (kuka.bending.loaded(q, force, 0 * TIP).translation for q in (taught, new))

    assert np.linalg.norm(before - there) > 2e-4
    assert np.linalg.norm(after - there) < 2e-6
    assert not any("digits" in one for one in remarks)


@pytest.mark.parametrize(
    ("file", "data", "wrong"),
    [
        ("p.src", "LIN {X 1}".encode("utf-16"), ": is UTF-16 or no text"),
        ("p.src", b"DEF p()\nEND\n", ": contains no motion to a target with coordinates"),
        ("p.script", b"movel(p[0,0,0,0,0,0)", ":1: none of its targets can be corrected"),
        (
            "p.mod",
            b"MoveL [[0,0,0],[0,0,0",
            ":1: none of its targets can be corrected: the motion has",
        ),
        ("p.ls", b"/POS\nP[1]{", r":2: none of its targets can be corrected: P\[1\] is no motion"),
    ],
)
def test_what_is_no_program_is_refused(file, data, wrong):
    """One sentence with the file, whatever stands in it."""
    with pytest.raises(InputError, match=f"{file}{wrong}"):
        read(file, data)


@pytest.mark.parametrize(
    ("file", "data"),
    [
        ("p.mod", "CONST robtarget p:=" + 3000 * "[" + 3000 * "]" + ";\nMoveL p,v,z,t;"),
        ("p.mod", 2000 * "MoveL ["),
        ("p.mod", f"MoveL {POINT.replace('1200', '1e999')},v1,z1,tool0;"),
        ("p.script", "movel(" + 3000 * "[" + 3000 * "]" + ")"),
        ("p.script", "movel(p[1e999,0,0,0,0,0])"),
        ("p.src", "LIN " + 3000 * "{" + 3000 * "}"),
        ("p.src", f"LIN {{{POSE.replace('2000.0', '1E999')}}}"),
        ("p.ls", "/MN\n 1:L P[1] 5mm/sec FINE ;\n/POS\n" + 3000 * "P[1]{"),
    ],
)
def test_what_nobody_would_write_is_refused_soon(file, data):
    """Brackets without end and numbers without limit: one sentence, in a second."""
    began = time.process_time()
    with pytest.raises(InputError):
        read(file, data.encode())

    assert time.process_time() - began < 5.0


def test_a_tool_without_a_direction_is_none(kuka):
    """Four zeros are no quaternion, in a program or in an option."""
    text = "PERS tooldata t:=[TRUE,[[0,0,1],[0,0,0,0]],[1,[0,0,0],[1,0,0,0],0,0,0]];\n"
    text += f"MoveL {POINT},v1,z1,t;"

    assert "t" not in read("p.mod", text.encode()).tools
    with pytest.raises(UsageError, match='--tool "0,0,0,0,0,0,0": the quaternion has no length'):
        kuka(text, file="p.mod", tool=["t=0,0,0,0,0,0,0"])


def test_a_program_of_another_arm_is_refused(tmp_path):
    """Six axes for a robot of seven that turn: nobody knows which."""
    from pipeline.machine.robot.mdh import parse

    text = load("ur10e").text.replace("[controller]", "[was]").partition("[was]")[0]
    extra = '[[joint]]\nname = "theta7"\ntype = "revolute"\nalpha_deg = 0\nd_m = 0.1\n'
    robot = parse(text.replace('name = "ur10e"', 'name = "seven"', 1) + extra, "seven.toml")
    identified(tmp_path, robot)
    (tmp_path / "p.script").write_text("movej([0,0,0,0,0,0])\n")

    with pytest.raises(UsageError, match="for an arm of 6 axes and seven has 7"):
        program(tmp_path, "seven", tmp_path / "p.script", CorrectionOptions(force="0,0,1"))


def test_a_target_at_its_limit_is_refused_where_it_would_leave_it(kuka):
    """Axis 2 stands at +20 deg: pushed one way it has to go beyond, pushed the other way not."""
    text = "PTP {A1 10.0,A2 20.0,A3 60.0,A4 20.0,A5 40.0,A6 -30.0,E1 3000}\n"
    up, down = "0,0,14000", "0,0,-14000"
    refused = []
    for force in (up, down):
        try:
            kuka(text, force=force, start=START, **NO_TOOL)
        except Refusal as wrong:
            refused.append(str(wrong))

    (said,) = refused
    assert "p.src:1: the target in line 1: corrected, joint theta3 is 0." in said


def test_joints_near_a_pose_say_which_arm_is_meant(tmp_path):
    """get_inverse_kin with qnear needs no start, and each elbow has its own correction."""
    robot = load("ur10e")
    bending = identified(tmp_path, robot)
    up = np.array([0.3, -1.2, 1.4, -1.8, -1.5, 0.2])
    flange = bending.flange(up)
    down = bending.commanded(flange, np.array([0.3, 0.1, -1.4, -0.2, -1.5, 0.2]))
    pose = ", ".join(f"{v:.9f}" for v in (*flange.translation, *pin.log3(flange.rotation)))
    moved = []
    for q in (up, down):
        near = ", ".join(f"{v:.2f}" for v in q)
        text = f"movej(get_inverse_kin(p[{pose}], qnear=[{near}]))\n"
        (tmp_path / "p.script").write_text(text)
        given = CorrectionOptions(force="30,-20,-40", tool=["0,0,0,0,0,0"])
        data, _ = program(tmp_path, robot.name, tmp_path / "p.script", given)
        numbers = [
            float(v)
            for v in unstamped(data).decode().partition("p[")[2].partition("]")[0].split(",")
        ]
        commanded = pin.SE3(pin.exp3(np.array(numbers[3:])), np.array(numbers[:3]))
        there = bending.loaded(bending.commanded(commanded, q), np.array([30.0, -20, -40]), 0 * TIP)
        moved.append(np.array(numbers[:3]) - flange.translation)
        assert there.translation == pytest.approx(flange.translation, abs=3e-6)
        assert unstamped(data).decode().endswith(f"], qnear=[{near}]))\n")

    assert np.linalg.norm(down - up) > 1.0
    assert np.linalg.norm(moved[0] - moved[1]) > 1e-5


def test_the_arm_alone_corrects(kuka):
    """The rail's value stands as it stood, and the loaded tool stands where it was taught."""
    joints = (
        "PTP {A1 10.0000,A2 -70.0000,A3 100.0000,A4 20.0000,A5 40.0000,A6 -30.0000,E1 3000.0}\n"
    )
    text, _ = kuka(joints, tip=tuple(TIP), force="100,-2000,-200")
    axes = [float(word.split()[1]) for word in text.partition("{")[2].split(",")[:6]]
    q = KR.controller_matrix @ np.array([3.0, *np.deg2rad(axes)]) + KR.controller_offset
    robot = BendingRobot(KR, kuka.bending.stiffness)
    force = np.array([100.0, -2000.0, -200.0])  # the rail gives way by 25 um
    tool = pin.SE3(np.eye(3), TIP)
    there = (robot.flange(Q) * tool).translation

    assert text.endswith(",E1 3000.0}\n")
    before = (robot.loaded(Q, force, TIP) * tool).translation - there
    after = (robot.loaded(q, force, TIP) * tool).translation - there
    assert np.linalg.norm(before) > 1e-3
    assert np.linalg.norm(after) < 8e-6
