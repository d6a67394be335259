"""campaign.toml as fields: what is read from its lines, and what one changed line leaves alone."""

import tomllib

import pytest

from pipeline.base.errors import UsageError
from pipeline.page import entries

TEXT = """\
format = 1
name   = "hall # 7"   # not a comment in the name
# robot = ?                 # "kr500_rail" or "ur10": the joint log fits each
# operator =                # for the report

[tracker]
files   = ["a.csv", "b.csv"]
# unit = ?                  # "mm", "m" or "in": no export says it
#                           # and "ft" never was one
# a remark = that looks like one

[tool]                      # points of the effector
P1 = [
    0.1,
    0.2, 0.3,
]
# load_point = ?

# [test_pose]               # where it matters
# q =                       # a value for each joint
"""


def of(key, text=TEXT):
    return next(one for one in entries.entries(text) if one.key == key)


def test_every_line_that_says_something_is_a_field():
    """In their order, with the tables they stand in, also those that are comments yet."""
    found = [(one.table, one.key, one.value is not None) for one in entries.entries(TEXT)]

    assert found == [
        ("", "format", True),
        ("", "name", True),
        ("", "robot", False),
        ("", "operator", False),
        ("tracker", "files", True),
        ("tracker", "unit", False),
        ("tool", "P1", True),
        ("tool", "load_point", False),
        ("test_pose", "q", False),
    ]


def test_needed_and_answers_that_fit_are_told():
    """A `?` is needed; words in quotes are the answers, also of the next line of the comment."""
    assert [one.key for one in entries.entries(TEXT) if one.needed] == [
        "robot",
        "unit",
        "load_point",
    ]
    assert of("unit").words == ("mm", "m", "in", "ft")
    assert of("name").value == '"hall # 7"'
    assert not of("P1").whole


def test_one_line_is_changed_and_nothing_else():
    """All other lines stay, byte for byte, Windows line ends too."""
    text = TEXT.replace("\n", "\r\n")
    line = of("unit").line

    new = entries.filled(text, line, entries.value("mm", of("unit").words))

    changed = [
        k
        for k, (a, b) in enumerate(zip(text.split("\n"), new.split("\n"), strict=True), 1)
        if a != b
    ]
    assert changed == [line]
    assert tomllib.loads(new)["tracker"]["unit"] == "mm"
    assert new.split("\r\n")[line - 1].endswith('# "mm", "m" or "in": no export says it')


def test_a_table_that_was_a_comment_becomes_one():
    """Its title loses the mark with the first of its entries that is filled in."""
    new = entries.filled(TEXT, of("q").line, "[1, 2]")

    assert tomllib.loads(new)["test_pose"] == {"q": [1, 2]}


def test_what_is_taken_away_is_open_again():
    """An empty field makes a comment of its line, with what stood beside it."""
    new = entries.filled(TEXT, of("name").line, "")

    assert "name" not in tomllib.loads(new)
    assert of("name", new).about == "not a comment in the name"
    place = entries.filled(TEXT, of("load_point").line, "[1, 2, 3]")
    assert of("load_point", entries.filled(place, of("load_point", place).line, "")).needed


@pytest.mark.parametrize("line", [0, 5, 6, 12, 13, 99])
def test_no_other_line_can_be_filled_in(line):
    """Titles, remarks and values over several lines are for the text."""
    with pytest.raises(UsageError, match="edit the text"):
        entries.filled(TEXT, line, "1")


@pytest.mark.parametrize("said", ["[1, 2", "1\n[other]\nx = 1", '"a', "= 2"])
def test_what_is_no_toml_is_not_written(said):
    """A value cannot end its line and begin another."""
    if "\n" in said:
        assert tomllib.loads(f"x = {entries.value(said)}") == {"x": said}
    with pytest.raises(UsageError, match="valid TOML"):
        entries.filled(TEXT, of("robot").line, said)


@pytest.mark.parametrize(
    ("typed", "toml"),
    [("0,35", "0.35"), ("12", "12"), ("1e-3", "1e-3"), ("−2,5", "-2.5"), ("mm", '"mm"'),
     ('"mm"', '"mm"'), ("[1, 2]", "[1, 2]"), ("", ""), ("A \" B", '"A \\" B"'), ("true", "true")],
)  # fmt: skip
def test_what_people_type_becomes_toml(typed, toml):
    """A decimal comma, a word without quotes, TOML as it is."""
    assert entries.value(typed) == toml


def test_what_may_be_two_numbers_is_asked():
    """A comma before three digits is a thousand to some and a decimal to others."""
    with pytest.raises(UsageError, match="thousand or a decimal"):
        entries.number("1,234")
    assert entries.number("0,234") == 0.234


def test_a_serial_number_is_a_word():
    """Whatever its digits look like."""
    assert entries.value("0123", key="serial") == '"0123"'
    assert entries.value("12345", key="certificate") == '"12345"'


def test_a_word_that_fits_is_a_word():
    """An answer of the comment is one in quotes, whatever it looks like."""
    assert entries.value("1", ("1", "2")) == '"1"'


@pytest.mark.parametrize(
    ("typed", "unit", "toml"),
    [(["120", "35", "-40"], "mm", "[0.12, 0.035, -0.04]"),
     (["0,1", "0", "2"], "m", "[0.1, 0.0, 2.0]"),
     (["1", "2", "3"], "in", "[0.0254, 0.0508, 0.0762]"),
     (["", " ", ""], "m", "")],
)  # fmt: skip
def test_places_are_in_metres(typed, unit, toml):
    """In which unit they were typed is not kept."""
    assert entries.point(typed, unit) == toml


@pytest.mark.parametrize("typed", [["1", "2", "x"], ["1", "2", ""], ["1", "nan", "2"], ["1", "2"]])
def test_half_a_place_is_none(typed):
    """Three numbers, or a sentence."""
    with pytest.raises(UsageError):
        entries.point(typed, "m")


def test_what_was_filled_in_is_carried_over():
    """Over what is left open and what is proposed; which files there are is said anew."""
    old = entries.filled(TEXT, of("robot").line, '"ur10"')
    old = entries.filled(old, of("load_point", old).line, "[1.0, 2.0, 3.0]")
    old += "\n[priors]\nrail_roll = 0.2\n"
    new = TEXT.replace('"a.csv", "b.csv"', '"c.csv"')
    new = entries.filled(new, of("robot").line, '"kr500_rail"')

    text = entries.carried_over(old, new)

    both = tomllib.loads(text)
    assert both["robot"] == "ur10"
    assert both["tool"]["load_point"] == [1.0, 2.0, 3.0]
    assert both["tracker"]["files"] == ["c.csv"]
    assert "#   rail_roll = 0.2" in text  # which has no place in the new one
    assert "#       0.1," in text  # nor can several lines be taken over


def test_remarks_of_a_person_are_carried_over():
    """Behind a value, on a line of their own, and once however often a text is made anew."""
    old = entries.filled(TEXT, of("robot").line, '"ur10"')
    old = old.replace('"ur10"', '"ur10"   # the one at the window', 1)
    old = f"# hall 7, P2 was glued anew at noon\n{old}"

    text = entries.carried_over(entries.carried_over(old, TEXT), TEXT)

    assert text.count("# the one at the window") == 1
    assert '"ur10"' in next(one for one in text.splitlines() if "the one at the window" in one)
    assert text.count("# hall 7, P2 was glued anew at noon") == 1
    assert tomllib.loads(text)["robot"] == "ur10"


def test_comments_of_both_are_not_written_twice():
    """What `init` writes behind and between entries is no remark of a person, nor a question."""
    new = entries.filled(TEXT, of("unit").line, '"mm"')

    text = entries.carried_over(TEXT, new)

    assert "# unit = ?" not in text
    assert text.count("# a remark = that looks like one") == 1


def test_a_question_is_confirmed_by_taking_it_away():
    """With what it says below; what is proposed stays, and no other line can go so."""
    asked = (
        "# columns = ?   # a guess: correct columns below, then remove this line\n#    and go on\n"
    )
    text = TEXT.replace("# unit = ?", f"{asked}# unit = ?")
    line = of("columns", text).line

    assert entries.confirmed(text, line) == TEXT
    with pytest.raises(UsageError, match="no question"):
        entries.confirmed(text, of("unit", text).line)


def test_a_question_that_may_be_left_out_is_a_field():
    """How groups are read: an expression to type; its comment comes without marks."""
    asked = (
        "# group = ?    # an expression with (?P<pose>...),\n#         # (?P<state>...);\n"
        "#         # or remove this line, and write a log\n"
    )

    one = of("group", TEXT.replace("# unit = ?", f"{asked}# unit = ?"))

    assert not one.confirmable
    assert one.about == (
        "an expression with (?P<pose>...), (?P<state>...); or remove this line, and write a log"
    )


JOINTS = '[joints]\nfile = "a.csv"   # mine\n'
COLUMNS = '\n[joints.columns]\n"A1" = "J1_deg"\n'
REST = "\n# next\n[tool]\n"


def test_a_table_is_taken_from_another_text_and_all_else_stays():
    """With its head; comments of the next one stay where they are; it may come or go."""
    other = '[joints.columns]\n"A1" = "A1_deg"\n"A2" = "A2_deg"\n'
    new = other + "[tool]\nP1 = [1, 2, 3]\n"

    assert entries.with_table(JOINTS + COLUMNS + REST, new, "joints.columns") == (
        f"{JOINTS}\n{other}{REST}"
    )
    assert entries.with_table(JOINTS + COLUMNS + REST, "[tool]\n", "joints.columns") == (
        f"{JOINTS}\n{REST}"
    )
    assert entries.with_table(JOINTS + REST, new, "joints.columns") == f"{JOINTS}\n{other}{REST}"
    assert entries.with_table(JOINTS + REST, "[tool]\n", "joints.columns") == JOINTS + REST


MAPPED = """\
[tracker]
# columns = ?   # which column is what is a guess: correct columns in [tracker.mapping] below,
#               # then remove this line
# sigma_m =     # of one reading

[tracker.mapping]           # as proposed
columns = { x = "T", y = "U" }   # by title
"""


def test_columns_that_are_chosen_are_no_question_any_more():
    """By title, or by number where a title does not say which; remarks stay."""
    text = entries.with_columns(MAPPED, {"x": "U", "y": 7})

    assert tomllib.loads(text)["tracker"]["mapping"]["columns"] == {"x": "U", "y": 7}
    assert "# columns" not in text
    assert "# sigma_m =     # of one reading" in text
    assert "# by title" in text


def test_columns_of_a_known_dialect_are_not_chosen():
    """There is no mapping that could be changed."""
    with pytest.raises(UsageError, match=r"no columns in \[tracker\.mapping\]"):
        entries.with_columns(TEXT, {"x": 1})
