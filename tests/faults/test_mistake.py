"""Mistakes of one origin are told as one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.faults.mistake import as_it_is, in_common, outlying, told_once


def one(where, alike="", at=(), **known):
    made = outlying(where, f"{where} is off", f"without {where}", before=3.0, correct=as_it_is)
    return replace(made, alike=alike, at=at, **known)


def test_mistakes_of_one_origin_are_one_with_all_their_lines():
    """Where the first of them is; those of another origin, name or none stay by themselves."""
    found = (
        one("g1", "copy", ("f:1", "f:2")),
        one("x"),
        one("g2", "copy", ("f:2", "f:3"), before=9.0),
        one("h1", "other", ("f:7",)),
        one("g3", "copy", ("f:4",), name="label_swap"),
        one("y"),
    )

    told = told_once(found, "")

    assert [each.where for each in told] == ["g1", "x", "h1", "g3", "y"]
    assert told[0].at == ("f:1", "f:2", "f:3")
    assert told[0].before == 9.0
    assert told[0].evidence == "g1 is off; the same in g2"
    assert told[1:] == (found[1], found[3], found[4], found[5])


def test_of_many_the_first_three_others_are_said():
    """Six in all."""
    (told,) = told_once([one(f"g{k}", "copy", (f"f:{k}",)) for k in range(6)], "")

    assert told.evidence == "g0 is off; the same in g1, g2, g3 and 2 more"
    assert told.correction == "without g0, and the same in g1, g2, g3 and 2 more"
    assert len(told.at) == 6


def readings():
    """Targets in eight poses, unloaded and under two loads, P3 never moves; and one of the base."""
    made = []
    for pose in range(1, 9):
        for repeat in range(3):
            for k, target in enumerate(("P1", "P2", "P3")):
                at = np.array([pose, k, 0.0]) + 3e-3 * repeat * (target != "P3")
                state = "loaded" if repeat else "unloaded"
                made.append((pose, state, target, *at, "tracker.csv", len(made) + 2))
    made.append((np.nan, "unloaded", "B1", *np.zeros(3), "tracker.csv", len(made) + 2))
    names = ["pose", "state", "target", "x_m", "y_m", "z_m", "file", "line"]
    return pd.DataFrame(made, columns=names)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (
            "target == 'P3' and state == 'loaded'",
            "All of them are of loaded states of P3, which did not move with the load: look there "
            "first.",
        ),
        (
            "target == 'P2' and state == 'loaded'",
            "All of them are of loaded states of P2: look there first.",
        ),
        ("target == 'P2'", "All of them are of P2: look there first."),
        ("pose == 4", "All of them are of pose 4."),
        ("target != 'P2'", ""),
        ("target == 'P1' and pose < 3 and state == 'unloaded'", ""),
        ("pose > 99", ""),
    ],
)
def test_what_many_wrong_readings_have_in_common_is_said(rows, said):
    """Target and state, target, or pose; nothing of a few, which may have it by chance."""
    table = readings()
    lines = table.query(rows)["line"] if "99" not in rows else []
    found = [one(f"g{k}", at=(f"tracker.csv:{k}",), size=3e-3) for k in lines]

    assert in_common(found, table) == said


def test_other_errors_beside_them_have_nothing_in_common():
    """A unit is no reading."""
    lines = readings().query("target == 'P3'")["line"]
    found = [one(f"g{k}", at=(f"tracker.csv:{k}",), size=3e-3) for k in lines]

    assert in_common([*found, one("inch", name="unit_mixup")], readings()) == ""


def test_a_wrong_entry_of_campaign_toml_is_told_with_its_line():
    toml = 'name = "x"\n\n[anchors]\nH1 = [1.0, 2.0, 3.0]\nH2 = [1.0, 2.0, 3.0]\n'

    wrong, other = told_once([replace(one("H2"), entry=("anchors", "H2")), one("g")], toml)

    assert wrong.at == ("campaign.toml:5",)
    assert other.at == one("g").at
