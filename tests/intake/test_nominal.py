"""A list of nominal places beside an export: not readings, but what [tool] and [base_frame] ask."""

import tomllib

import pytest
from test_init import FILES, TRUE

from pipeline.app import cli
from pipeline.intake import nominal
from pipeline.intake.files import propose

PLACES = TRUE["base_frame"] | TRUE["tool"]


def sheet(per_metre, name="{}", mark=".", head="Cell, not to scale: B1 o-- rail in mm, 18 m ->"):
    """A page of places with a drawing, each to 0.01 mm, in a unit that need not be stated."""
    rows = [head, "  name  X  Y  Z"]
    for point, at in PLACES.items():
        called = "Hook" if point == "load_point" else name.format(point)
        rows.append("   ".join([called, *(f"{per_metre * x:.6g}".replace(".", mark) for x in at)]))
        rows += ["", "tool plate, flange frame"] if point == "B4" else []
    return "\n".join([*rows, "", "      o P1      (hook) below"]).encode()


@pytest.mark.parametrize("per_metre", [1e3, 1 / 0.0254, 1.0])
@pytest.mark.parametrize("mark", [".", ","])
def test_distances_show_the_unit_of_a_sketch_and_which_body_each_point_is_on(per_metre, mark):
    """Whatever it says in words; the load point is the only name that was not read."""
    said = propose(FILES | {"a_sketch.txt": sheet(per_metre, mark=mark)})

    assert said.exports == ("tracker.csv",)
    assert [*said.measured] == TRUE["naming"]["measured"]
    assert {*said.base} == {*TRUE["base_frame"]}
    assert said.nominal.places.keys() == PLACES.keys()
    for name, at in said.nominal.places.items():
        assert at == pytest.approx(PLACES[name], abs=1e-4)


def test_init_writes_the_places_with_their_source_to_be_confirmed(tmp_path):
    """Nothing of the sketch is open, and it is not among the exports."""
    folder = tmp_path / "data" / "raw" / "mine"
    folder.mkdir(parents=True)
    for name, data in (FILES | {"sketch.txt": sheet(1e3)}).items():
        (folder / name).write_bytes(data)
    assert cli._exit_code(["init", "mine", "--root", str(tmp_path)]) == 0
    text = (folder / "campaign.toml").read_text()
    known = tomllib.loads(text)

    assert known["tracker"]["files"] == ["tracker.csv"]
    for table in ("tool", "base_frame"):
        assert known[table].keys() == TRUE[table].keys()
        for name, at in known[table].items():
            assert at == pytest.approx(TRUE[table][name])
    line = next(line for line in text.splitlines() if line.startswith("load_point"))
    assert line.endswith("# sketch.txt, mm, Hook: confirm it")


def test_a_list_whose_distances_were_not_read_is_no_export_and_fills_in_nothing():
    """Names show what it is; a place of another cell is not written."""
    lines = sheet(1e3).decode().splitlines()
    other = [f"{k} {37 * i} {11 * i * i} {5 * i}" if (k := line.split(" ")[0]) in PLACES else line
             for i, line in enumerate(lines)]  # fmt: skip
    said = propose(FILES | {"sketch.txt": "\n".join(other).encode()})

    assert said.exports == ("tracker.csv",)
    assert said.nominal.places == {}
    assert "from those read: fill in its places by hand" in said.nominal.seen[0]


def test_a_sketch_of_reflectors_that_nobody_read_stays_what_it_was():
    """Two lists of other names are not judged by their form."""
    other = sheet(1e3, name="X{}")
    assert nominal.tables({"sketch.txt": other})
    assert propose(FILES | {"sketch.txt": other}).nominal.seen == ()


def test_files_of_one_group_each_are_readings():
    """Each name stands once in each of them, too, but other files of their form have it again."""
    rows = [row.split(",")[:5] for row in FILES["tracker.csv"].decode().splitlines()[1:]]
    groups = dict.fromkeys(row[0] for row in rows)
    files = {
        f"{group}.txt": "\n".join(" ".join(row[1:]) for row in rows if row[0] == group).encode()
        for group in groups
    }

    assert len(files) > 10
    assert nominal.tables(files) == {}
    assert [*nominal.tables(files | {"sketch.csv": sheet(1e3)})] == ["sketch.csv"]
