"""The list of stiffnesses on the terminal."""

from pathlib import Path

from report_sample import answer, revised, stiffer_one_way

from pipeline.app.outcome import outcome
from pipeline.store.campaign import CampaignFolder


def listed(found):
    """The lines of an answer that begin with the joints of the controller."""
    folder = CampaignFolder(Path("hall"), Path("hall/data/raw/demo"))
    lines = outcome(folder, lambda _: found).text.splitlines()
    return {line.split()[0]: line for line in lines if " k_" in line}


def test_a_joint_that_is_stiffer_one_way_has_both_numbers():
    """That of the test pose first; all other joints have one."""
    plain = listed(answer())
    both = listed(revised(answer(), stiffer_one_way))
    (axis,) = (name for name in plain if plain[name] != both[name])

    assert "k_theta4" in both[axis]
    assert both[axis].endswith("2.400 ± 0.020 MN·m/rad; 1.500 ± 0.010 MN·m/rad the other way")
    assert all("the other way" not in line for line in plain.values())


def forty_off(content):
    """Forty readings that are off by 10 mm, and one cause."""
    (cause, *_) = content["diagnosis"]["causes"]
    evidence = {"sentence": "it is off", "correction": "without it", "before": 9.0, "after": 1.0}
    size = {"name": "size", "value": 0.01, "std": None, "unit": "m", "ci95": [None, None]}
    content["diagnosis"]["causes"] = [
        cause
        | {
            "name": "outlier",
            "where": f"g{k}/P1",
            "parameters": [size | {"meaning": "size"}],
            "evidence": evidence | {"unit": "mm"},
        }
        for k in range(40)
    ] + [cause]


def test_errors_are_printed_with_their_readings_and_counted_beyond_a_few():
    """Six of forty by name, then how many more, then the causes as ever."""
    folder = CampaignFolder(Path("hall"), Path("hall/data/raw/demo"))
    lines = outcome(folder, lambda _: revised(answer(), forty_off)).text.splitlines()
    sizes = [one for one in lines if one.startswith("  size of")]

    assert sizes == [f"  size of the error in g{k}/P1: 10.0 mm" for k in range(6)]
    assert lines[lines.index(sizes[-1]) + 1] == "  34 more errors are listed in the report"


def test_the_verdict_comes_first_and_each_line_says_what_it_is_about():
    """The line with the numbers is left out: the stiffnesses are listed below."""
    said = [("verdict", "It fits."), ("numbers", "Use these."), ("to_do", "Pull again.")]

    def say(content):
        content["first_screen"] = [{"about": about, "text": text} for about, text in said]

    text = outcome(
        CampaignFolder(Path("hall"), Path("demo")), lambda _: revised(answer(), say)
    ).text

    assert "Use these." not in text
    assert text.index("It fits.") < text.index("What to do: Pull again.") < text.index("k_theta2")
