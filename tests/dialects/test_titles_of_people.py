"""What people do to titles, letters and lists before a file reaches us."""

import io

import openpyxl
import pytest

from pipeline.dialects import code_pages, two_lines
from pipeline.dialects.workbook import sheets
from pipeline.intake import nominal
from pipeline.intake._sheet import sheet
from pipeline.readers import Columns, ExportSettings, read
from pipeline.readers._text import text
from pipeline.readers.export_settings import LogForm
from pipeline.readers.logs import loads

CHART = [
    ["LOAD CHART"],
    ["Pose", "Load-1", None, "Load-2", None, "Remark"],
    [None, "kg", "Hook", "kg", "Hook", None],
    [1, 85.2, 1, 87.3, 2, None],
    [2, 84.1, 7, None, None, "lunch"],
]
STATED = LogForm(
    columns={"Load-1 [kg]": "force_1_kg", "Load-2 [kg]": "force_2_kg",
             "Load-1 Hook": "anchor_1", "Load-2 Hook": "anchor_2"}
)  # fmt: skip


def workbook(merged):
    book = openpyxl.Workbook()
    for row in CHART:
        book.active.append(row)
    for cells in merged:
        book.active.merge_cells(cells)
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def chart(merged):
    lines = [
        ",".join("" if k >= len(row) or row[k] is None else str(row[k]) for k in range(6))
        for row in CHART
    ]
    return "\n".join(lines).encode() if merged is None else workbook(merged)


@pytest.mark.parametrize("merged", [None, [], ["A1:F1", "A2:A3", "B2:C2", "D2:E2", "F2:F3"]])
def test_a_load_chart_in_two_lines_of_titles(merged):
    """A row for each pull, with its own hook, from a workbook with and without merged cells."""
    log = loads("chart.csv" if merged is None else "chart.xlsx", chart(merged), STATED)

    assert log.number["pose"].tolist() == [1, 1, 2]
    assert log.number["repeat"].tolist() == [1, 2, 1]
    assert log.number["force"] == pytest.approx([85.2 * 9.80665, 87.3 * 9.80665, 84.1 * 9.80665])
    assert log.word["anchor"].tolist() == ["1", "2", "7"]


@pytest.mark.parametrize(("first", "below"), [
    (["group", "target", "", ""], ["a", "b", "1", "2"]),
    (["LOAD CHART", "", ""], ["Pose", "Force", "Hook"]),
    (["Pose", "Force", ""], ["", "N", "N"]),
])  # fmt: skip
def test_lines_that_are_no_two_lines_of_titles(first, below):
    assert two_lines.titles(first, below) == (first, 1)


def test_merged_cells_hold_their_content_in_every_row():
    (text,) = sheets("a.xlsx", workbook(["F4:F5", "B4:B5"])).values()

    assert [line for _, line in text.lines(4)] == ["1\t85.2\t1\t87.3\t2\t", "2\t85.2\t7\t\t\t"]


@pytest.mark.parametrize(("text", "page"), [
    ("Přístroj; Čas", "cp1250"), ("w dół, siła ż", "cp1250"), ("OBCIĄŻENIE", "cp1250"),
    ("Сила, кН", "cp1251"), ("açıklama ğ", "cp1254"), ("Unità: è più", "cp1252"),
    ("où ça, relevé à vide", "cp1252"), ("Stöße ± 3 µm, m² und m³", "cp1252"),
    ("位姿,次数,拉力(kN),锚点", "gb18030"),
    ("斜距(m)\t水平角(°)", "gb18030"),
    ("ポーズ;荷重;測定点", "cp932"),
    ("자세,하중(N),측정점", "cp949"), ("位姿,載重(N),測點", "big5"),
    ("ПОЗА;СИЛА;УГОЛ, °", "cp1251"),
    ("ÖLÇÜM GÜÇ ÇÜRÜK ğ", "cp1254"), ("MESSGRÖSSE ÜBERÄNDERUNG ± 3 µm", "cp1252"),
])  # fmt: skip
def test_a_code_page_is_that_of_a_language_whose_letters_all_are(text, page):
    assert code_pages.page(text.encode(page)) == page


PLACES = {"B1": (0.6, -0.5, -0.3), "B2": (0.6, 18.5, -0.3), "B3": (-0.6, 18.5, -0.28),
          "B4": (-0.6, -0.5, 0.9), "P1": (0.2, 0.05, 0.12), "P2": (-0.12, 0.19, 0.1),
          "P3": (-0.1, -0.18, 0.22)}  # fmt: skip


def apart(names):
    rows = [(a, b) for k, a in enumerate(names) for b in names[k + 1 :]]
    return {(a, b): sum((x - y) ** 2 for x, y in zip(PLACES[a], PLACES[b], strict=True)) ** 0.5
            for a, b in rows}  # fmt: skip


def written(**moved):
    at = PLACES | moved
    base = [f"{n} {x} {y} {z}" for n, (x, y, z) in at.items() if n.startswith("B")]
    tool = [f"{n} {1e3 * x:g} {1e3 * y:g} {1e3 * z:g}" for n, (x, y, z) in at.items()
            if n.startswith("P")]  # fmt: skip
    table = ["J1 0 450 90", "J2 90 0 0"]
    return "\n".join(["axis d a alpha", *table, "base", *base, "tool", *tool, "eye 163 -20 312"])


def placed(text):
    targets = [*PLACES]
    found = {
        name: nominal.of_targets(one, targets)
        for name, one in nominal.tables({"a.txt": text.encode()}).items()
    }
    both = apart(targets[:4]) | apart(targets[4:])
    return nominal.placed(found, targets[4:], targets[:4], both)


def test_each_part_of_a_file_is_in_the_unit_that_its_distances_show():
    """Rows of a robot's table are no places."""
    found = placed(written())

    assert found.places.keys() == {*PLACES, "load_point"}
    for name, at in PLACES.items():
        assert found.places[name] == pytest.approx(at)
    assert found.places["load_point"] == pytest.approx((0.163, -0.02, 0.312))


def test_the_point_of_a_list_that_is_off_is_named():
    found = placed(written(B3=(-0.6, 18.473, -0.28)))

    assert "those of B3 up to 27 mm off" in found.seen[0]


def readings(rows):
    text = "\n".join(["Posa,Stato,Punto,x_mm,y_mm,z_mm", *rows])
    stated = ExportSettings(
        mapping=Columns(
            columns={"pose": "Posa", "state": "Stato", "target": "Punto",
                     "x": "x_mm", "y": "y_mm", "z": "z_mm"},
            delimiter=",",
            header=1,
        )
    )  # fmt: skip
    return read("a.csv", text.encode(), stated)


def test_blank_names_of_a_block_are_those_of_its_first_row():
    """A state under a pose has that pose; below a row that cannot be read nothing is known."""
    rows = ["1,scarico,P1,1,2,3", ",,P2,1,2,4", ",tiro,P1,1,2,3", ",,P2,1,2,4",
            "2,scarico,P1,x,2,3", ",,P2,1,2,4"]  # fmt: skip
    export = readings(rows)

    assert export.group.to_pylist() == ["1 scarico", "1 scarico", "1 tiro", "1 tiro"]
    assert [line for line, _ in export.rejected] == [6, 7]
    assert readings(rows[:2] + rows[1:2]).group.to_pylist() == ["1 scarico", "", ""]


@pytest.mark.parametrize(
    ("titles", "expected"),
    [
        ("Point Id    X       Y       Z    Sx   Date/Time", "Point Id,X,Y,Z,Sx,Date/Time,"),
        ("Point       X       Y       Z    Sx   Date Time", "Point,X,Y,Z,Sx,Date,Time"),
        ("Point X Y Z Sx Date Time", "Point,X,Y,Z,Sx,Date,Time"),
    ],
)
def test_one_title_of_two_words_moves_no_column(titles, expected):
    """Blanks separate the cells: there are as many words as cells, but not where they stand."""
    rows = "P1-R1   6911.62  -480.26  1382.47  0.01  19/05/2026 08:41:21\n"
    rows += "P1-R2   1684.96  -448.61  1355.39  0.02  19/05/2026 08:41:32\n"
    found = sheet(text("a.txt", f"{titles}\n{rows}".encode()))
    assert ",".join(found.titles) == expected
