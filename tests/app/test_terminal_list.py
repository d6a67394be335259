"""The list of stiffnesses on the terminal."""

from pathlib import Path

from report_sample import answer, revised

from pipeline.app.outcome import outcome
from pipeline.store.campaign import CampaignFolder


def listed(found):
    """The lines of an answer that begin with the joints of the controller."""
    folder = CampaignFolder(Path("hall"), Path("hall/data/raw/demo"))
    lines = outcome(folder, lambda _: found).text.splitlines()
    return {line.split()[0]: line for line in lines if " k_" in line}


def stiffer_one_way(content):
    """Joint 4 holds 2.40 MN m/rad at the test pose and 1.50 where its torque is negative."""
    joint = content["stiffness"][3]
    joint |= {"value": 2.4e6, "std": 2e4}
    one = {"ci95": [None, None], "compliance": None, "compliance_std": None, "axis_turns": None}
    joint["by_sign"] = {
        "positive": {"value": 2.4e6, "std": 2e4} | one,
        "negative": {"value": 1.5e6, "std": 1e4} | one,
        "of": "pull",
        "correlation": None,
        "value_of": "positive",
    }


def test_a_joint_that_is_stiffer_one_way_has_both_numbers():
    """That of the test pose first; all other joints have one."""
    plain = listed(answer())
    both = listed(revised(answer(), stiffer_one_way))
    (axis,) = (name for name in plain if plain[name] != both[name])

    assert "k_theta4" in both[axis]
    assert both[axis].endswith("2.400 ± 0.020 MN·m/rad; 1.500 ± 0.010 MN·m/rad the other way")
    assert all("the other way" not in line for line in plain.values())
