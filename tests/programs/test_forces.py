"""The force at each target of a program: remarks, a table, cuts; and what they do on a robot."""

import re

import numpy as np
import pytest
from test_programs import TIP, identified, unstamped

from pipeline.app import cli
from pipeline.base.errors import InputError, UsageError
from pipeline.machine.robot import load
from pipeline.programs import read
from pipeline.programs.forces import stated, tabled
from pipeline.programs.on_disk import CorrectionOptions, program

KR = load("kr500_rail")
START = "3000,10,-70,100,20,40,-30"
TOOL = f"0,0,{1e3 * TIP[2]},0,0,0"
POSES = [f"X {2000 + 50 * k}.0,Y 3000.0,Z 1500.0,A 10.0,B 60.0,C 5.0" for k in range(5)]
SRC = f"""DEF p ( )
$TOOL=TOOL_DATA[1]
$BASE=$NULLFRAME
LIN {{{POSES[0]}}}
; FORCE 0, 0, -800
LIN {{{POSES[1]}}}
LIN XP3
;FORCE OFF
LIN {{{POSES[3]}}}
; CUT kc=1000 depth=2 feed=0.2 axial=0.5
LIN {{{POSES[4]}}}
END
"""  # fmt: skip
DAT = f"DEFDAT p\nDECL E6POS XP3={{{POSES[2]}}}\nENDDAT\n"
FILES = {"p.src": SRC, "p.dat": DAT}


def targets(files=FILES, file="p.src"):
    """Targets of a program of two files."""
    other = [(name, text.encode()) for name, text in files.items() if name != file]
    return read(file, files[file].encode(), *other).targets


def test_a_remark_holds_from_its_line_to_the_next():
    """Also for a point that is declared elsewhere: the line of its motion counts."""
    found = stated(FILES, targets())

    assert [one.line for one in found.each] == [0, 5, 5, 8, 10]
    assert [one.force.tolist() for one in found.each[:4]] == [
        [0, 0, 0], [0, 0, -800], [0, 0, -800], [0, 0, 0],
    ]  # fmt: skip
    assert found.each[4].cut == (400.0, 200.0)
    assert stated({"p.src": "DEF p()\n;forced by hand\nEND\n"}, ()) is None


LANGUAGES = {
    "p.mod": (
        "MODULE M\nCONST robtarget a:={0};\nCONST robtarget b:={0};\nPROC main()\n"
        "MoveL a,v100,fine,tool0;\n! FORCE 10,-20.5,3e1\nMoveL b,v100,fine,tool0;\n"
        "! FORCE OFF\nMoveL {0},v100,fine,tool0;\nENDPROC\nENDMODULE\n"
    ).format("[[1200,0,800],[0,0,1,0],[0,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"),
    "p.ls": (
        "/PROG P\n/MN\n   1:L P[1] 100mm/sec FINE ;\n   2:  !FORCE 10,-20.5,30 ;\n"
        "   3:L P[2] 100mm/sec FINE ;\n   4:  !FORCE OFF ;\n   5:L P[3] 100mm/sec FINE ;\n/POS\n"
        + "".join(
            f"P[{k}]{{\n   GP1:\n\tUF : 0, UT : 1,\tCONFIG : 'N U T, 0, 0, 0',\n\tX = 1200.0 mm,"
            f"\tY = {k}.0 mm,\tZ = 800.0 mm,\n\tW = 180.0 deg,\tP = 0.0 deg,\tR = 0.0 deg\n}};\n"
            for k in (1, 2, 3)
        )
        + "/END\n"
    ),
    "p.script": (
        "def p():\n  a = p[0.5,0.1,0.4,0,3.1,0]\n  movel(p[0.5,0.0,0.4,0,3.1,0], a=1, v=0.1)\n"
        "  # FORCE 10 -20.5 30\n  movel(a, a=1, v=0.1)\n  # FORCE OFF\n"
        "  movel(p[0.5,0.2,0.4,0,3.1,0], a=1, v=0.1)\nend\n"
    ),
}


@pytest.mark.parametrize("file", LANGUAGES)
def test_each_language_has_its_sign(file):
    """No force, a force, no force, in the order of the motions."""
    text = LANGUAGES[file]
    found = stated({file: text}, read(file, text.encode()).targets)

    assert [one.force.tolist() for one in found.each] == [[0, 0, 0], [10, -20.5, 30], [0, 0, 0]]


@pytest.mark.parametrize(
    "said",
    ["FORCE 0,0", "FORCE 0,0,x", "FORCE on", "CUT kc=1000 depth=2", "CUT kc=0 depth=1 feed=1",
     "CUT kc=1000 depth=2 feed=0.2 width=3", "FORCE 1,2,3 N"],
)  # fmt: skip
def test_what_is_no_force_is_named_by_its_line(said):
    """A remark that begins like one and cannot be read is no remark that may be passed over."""
    text = SRC.replace("FORCE 0, 0, -800", said)
    with pytest.raises(InputError, match=r"^p\.src:5: .* is no force; write FORCE fx"):
        stated({"p.src": text}, targets(FILES))


def test_a_point_of_two_sections_is_refused():
    """One taught point cannot be corrected for two forces."""
    files = FILES | {"p.src": SRC.replace("END\n", "LIN XP3\nEND\n")}
    with pytest.raises(InputError, match="XP3 is moved to in sections of different forces"):
        stated(files, targets(files))


def test_a_table_has_a_row_for_each_target_with_a_force():
    """Targets that are not in it have none; a row of none is named by its line."""
    table = b"target;fx_n;fy_n;fz_n\nXP3;0;0;-700,5\n"
    found = tabled("f.csv", table, targets())

    assert [one.force.tolist() for one in found.each].count([0, 0, 0]) == 4
    assert found.each[2].force.tolist() == [0, 0, -700.5]
    with pytest.raises(InputError, match=r'f\.csv:2: the program has no target "xp4"'):
        tabled("f.csv", table.replace(b"XP3", b"XP4"), targets())


def corrected(tmp_path, files, **options):
    """A program after its correction, and what was said."""
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    given = CorrectionOptions(tool=[f"1={TOOL}"], start=START, **options)
    data, told = program(tmp_path, KR.name, tmp_path / "p.src", given)
    return unstamped(data).decode(), told


def test_each_section_is_corrected_as_by_its_force_alone(tmp_path):
    """Entry and exit stay to the letter; the others are as one force for all would move them."""
    identified(tmp_path, KR)
    inline = {"p.src": SRC.replace("LIN XP3", f"LIN {{{POSES[2]}}}")}
    bare = {"p.src": re.sub(r"(?m)^; ?(FORCE|CUT).*\n", "", inline["p.src"])}
    text, _ = corrected(tmp_path, inline)
    alone, _ = corrected(tmp_path, bare, force="0,0,-800")
    along = np.array([50.0, 0.0, 0.0]) / 50.0
    mine, one_force = ([one for one in each.splitlines() if one.startswith("LIN")]
                       for each in (text, alone))  # fmt: skip

    assert mine[0] == f"LIN {{{POSES[0]}}}"
    assert mine[3] == f"LIN {{{POSES[3]}}}"
    assert mine[1:3] == one_force[1:3]
    tilt = np.deg2rad(60.0)
    spin = np.deg2rad(10.0)
    axis = np.array([np.cos(spin) * np.sin(tilt), np.sin(spin) * np.sin(tilt), np.cos(tilt)])
    roll = np.deg2rad(5.0)
    a, b = (
        np.array([[np.cos(spin), -np.sin(spin), 0], [np.sin(spin), np.cos(spin), 0], [0, 0, 1]]),
        (np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])),
    )
    c = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    axis = (a @ b @ c)[:, 2]
    cut = ",".join(map(repr, (-400.0 * along - 200.0 * axis).tolist()))
    by_hand, _ = corrected(tmp_path, bare, force=cut)
    last = [one for one in by_hand.splitlines() if one.startswith("LIN")][4]
    numbers = [np.array(re.findall(r"[A-Z] ([-\d.]+)", one), float) for one in (mine[4], last)]
    assert numbers[0] == pytest.approx(numbers[1], abs=2e-3)


def test_forces_are_given_once(tmp_path):
    """On the command line or in the program; with neither the way out is said."""
    identified(tmp_path, KR)
    with pytest.raises(UsageError, match="given twice"):
        corrected(tmp_path, FILES, force="0,0,-800")
    bare = FILES | {"p.src": re.sub(r"(?m)^; ?(FORCE|CUT).*\n", "", SRC)}
    with pytest.raises(UsageError, match="says no forces: give --force"):
        corrected(tmp_path, bare)


def test_a_folder_is_corrected_into_another(tmp_path, capsys):
    """Each with its picture; one that cannot be is named, the others are written, exit code 5."""
    identified(tmp_path, KR)
    inside, out = tmp_path / "programs", tmp_path / "out"
    inside.mkdir()
    good = SRC.replace("LIN XP3\n", "")
    (inside / "good.src").write_text(good)
    (inside / "bad.src").write_text(good.replace("FORCE OFF", "FORCE of"))
    (inside / "notes.txt").write_text("no program")
    with pytest.raises(SystemExit) as ended:
        cli.main(["compensate", KR.name, str(inside), "--root", str(tmp_path), "--tool",
                  f"1={TOOL}", "--start", START, "--output", str(out)])  # fmt: skip

    assert ended.value.code == 5
    assert sorted(one.name for one in out.iterdir()) == ["good.src", "good.src.svg"]
    assert unstamped((out / "good.src").read_bytes()).count(b"LIN") == 4
    picture = (out / "good.src.svg").read_text()
    assert picture.startswith("<svg")
    assert "before: up to 0." in picture
    said = capsys.readouterr().err
    assert "bad.src:7" in said
    assert "1 of 2 programs are not corrected: bad.src" in said


def test_a_force_may_have_a_unit(tmp_path):
    """0.8 kN is 800 N, and a unit of something else is refused."""
    identified(tmp_path, KR)
    bare = FILES | {"p.src": re.sub(r"(?m)^; ?(FORCE|CUT).*\n", "", SRC)}

    assert (
        corrected(tmp_path, bare, force="0,0,-0.8 kN")[0]
        == (corrected(tmp_path, bare, force="0,0,-800")[0])
    )
    with pytest.raises(UsageError, match="give N or kN"):
        corrected(tmp_path, bare, force="0,0,-0.8 MN")
