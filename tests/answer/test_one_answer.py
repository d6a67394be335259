"""Terminal, page, PDF and programs all get the values of one and the same model."""

import contextlib
import html
import io
import json
import re
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from conftest import without_drawings
from fit_check import told_by_chi_square
from pdf_text import pages_of

from bench.as_pinocchio import model as pin_model
from bench.league.hidden import SECRETS
from bench.league.play import Rules, drawn, play
from pipeline.answer.archive import read
from pipeline.app import cli
from pipeline.base.quantities import plain
from pipeline.fleet.compare import compared
from pipeline.fleet.history import previous
from pipeline.fleet.trends import trends
from pipeline.library import compensate, model_file
from pipeline.machine.robot import load
from pipeline.prediction.path import Path
from pipeline.store.campaign import find

pytestmark = [pytest.mark.whole, pytest.mark.xdist_group("one_answer")]
"""One campaign of every verdict is run once."""

ROBOT = load("kr500_rail")
PLAN = (2026, 9, 1)


def files_of(label, size, seed):
    """Raw files of a machine of the league with a hidden cause, or none."""
    plan = drawn(ROBOT, np.random.default_rng(PLAN), Rules())
    hidden = [(SECRETS[label], size)] if label else []
    return play(ROBOT, plan, hidden, np.random.default_rng(seed), Rules()).files


def mistyped(files):
    """One load written ten times too large."""
    lines = files["loads.csv"].decode().splitlines()
    pose, repeat, force, branch = lines[10].split(",")
    lines[10] = f"{pose},{repeat},{10 * float(force):.2f},{branch}"
    return files | {"loads.csv": "\n".join([*lines, ""]).encode()}


CAMPAIGNS = {
    "adequate": lambda: files_of(None, 0.0, [1, 2]),
    "explained": lambda: files_of("rail_roll", 1.0, [1, 2]),
    "ambiguous": lambda: files_of("joint_tilt:5", 2.0, [1, 2]),
    "unexplained": lambda: files_of("chain_rubs", 2.0, [1, 3]),
    "bad_data": lambda: mistyped(files_of("rail_roll", 1.0, [1, 2])),
}
OTHER = "other"


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """A project with one campaign of every verdict, run by the command; its root and stdout."""
    root = tmp_path_factory.mktemp("verdicts")
    for name, files in {**CAMPAIGNS, OTHER: lambda: files_of(None, 0.0, [7, 7])}.items():
        folder = root / "data" / "raw" / name
        folder.mkdir(parents=True)
        for file, content in files().items():
            (folder / file).write_bytes(content)
    with without_drawings():
        return root, printed(root)


def printed(root, *words):
    """What `pipeline run` prints on stdout; 5, for one of them has a reading that is left out."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert cli._exit_code(["run", *words, "--engine", "local", "--root", str(root)]) == 5
    return out.getvalue()


@pytest.fixture(params=list(CAMPAIGNS))
def campaign(request, told):
    """One of them: its folder, its answer and the project's root."""
    found = find(told[0], request.param)
    answer = found.result()
    assert answer["diagnosis"]["verdict"] == request.param
    return found, answer, told[0]


def same_text(text):
    """A text without the spaces that are only typography."""
    return re.sub(r"\s+", " ", html.unescape(text).replace("\N{NBSP}", " "))


def stated(answer):
    """The stiffnesses that have a value, by name."""
    return {e["name"]: e for e in answer["stiffness"] if e["value"] is not None}


def test_each_campaign_stands_for_the_model_that_holds(told):
    """Model and data are those of the decision; the paper's model is given in addition."""
    answers = {name: find(told[0], name).result() for name in CAMPAIGNS}
    said = {
        name: (a["recommended"]["model"], a["recommended"]["data"]) for name, a in answers.items()
    }

    assert said == {
        "adequate": ("joint_springs", "as_given"),
        "explained": ("extended", "as_given"),
        "ambiguous": ("averaged", "as_given"),
        "unexplained": ("joint_springs", "as_given"),
        "bad_data": ("extended", "corrected"),
    }
    for name, answer in answers.items():
        same = answer["joint_springs"]["stiffness"] == answer["stiffness"]
        assert same == (name in ("adequate", "unexplained"))
    assert answers["explained"]["extended"]["stiffness"] == answers["explained"]["stiffness"]
    assert answers["adequate"]["extended"] is None
    (cause,) = (c for c in answers["explained"]["diagnosis"]["causes"] if c["gain"])
    assert cause["name"] == "rail_roll"  # and no unlisted law
    truth = answers["explained"]["stiffness"]
    for mine, right in zip(answers["bad_data"]["stiffness"], truth, strict=True):
        assert mine["value"] == pytest.approx(right["value"], rel=0.03)
    clean = answers["explained"]["joint_springs"]["stiffness"]  # what a controller takes
    for mine, right in zip(answers["bad_data"]["effective"], clean, strict=True):
        assert abs(mine["compliance"] - right["compliance"]) < 2 * right["compliance_std"]
    assert all("effective" not in one for name, one in answers.items() if name != "bad_data")


def test_a_p_value_is_that_of_the_chi_square_beside_it(campaign):
    """In every fit of an answer: the recommended one, the springs, the extended one."""
    assert told_by_chi_square(campaign[1]) >= 1


def test_the_terminal_says_it(campaign, told):
    """A line per joint with value and uncertainty, below the verdict of its campaign."""
    found, answer, _ = campaign
    block = told[1].split(f"{found.name}: ", 1)[1].split("index.html", 1)[0]

    lines = dict(re.findall(r"^  (?:[AE][1-6] +)?(k_\w+) +(.*)$", block, re.MULTILINE))
    assert set(lines) == {entry["name"] for entry in answer["stiffness"]}
    for entry in answer["stiffness"]:
        if entry["value"] is None:
            assert lines[entry["name"]] == "not determined"
            continue
        value, _, _, unit = lines[entry["name"]].split()
        size = float(value) * {"k": 1e3, "M": 1e6, "G": 1e9}[unit[0]]
        assert size == pytest.approx(entry["value"], abs=0.6 * entry["std"])


def test_page_and_pdf_say_it(campaign):
    """The first value of every row of the stiffness table is the answer's, also on paper."""
    found, answer, _ = campaign
    page = (found.reports / "index.html").read_text("utf-8")
    table = page.split("Stiffness of each joint", 1)[1].split("</table>", 1)[0]
    rows = [re.findall(r'data-sort="([^"]*)">(.*?)</td>', r) for r in table.split("<tr>")[2:]]
    shown = {cells[1][1]: cells[2] for cells in rows}  # below axis and name
    paper = " ".join(pages_of((found.reports / "report.pdf").read_bytes()))
    paper = same_text(paper).replace(" ", "").replace("\u200b", "")

    for name, entry in stated(answer).items():
        sort, text = shown[name]
        assert float(sort) * 1e6 == pytest.approx(entry["value"], rel=1e-9) or float(
            sort
        ) == pytest.approx(entry["value"], rel=1e-9)
        assert same_text(text).replace(" ", "") in paper
    assert set(shown) == {entry["name"] for entry in answer["stiffness"]}


def test_trend_and_comparison_take_it(campaign):
    """The change against another campaign is the answer's; an unexplained one raises no alarm."""
    found, answer, root = campaign
    other = find(root, OTHER).result()
    _, content = compared(root, found.name, OTHER)
    over_time = {t.name: t for t in trends([read(found), read(find(root, OTHER))])}

    for change in content["stiffness"]:
        entry = next(e for e in answer["stiffness"] if e["name"] == change["name"])
        assert change["before"] == entry["value"]
        x = [
            next(e for e in a["stiffness"] if e["name"] == change["name"]) for a in (answer, other)
        ]
        if found.name == "unexplained":
            assert over_time[change["name"]].campaigns == 1
        elif entry["value"] is not None:
            ratio = x[0]["compliance"] / x[1]["compliance"]
            assert over_time[change["name"]].first_to_last == pytest.approx(100 * (ratio - 1))


def test_only_what_the_answer_stands_for_is_tested(campaign):
    """Joint springs in place of an identified cause, or of bad data, may look worn."""
    found, answer, root = campaign
    said = answer["recommended"]
    plain = said["model"] == "joint_springs" and said["data"] == "as_given"
    report, content = compared(root, f"{found.name}:joints", f"{OTHER}:joints")

    if plain and found.name != "unexplained":
        assert content["p_value"] is not None
    else:
        assert content["p_value"] is None
        assert {change["sigmas"] for change in content["stiffness"]} == {None}
        assert report.verdict == "Not tested"
        assert any(found.name in one.text for one in report.first)


def test_what_to_type_is_shown_without_marks_of_ours(campaign, told):
    """On the terminal, the page and the PDF; result.json keeps the marks for programs."""
    found, answer, _ = campaign
    page = (found.reports / "index.html").read_text("utf-8").partition("<script>")[0]
    spoken = "".join(pages_of((found.reports / "report.pdf").read_bytes()))

    assert "`" not in page + spoken + told[1]
    if found.name == "explained":
        said = f"pipeline compensate {found.name} PATH"
        assert f"`{said}`" in answer["first_screen"][1]["text"]
        assert f"<code>{said}</code>" in page
        assert f"'{said}'" in told[1]


def test_what_explains_nothing_is_no_earlier_campaign_to_compare_with(told):
    """The previous campaign is the last one with valid values."""
    root, _ = told
    answers = [
        read(find(root, name)).model_copy(update={"measured": f"2026-0{k}-01"})
        for k, name in enumerate(("adequate", "unexplained", "explained"), 1)
    ]

    assert previous(answers[2], answers).campaign == "adequate"


def test_model_file_and_urdf_hold_it(campaign):
    """model.toml and model.urdf have stiffness and standard uncertainty as in result.json."""
    found, answer, _ = campaign
    model = model_file.load(found.reports / "model.toml")
    urdf = ElementTree.parse(found.reports / "model.urdf")
    elastic = {joint.get("name"): joint.find("elasticity") for joint in urdf.iter("joint")}

    for j, entry in enumerate(answer["stiffness"]):
        if entry["compliance_std"] is None:
            continue
        assert model.value[j] == pytest.approx(entry["compliance"], rel=1e-12)
        assert model.std[j] == pytest.approx(entry["compliance_std"], rel=1e-9)
        there = elastic[entry["name"].removeprefix("k_")]
        assert float(there.get("stiffness")) == pytest.approx(1 / entry["compliance"], rel=1e-9)


def test_predict_and_compensate_use_it(campaign):
    """Predicted deflection and offsets are those of the answer's compliances and causes.

    By hand, with the geometry of the unloaded robot: each joint rotates by compliance times torque
    about its axis, from differences of Pinocchio's, and a rolling carriage rotates everything about
    the rail.
    """
    found, answer, _ = campaign
    model = model_file.load(found.reports / "model.toml")
    q = np.array([[6.0, *np.deg2rad([-15.0, 35.0, -20.0, 40.0, 60.0, 10.0])]])
    force = np.array([[250.0, -70.0, 100.0]])  # small: the second order falls faster
    point = np.array([0.15, 0.0, 0.25])
    said = model.predict(q, force, point).displacement
    x = np.array([e["compliance"] or 0.0 for e in answer["stiffness"]])

    expected = turned(q[0], force[0], point) @ x
    causes = {c["name"]: c for c in answer["diagnosis"]["causes"]}
    if "rail_roll" in causes and answer["recommended"]["model"] == "extended":
        size = causes["rail_roll"]["parameters"][0]["value"]
        expected = expected + rolled(q[0], force[0], point) * size
        assert np.linalg.norm(rolled(q[0], force[0], point) * size) > 3e-6
    weights = [one["weight"] for one in answer["recommended"]["hypotheses"]]
    assert [one.weight for one in model.hypotheses] == pytest.approx(weights)
    if answer["recommended"]["model"] != "averaged":
        assert said[0] == pytest.approx(expected, abs=1e-6)
    path = Path(np.array([1]), q, force, False)
    assert compensate.compensate(model, path, point).shift == pytest.approx(-said, rel=1e-9)


def at(q, point):
    """Position of a point of the flange frame, from Pinocchio [m]."""
    model = pin_model(ROBOT, {"tip": point})
    data, frame = model.createData(), model.getFrameId("tip")
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[frame].translation.copy()


def rolled(q, force, point):
    """Displacement per unit compliance of a roll about the rail at the carriage [m/(rad/(N m))]."""
    along, here = np.array([0.0, 1.0, 0.0]), at(q, point)
    arm = here - np.array([0.0, q[0], 0.0])
    return np.cross(along, arm) * (along @ np.cross(arm, force))


def turned(q, force, point):
    """Motion of the point per unit of each joint's compliance, by differences, (3, n)."""
    step = 1e-6 * np.eye(len(q))
    J = np.array([(at(q + s, point) - at(q - s, point)) / 2e-6 for s in step]).T
    return J * (J.T @ force)


def test_the_first_screen_says_which_model_and_what_it_changes(told):
    """Model and reason, the stiffnesses that joint springs alone would misstate, the test pose."""
    answer = find(told[0], "explained").result()
    first = {line["about"]: line["text"] for line in answer["first_screen"]}
    springs = {e["name"]: e for e in answer["joint_springs"]["stiffness"]}
    off = {
        name: abs(e["compliance"] - springs[name]["compliance"])
        / max(e["compliance_std"], springs[name]["compliance_std"])
        for name, e in stated(answer).items()
    }
    share = {
        name: abs(np.log(e["value"] / springs[name]["value"])) for name, e in stated(answer).items()
    }

    assert list(first.values()) == answer["verdict_sentence"]
    about = ("verdict", "to_do", "model", "numbers", "test_pose", "wrong", "not_found", "next")
    assert list(first) == [*about]
    assert "alone do not explain the readings" in first["verdict"]
    assert "roll of the carriage" in first["model"]
    assert "roll of the carriage" in first["wrong"]
    far = sorted((name for name in off if off[name] > 3), key=lambda name: -share[name])[:3]
    assert re.findall(r"(k_\w+)\) changes", first["model"]) == far != []
    assert "mm with joint springs alone" in first["test_pose"]
    for model in (answer, answer["joint_springs"]):
        assert f"{plain(model['validation']['held_out_rms_mm'])} mm" in first["verdict"]
    warned = find(told[0], "unexplained").result()["verdict_sentence"][0]
    assert "do not rely on the stated uncertainties" in warned


def test_the_first_screen_says_what_to_do(campaign):
    """Which numbers go into the controller, or that none does; what is wrong; what comes next."""
    found, answer, _ = campaign
    said = {line["about"]: line["text"] for line in answer["first_screen"]}

    numbers = dict(re.findall(r"([AE]\d) (\d\S*) (?:±|[MkG]?N)", said["numbers"]))
    if found.name == "unexplained":
        assert numbers == {}
        assert "none of these stiffnesses" in said["to_do"]
    else:
        # a controller knows no cause: its numbers are those that compensate for one
        alone = found.name != "adequate"
        mine = answer.get("effective") or answer["joint_springs"]["stiffness"]
        known = {e["axis"]: e["value"] for e in mine if e["value"] and e["ci95"][1]}
        assert numbers.keys() == known.keys()
        assert ("Effective values" in said["numbers"]) == alone
        assert ("±" in said["numbers"]) != alone  # for a refuted model no uncertainty holds
        assert float(numbers["A1"]) * 1e6 == pytest.approx(known["A1"], rel=0.01)
    assert ("compensate" in said["to_do"]) == (found.name in ("explained", "ambiguous", "bad_data"))
    assert ("Correct" in said["to_do"] or "correct the file" in said["to_do"]) == (
        found.name == "bad_data"
    )
    assert {"wrong", "next", "test_pose"} <= said.keys()


def test_json_on_the_terminal_is_result_json(told):
    """`--json` prints the objects of result.json unchanged, one per line."""
    root, _ = told
    said = printed(root, *CAMPAIGNS, "--json").splitlines()

    assert [json.loads(line) for line in said] == [find(root, name).result() for name in CAMPAIGNS]
