"""Mistakes of one origin are told as one."""

from dataclasses import replace

from pipeline.faults.mistake import as_it_is, outlying, told_once


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

    told = told_once(found)

    assert [each.where for each in told] == ["g1", "x", "h1", "g3", "y"]
    assert told[0].at == ("f:1", "f:2", "f:3")
    assert told[0].before == 9.0
    assert told[0].evidence == "g1 is off; the same in g2"
    assert told[1:] == (found[1], found[3], found[4], found[5])


def test_of_many_the_first_three_others_are_said():
    """Six in all."""
    (told,) = told_once([one(f"g{k}", "copy", (f"f:{k}",)) for k in range(6)])

    assert told.evidence == "g0 is off; the same in g1, g2, g3 and 2 more"
    assert told.correction == "without g0, and the same in g1, g2, g3 and 2 more"
    assert len(told.at) == 6
