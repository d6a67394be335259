"""Forces that suit the robot: by its payload and stiffness, refused or told where they do not."""

import json

import numpy as np
import pytest

from pipeline.app import cli
from pipeline.base.errors import InputError
from pipeline.design import problem, spec
from pipeline.machine.robot import load
from pipeline.machine.robot.mdh import parse
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, revised, simulate
from pipeline.simulate.plan import fitted
from pipeline.store.campaign import in_memory

SEED = 20261122
FEW = Plan(name="few", seed=SEED, poses={"count": 7})


def softer(factor, payload="payload_kg = 480\n"):
    """The KR500 with all its stiffnesses divided, and without its payload."""
    lines = load("kr500_rail").text.replace(payload, "").splitlines()
    return parse("\n".join(_divided(line, factor) for line in lines), "soft.toml")


def _divided(line, factor):
    if not line.startswith("stiffness"):
        return line
    key, _, value = line.partition(" = ")
    return f"{key} = {float(value) / factor}"


def own(text, **changes):
    """Files of a campaign of the reference set-up, with another robot file said to be the robot."""
    files = dict(simulate(revised(FEW, changes)).files)
    said = files["campaign.toml"].decode().replace('"kr500_rail"', '"robot.toml"')
    return files | {"campaign.toml": said.encode(), "robot.toml": text.encode()}


def test_loads_that_nobody_states_suit_the_robot():
    """A UR10e is pulled by as much less than a KR500 as it carries less, and all that shows it."""
    plan = fitted(Plan(robot="ur10e"), load("ur10e"))

    assert plan.pulls.steps_n == [31.0, 78.0, 52.0]  # 12.5 kg of 480 kg, two digits
    assert plan.pulls.masses_kg == [2.6, 6.5, 3.9]
    assert [body.mass_kg for body in plan.payload.values()] == [1.6, 5.7]
    assert (plan.scale.sigma_n, plan.pulls.setting_sd_n) == (0.052, 0.39)


def test_loads_that_are_stated_stay():
    """Whatever a plan says is what is done, and the reference set-up is what it was."""
    stated = {"pulls": {"steps_n": [100.0], "setting_sd_n": 1.0}, "scale": {"sigma_n": 0.5}}
    plan = fitted(revised(Plan(robot="ur10e"), stated), load("ur10e"))

    assert (plan.pulls.steps_n, plan.pulls.setting_sd_n, plan.scale.sigma_n) == ([100.0], 1.0, 0.5)
    assert fitted(FEW, load("kr500_rail")) is FEW


@pytest.mark.parametrize("factor", [10.0, 100.0])
def test_a_soft_robot_is_not_pulled_far(factor, read_back):
    """Its load point moves by about a centimetre under the hardest pull, however soft it is."""
    moved = np.linalg.norm(read_back(simulate(FEW, robot=softer(factor))).data.delta, axis=-1)

    assert 2e-3 < np.quantile(moved, 0.9) < 2e-2


def test_a_robot_of_which_nothing_is_known_is_pulled_as_ever():
    """Without payload and stiffness there is nothing to go by."""
    assert fitted(FEW, load("fanuc_r2000ic")) is FEW


@pytest.mark.parametrize(
    ("pulls", "says"),
    [
        ({"steps_n": [100.0, 3000.0]}, "a pull of 3000 N is 24.5 times what ur10e carries"),
        ({"pose_steps_n": [[50.0], [-400.0]]}, r"400 N is 3.26 times .* \(12.5 kg, 123 N\)"),
        ({"load": "weights", "masses_kg": [60.0]}, "588.4 N is 4.8 times"),
        ({"load": "payloads"}, "a pull of 2157 N is 17.6 times .*; pull at most 368 N: "),
    ],
)
def test_an_absurd_load_is_refused(pulls, says):
    """One sentence with the number and the way out, whatever loads the robot."""
    heavy = {"heavy": {"mass_kg": 220.0, "center_m": [0, 0, 0.1]}}
    plan = revised(Plan(robot="ur10e", poses={"count": 2}), {"pulls": pulls, "payload": heavy})

    with pytest.raises(InputError, match=says):
        simulate(plan)


def test_a_design_pulls_as_the_robot_is_rated():
    """Without load steps it has one that suits the robot; absurd ones are refused."""
    text = spec.shipped("paper_reference").replace("[pull]\nsteps_n = [950.0]\n", "")
    pose = {"q": [0, -60, 80, 30, 50, 0], "force_n": [10, 0, 0], "weight": 1}
    small = spec.revised(spec.parse(text), {"robot": "ur10e", "test_pose": [pose]})
    hard = spec.revised(small, {"pull": {"steps_n": [950.0]}})

    assert problem.build(small, load("ur10e")).spec.pull.steps_n == [78.0]
    assert problem.build(spec.parse(text), load("kr500_rail")).spec.pull.steps_n == [3000.0]
    with pytest.raises(InputError, match=r"950 N is 7[.]75 times what ur10e"):
        problem.build(hard, load("ur10e"))


@pytest.mark.whole
def test_a_force_that_the_robot_would_not_hold_is_told_and_the_robot_called_by_its_name():
    """The report says which pull and how many times the payload, as a fact and as a sentence."""
    text = load("kr500_rail").text.replace('name = "kr500_rail"', 'name = "lab_arm"', 1)
    files = own(text.replace("payload_kg = 480", "payload_kg = 50"))
    found = campaign_answer("few", in_memory(files)).answer
    fact = found.overload

    assert found.robot == "lab_arm"
    assert fact is not None
    assert fact.times == pytest.approx(fact.force_n / (50 * 9.80665))
    assert fact.force_n == pytest.approx(3000, abs=60)
    assert any(line.startswith("The hardest pull, 3") for line in found.findings)


@pytest.mark.whole
@pytest.mark.parametrize(("payload", "told"), [("50", True), ("300", False)])
def test_check_tells_a_force_that_the_robot_would_not_hold(tmp_path, capsys, payload, told):
    """A warning that rejects nothing, and none for a pull that a robot holds."""
    folder = tmp_path / "data" / "raw" / "few"
    folder.mkdir(parents=True)
    text = load("kr500_rail").text.replace("payload_kg = 480", f"payload_kg = {payload}")
    for name, data in own(text).items():
        (folder / name).write_bytes(data)
    with pytest.raises(SystemExit) as end:
        cli.main(["check", "few", "--json", "--root", str(tmp_path)])
    said = capsys.readouterr()

    assert end.value.code == 0
    assert ("overload" in json.loads(said.out)) is told
    assert ("times the weight of the 50 kg" in said.err) is told
