"""Obstacles for a production engineer on the first day, each from the command to its end."""

import pypdfium2
import pytest
from conftest import with_little_effort

from pipeline.app import cli
from pipeline.base.errors import InputError
from pipeline.design import spec
from pipeline.fleet import pages
from pipeline.intake import command as asking
from pipeline.machine.robot import SHIPPED, load
from pipeline.readers import logs, read

OWN = load("kr210_r2700_2").text.replace('name = "kr210_r2700_2"', 'name = "own"')
PROBLEM = """
format = 1
name = "hall7"
robot = "own.toml"
[plan]
poses = 3
readings = 6
[pull]
steps_n = [1200.0, 2000.0]
[anchor]
x_m = 3.0
y_m = 1.0
z_m = 0.0
[criterion]
kind = "D"
[noise]
reading_sigma_m = 3e-5
[tool]
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]
"""


def typed(capsys, *words):
    """Exit code, stdout and stderr of a command."""
    code = cli._exit_code([str(word) for word in words])
    return code, *capsys.readouterr()


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    """A folder in which `pipeline design` was run for an own robot, robot file beside problem."""
    root = tmp_path_factory.mktemp("designed")
    (root / "hall").mkdir()
    (root / "hall" / "own.toml").write_text(OWN)
    (root / "hall" / "problem.toml").write_text(PROBLEM)
    with pytest.MonkeyPatch.context() as patch, with_little_effort():
        patch.chdir(root)
        assert cli._exit_code(["design", "hall/problem.toml", "--rounds", "1"]) == 0
    return root


@pytest.mark.whole
def test_the_commands_that_a_design_prints_work_for_an_own_robot(designed, monkeypatch, capsys):
    """Robot file beside the problem, plan in data/plans: simulated and initialised as printed."""
    monkeypatch.chdir(designed)
    plan = (designed / "data" / "plans" / "hall7.toml").read_text()
    commands = [
        line.partition(": ")[2].split()[1:] for line in plan.splitlines() if ": pipeline" in
        " ".join(line.split())
    ]  # fmt: skip

    for words in commands:
        name = "rehearsed" if words[0] == "simulate" else None
        more = ["--name", name] if name else []
        code, _, err = typed(capsys, *words, *more)
        assert code == 0, err

    assert [words[0] for words in commands] == ["simulate", "init"]
    prepared = designed / "data" / "raw" / "hall7"
    assert (prepared / "robot.toml").read_text() == OWN
    assert (prepared / "joints.csv").read_text().startswith("pose,A1_deg,")
    assert "simulated" not in (prepared / "campaign.toml").read_text()
    assert "simulated = true" in (designed / "data/raw/rehearsed/campaign.toml").read_text()
    assert "joints.csv has the poses of the plan" in err
    sheet = designed / "reports" / "plans" / "hall7"
    assert {one.name for one in (sheet / "program").iterdir()} == {"hall7.src", "hall7.dat"}


def test_a_robot_file_is_found_where_it_was_typed(tmp_path, monkeypatch, capsys):
    """A relative path refers to the current folder, and the campaign gets a copy."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hall").mkdir()
    (tmp_path / "hall" / "own.toml").write_text(OWN)

    code, _, err = typed(capsys, "init", "c", "--robot", "hall/own.toml")

    assert code == 0, err
    assert (tmp_path / "data/raw/c/own.toml").read_text() == OWN
    assert 'robot  = "own.toml"' in (tmp_path / "data/raw/c/campaign.toml").read_text().replace(
        "robot = ", "robot  = "
    )


def test_a_removed_campaign_is_on_no_page_and_its_measurements_are_kept(tmp_path, capsys):
    """Result and tables are deleted, the raw folder is moved; the same name twice is kept twice."""
    for again in range(2):
        typed(capsys, "simulate", "--name", "gone", "--root", tmp_path)
        typed(capsys, "simulate", "--name", "stays", "--root", tmp_path, "--force")
        folder = tmp_path / "data" / "raw" / "gone"
        held = {one.name: one.read_bytes() for one in folder.iterdir()}
        (tmp_path / "reports" / "gone").mkdir(parents=True)
        (tmp_path / "reports" / "gone" / "result.json").write_text("{}")

        code, out, err = typed(capsys, "remove", "gone", "--root", tmp_path)

        assert code == 0, err
        kept = tmp_path / "data" / pages.REMOVED / ("gone" if not again else "gone-2")
        assert {one.name: one.read_bytes() for one in kept.iterdir()} == held
        assert out.split() == [str(kept)]
        assert not folder.exists()
        assert not (tmp_path / "reports" / "gone").exists()
        assert not (tmp_path / "data" / "processed" / "gone").exists()
        assert (tmp_path / "data" / "raw" / "stays").is_dir()
    code, _, err = typed(capsys, "remove", "never", "--root", tmp_path)
    assert (code, "there is no campaign never" in err) == (2, True)


def test_the_robots_that_ship_are_listed_with_their_makers(capsys):
    """Name, maker and axes; one of them is printed as a file to start from."""
    _, out, _ = typed(capsys, "robot", "--list")
    _, shown, _ = typed(capsys, "robot", "--show", "irb6640")
    code, _, err = typed(capsys, "robot", "--show", "kr211")

    assert [line.split()[0] for line in out.splitlines()] == [*SHIPPED]
    assert "KUKA KR 210 R2700-2" in out
    assert "A1 A2 A3 A4 A5 A6" in out
    assert shown.rstrip("\n") == load("irb6640").text.rstrip("\n")
    assert (code, "--list" in err) == (2, True)


def test_the_only_correct_spelling_of_a_unit_is_taken(monkeypatch):
    """KN is kn; an invalid unit is asked for again."""
    answers = iter(["stone", "kN"])
    monkeypatch.setattr(asking, "_answer", lambda *_: next(answers))

    assert asking._one_of("Unit", ("n", "kn", "kgf")) == "kn"


@pytest.mark.parametrize("way", ["", "-"])
def test_a_reflector_out_of_reach_is_asked_again_and_said_again(way, monkeypatch, capsys):
    """210 is not metres on an effector, either way; the message shows what was understood."""
    answers = iter([f"{way}210 6 11", f"{way}210 6 11 mm"])
    monkeypatch.setattr(asking, "_answer", lambda *_: next(answers))

    found = asking._place("P1 in the flange frame, x y z [m]", logs.LENGTH, 20.0)

    assert found == pytest.approx((float(f"{way}0.21"), 0.006, 0.011))
    err = capsys.readouterr().err
    assert f"210 m is out of reach: write {way}210 6 11 mm" in err
    assert f"P1 = {way}0.21, 0.006, 0.011 m" in err


@pytest.mark.parametrize(
    "units", [";;kN", "Nr.;Nr.;[kN]", "hh:mm;-;kN", "-;#;(kN)", "dd.mm.yyyy;Nr;kN"]
)
def test_a_row_of_units_is_understood_as_people_write_it(units):
    """A column may describe its numbers instead of a unit; that row is not rejected."""
    text = f"pose;repeat;force\n{units}\n1;1;1,25\n2;1;2,5\n"

    log = logs.loads("loads.csv", text.encode())

    assert log.number["force"].tolist() == [1250.0, 2500.0]
    assert log.rejected == ()


def test_a_row_of_numbers_is_no_row_of_units():
    """A line below titles that have units is the first row."""
    log = logs.loads("loads.csv", b"pose;repeat;force_kn\n1;1;1,25\n2;1;2,5\n")

    assert log.number["force"].tolist() == [1250.0, 2500.0]


def test_a_force_of_the_criterion_is_told_from_that_of_a_pose():
    """The sentence says where a vector belongs."""
    with pytest.raises(InputError, match=r"one number.*\[\[test_pose\]\]"):
        spec.parse(PROBLEM.replace('kind = "D"', 'kind = "workspace"\nforce_n = [0, 0, -800]'))


@pytest.mark.whole
def test_a_plan_on_top_of_a_campaign_has_the_name_that_is_typed(tmp_path, monkeypatch, capsys):
    """`--name more --add-to practice` writes more.toml."""
    monkeypatch.chdir(tmp_path)
    typed(capsys, "simulate", "--name", "practice")
    with with_little_effort():
        code, _, err = typed(
            capsys, "design", "--add-to", "practice", "--name", "more", "--poses", 3,
            "--readings", 3, "--rounds", 1,
        )  # fmt: skip

    assert code == 0, err
    plans = sorted(one.name for one in (tmp_path / "data" / "plans").iterdir())
    assert plans == ["more.problem.toml", "more.toml"]


@pytest.mark.whole
def test_the_picture_of_a_pose_stands_on_its_page(designed):
    """Heading, axis values and figure of each pose are on one page of the sheet."""
    pdf = pypdfium2.PdfDocument(designed / "reports" / "plans" / "hall7" / "sheet.pdf")
    pages = [page.get_textpage().get_text_range() for page in pdf]
    everything = "\n".join(pages)

    for pose in range(1, 4):
        (own,) = [text for text in pages if f"Pose {pose}\r\nDrive to" in text]
        assert f"Pose {pose} from the side and from above" in own.partition(f"Pose {pose}\r")[2]
    assert everything.count("Axes read back") == 3
    assert "Operator" in everything
    assert everything.index("as the controller shows them") < everything.index("Annex")


def test_a_german_remark_states_the_unit_of_an_export():
    """`// Einheiten: mm` above the points in a file of SpatialAnalyzer."""
    rows = "\n".join(f"A::g::P{k}, {100 * k}.0, 200.0, {300 - k}.0" for k in range(1, 5))
    text = f"// SpatialAnalyzer ASCII, kartesisch\n// Einheiten: mm\n{rows}\n"

    export = read("points.txt", text.encode())

    assert export.position[:, 0].tolist() == pytest.approx([0.1, 0.2, 0.3, 0.4])
