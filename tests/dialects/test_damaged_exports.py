"""Damaged exports: an error in one sentence or rejected rows, and nothing else.

A damaged file may say something different, and then that is read. What must not happen: a
traceback, a hang, a row that vanishes silently, or a number that is not in the row.
"""

import random
import re
import time
from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.base.errors import InputError
from pipeline.machine.robot import load
from pipeline.readers import ExportSettings, OutgoingReadings, catalogue, read, writers
from pipeline.reduction.ingest import ingest
from pipeline.reduction.settings import parse

READERS = catalogue()
WRITERS = writers()

TOOL = {"P1": (0.2, 0.05, 0.12), "P2": (-0.12, 0.19, 0.1), "P3": (-0.1, -0.18, 0.22)}
CHAIN = {"Pl1": (0.15, 0.0, 0.25), "Pl2": (0.15, 0.0, -0.35)}
BASE = {"B1": (0.6, -0.5, -0.3), "B2": (0.6, 18.5, -0.3), "B3": (-0.6, 18.5, -0.28)}
TOML = """
format = 1
name = "fuzz"
robot = "kr500_rail"
[tracker]
files = ["tracker"]
sigma_m = 3.0e-5
EXTRA
[base_frame]
BASE
[scale]
sigma_n = 2.0
[tool]
load_point = [0.15, 0.0, 0.25]
TOOL
"""
LOADS = b"pose,repeat,force_n\n1,1,702.3\n1,2,1403.5\n2,1,698.0\n"
JOINTS = b"pose,r1_m,theta2_deg,theta3_deg,theta4_deg,theta5_deg,theta6_deg,theta7_deg\n"
JOINTS += b"1,5.3,-37.3,50,10,20,30,-82.2\n2,7.5,-10,35,39,81,22,-10\n"
ROBOT = load("kr500_rail")
SECONDS = 5.0
"""Time limit [s]: far more than a small file needs on a busy machine; a hang takes longer."""


def campaign_readings():
    """Readings of two poses with three pulls, in the frame of the instrument."""
    rng = np.random.default_rng(20261103)
    group, target, xyz = [], [], []
    for name, at in BASE.items():
        group, target, xyz = [*group, "base_start"], [*target, name], [*xyz, at]
    for pose, repeat in ((1, 0), (1, 1), (1, 2), (2, 0), (2, 1)):
        state = "loaded" if repeat else "unloaded"
        for name, at in {**TOOL, **(CHAIN if repeat else {})}.items():
            group.append(f"pose{pose:02d}_rep{repeat}_{state}")
            target.append(name)
            xyz.append(np.add(at, (pose, 2 * pose, 0.5)) + rng.normal(0, 1e-3, 3))
    start = datetime(2026, 11, 3, 8)
    return OutgoingReadings(
        group=group,
        target=target,
        position=np.round(np.array(xyz) * 1e3, 4) / 1e3,
        time=[start + timedelta(seconds=17 * k) for k in range(len(group))],
        covariance=np.tile([4e-10, 0.0, 0.0, 9e-10, 0.0, 1e-10], (len(group), 1)),
    )


def semicolons(data):
    """As saved by a German spreadsheet."""
    return re.sub(rb"(\d)\.(\d{4})(?!\d)(?! )", rb"\1,\2", data.replace(b",", b";"))


def iso_times(data):
    """Times in another format, without the blank before them."""
    return re.sub(rb" (\d\d)/(\d\d)/(\d\d) ([\d:]+)", rb"20\3-\1-\2T\4", data)


VARIANTS = {name: (name, bytes) for name in WRITERS} | {
    "plain, semicolons": ("plain", semicolons),
    "plain, quoted": ("plain", lambda data: re.sub(rb"(P\w+|B\d)", rb'"\1"', data)),
    "spatialanalyzer, columns": ("spatialanalyzer", lambda data: data.replace(b"::", b", ")),
    "spatialanalyzer, bare": ("spatialanalyzer", lambda data: data.partition(b"stamp\r\n")[2]),
    "spatialanalyzer, ISO": ("spatialanalyzer", iso_times),
    "tracker_pilot, semicolons": ("tracker_pilot", semicolons),
}
"""Formats to damage: those of the writers, and the same with other settings of the programs."""


class Bench:
    """A dialect's clean campaign: its bytes, its settings and its readings."""

    def __init__(self, name):
        """Write the campaign in a format and read it once."""
        key, transform = VARIANTS[name]
        reader = self.reader = READERS[key]
        readings = campaign_readings()
        bare = name.endswith("bare") or not reader.says_unit
        extra = ['unit = "mm"'] if bare else []
        extra += [] if reader.says_names else ['assignment = "rows.csv"']
        toml = TOML.replace("EXTRA", "\n".join(extra))
        for word, points in (("BASE", BASE), ("TOOL", TOOL)):
            toml = toml.replace(
                f"\n{word}\n", "\n" + "".join(f"{n} = {list(p)}\n" for n, p in points.items())
            )
        self.settings = parse(toml)
        rows = zip(readings.group, readings.target, strict=True)
        lines = [f"{k},{g},{t}" for k, (g, t) in enumerate(rows, 1)]
        self.assignment = "\n".join(["order,group,target", *lines, ""]).encode()
        self.clean = transform(reader.write(readings, "mm", 4))
        table = self.ingest(self.clean).readings.to_pylist()
        lines = text_lines(self.clean)
        self.meaning = {lines[row["line"] - 1]: content(row) for row in table}
        self.head = lines[: min(row["line"] for row in table) - 1]

    def ingest(self, data):
        """The campaign with other content of its export."""
        raw = {
            "tracker": data,
            "loads.csv": LOADS,
            "joints.csv": JOINTS,
            "rows.csv": self.assignment,
        }
        return ingest(self.settings, ROBOT, raw)


def content(row):
    """Content of a reading, independent of its position."""
    keys = ("group", "target", "x_m", "y_m", "z_m", "cxx_m2", "cyy_m2", "czz_m2", "time")
    return tuple(row[key] for key in keys)


def text_lines(data):
    """Lines of a file as an editor shows them, for any encoding and line ends."""
    for mark, encoding in (
        (b"\xef\xbb\xbf", "utf-8"),
        (b"\xff\xfe", "utf-16-le"),
        (b"\xfe\xff", "utf-16-be"),
    ):
        if data.startswith(mark):
            text = data[len(mark) :].decode(encoding)
            break
    else:
        if data[1:80:2].count(0) > 30:  # UTF-16 has a zero after each ASCII letter
            return [line.strip() for line in re.split(r"\r\n|\n|\r", data.decode("utf-16-le"))]
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            try:
                text = data.decode("cp1252")
            except UnicodeDecodeError:
                text = data.decode("latin-1")
    return [line.strip() for line in re.split(r"\r\n|\n|\r", text)]


NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][+-]?[0-9]+)?")


def says(line, row, named):
    """Whether a line contains the names and the three numbers [mm] of a reading."""
    together = line + re.sub(r"(?<=[0-9])[' ](?=[0-9]{3})", "", line)  # 18'500.0 is also a number
    numbers = [float(n.replace(",", ".")) / 1000.0 for n in NUMBER.findall(together)]
    numbers += [
        float(n) / 1000.0
        for n in re.findall(r"[+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?", line)
        if n.count(".") < 2 and n.strip("+-.")
    ]
    names = all(row[name] in line for name in ("group", "target")) if named else True
    return names and all(row[axis] in numbers for axis in ("x_m", "y_m", "z_m"))


def attempt(work):
    """Result of a function, or the error that explains why there is none."""
    try:
        return work(), None
    except InputError as refused:
        return None, refused


def check(bench, data, named):
    """Read damaged bytes; fail for anything except an error or true rows."""
    began = time.perf_counter()
    got, refused = attempt(lambda: bench.ingest(data))
    assert time.perf_counter() - began < SECONDS
    if refused:
        assert "\n" not in str(refused)
        assert refused.way_out
        return "refused"
    lines = text_lines(data)
    rows = got.readings.to_pylist()
    headed = set(bench.head) <= set(lines)  # without a header, uncertainties are those of [tracker]
    for row in rows:
        line = lines[row["line"] - 1]
        if line in bench.meaning and named:
            said, meant = content(row), bench.meaning[line]
            same = said == meant if headed else said[:5] + said[8:] == meant[:5] + meant[8:]
            assert same, f"other content from the same line {line!r}: {said} where {meant}"
        assert says(line, row, named), f"{row} is not what {line!r} says"
    spoken = {row["line"] for row in rows} | {row["line"] for row in got.rejected.to_pylist()}
    for number, line in enumerate(lines, 1):
        if line in bench.meaning:
            assert number in spoken, f"line {number} vanished: {line!r}"
    if [content(row) for row in rows] == list(bench.meaning.values()):
        return "same"
    assert len(rows) + len(got.rejected) >= 1
    return "partly"


# --- mutations ------------------------------------------------------------------------------------


def at(rng, data):
    """A random position in a file."""
    return rng.randrange(len(data)) if data else 0


def flip_bit(rng, data):
    """One bit flipped."""
    k = at(rng, data)
    return data[:k] + bytes([data[k] ^ (1 << rng.randrange(8))]) + data[k + 1 :]


def drop_byte(rng, data):
    """One byte lost."""
    k = at(rng, data)
    return data[:k] + data[k + 1 :]


def add_byte(rng, data):
    """One additional byte, often a significant one."""
    k = at(rng, data)
    extra = rng.choice(
        [
            b",",
            b";",
            b".",
            b"\t",
            b'"',
            b"'",
            b"\n",
            b"\r",
            b" ",
            b"-",
            b":",
            b"\0",
            b"\xe9",
            b"0",
            b"e",
            b"/",
            bytes([rng.randrange(256)]),
        ]
    )
    return data[:k] + extra + data[k:]


def cut(rng, data):
    """The file ends early."""
    return data[: at(rng, data)]


def lost_piece(rng, data):
    """A piece in the middle is missing."""
    a, b = sorted((at(rng, data), at(rng, data)))
    return data[:a] + data[b:] if b - a < 400 else data[:a] + data[a + 40 :]


def line_twice(rng, data):
    """A line is duplicated."""
    lines = data.splitlines(keepends=True)
    lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    return b"".join(lines)


def line_lost(rng, data):
    """A line is missing."""
    lines = data.splitlines(keepends=True)
    del lines[rng.randrange(len(lines))]
    return b"".join(lines)


def lines_swapped(rng, data):
    """Two lines are exchanged."""
    lines = data.splitlines(keepends=True)
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


def blank_line(rng, data):
    """A line that is empty or blank."""
    lines = data.splitlines(keepends=True)
    lines.insert(
        rng.randrange(len(lines)),
        rng.choice([b"\n", b"\r\n", b"   \n", b"\t\n", b";;;\n", b",,,,,\n"]),
    )
    return b"".join(lines)


WORDS = [
    b"nan",
    b"NaN",
    b"inf",
    b"-inf",
    b"1e999",
    b"",
    b"=1+1",
    b"@SUM(A1)",
    b"0x10",
    b"1_000",
    b"1,234",
    b"1.234.567",
    b"--5",
    b"1e",
    b"\xef\xbc\x91",
    b"#REF!",
    b"NULL",
    b"+",
    b"1d5",
    b"12 34",
    b"1e-400",
    b"\xc2\xa05.1",
]


def other_word(rng, data):
    """A number is replaced by something else."""
    numbers = list(re.finditer(rb"-?[0-9]+[.,][0-9]+", data))
    if not numbers:
        return data
    hit = rng.choice(numbers)
    return data[: hit.start()] + rng.choice(WORDS) + data[hit.end() :]


def decimal_comma(rng, data):
    """Points are replaced by commas, in one line or in all."""
    if rng.random() < 0.5:
        return data.replace(b".", b",")
    lines = data.splitlines(keepends=True)
    k = rng.randrange(len(lines))
    lines[k] = lines[k].replace(b".", b",")
    return b"".join(lines)


def other_delimiter(rng, data):
    """Another delimiter, in one line or in all."""
    old, new = rng.sample([b",", b";", b"\t", b"|", b" "], 2)
    if rng.random() < 0.5:
        return data.replace(old, new)
    lines = data.splitlines(keepends=True)
    k = rng.randrange(len(lines))
    lines[k] = lines[k].replace(old, new)
    return b"".join(lines)


def line_ends(rng, data):
    """Line ends of another operating system."""
    lines = data.splitlines()
    return b"".join(line + rng.choice([b"\n", b"\r\n", b"\r"]) for line in lines)


def recoded(rng, data):
    """Saved in another encoding."""
    text = data.decode("cp1252")
    encoding = rng.choice(["utf-16", "utf-8-sig", "utf-16-le", "cp1252", "utf-32"])
    return text.encode(encoding)


def quoted(rng, data):
    """A cell in quotation marks, or with one of them missing."""
    cells = list(re.finditer(rb"[^,;\r\n]+", data))
    hit = rng.choice(cells)
    inside = b'"' + hit[0] + (b'"' if rng.random() < 0.7 else b"")
    return data[: hit.start()] + inside + data[hit.end() :]


def twice(rng, data):
    """The file twice in a row."""
    return data + data


def long_line(rng, data):
    """An endless line."""
    k = at(rng, data)
    return data[:k] + b"x" * rng.choice([300, 9_000, 11_000]) + data[k:]


MUTATIONS = [
    flip_bit, drop_byte, add_byte, cut, lost_piece, line_twice, line_lost, lines_swapped,
    blank_line, other_word, decimal_comma, other_delimiter, line_ends, recoded, quoted, twice,
    long_line,
]  # fmt: skip


def damaged(rng, data):
    """One to three mutations in sequence."""
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        data = rng.choice(MUTATIONS)(rng, data) or b" "
    return data


@pytest.fixture(scope="module")
def benches():
    """A clean campaign per dialect."""
    return {name: Bench(name) for name in VARIANTS}


def run(bench, name, seeds):
    """Outcome of every seed."""
    outcomes = []
    for seed in seeds:
        data = damaged(random.Random(seed), bench.clean)
        try:
            outcomes.append(check(bench, data, bench.reader.says_names))
        except Exception as problem:
            raise AssertionError(
                f"{name}, seed {seed}: {problem!r}\n{data.decode('latin-1')}"
            ) from problem
    return outcomes


@pytest.mark.sampled(3)
@pytest.mark.parametrize("count", [12, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", VARIANTS)
def test_damaged_exports_are_refused_or_read_honestly(benches, name, count):
    """Some damaged exports, with some of each kind of outcome."""
    outcomes = run(benches[name], name, range(count))

    assert {"refused", "partly", "same"} >= set(outcomes)
    assert outcomes.count("refused") > count // 10


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_ten_thousand_damaged_exports(benches, name):
    """Ten thousand of them, distributed over the dialects."""
    run(benches[name], name, range(1000, 1000 + 10_000 // len(VARIANTS) + 1))


TEXT = st.text(st.sampled_from("0123456789.,;:-+eE\"'\t \r\n/ABPpxyzgrouptaget_m|=@"), max_size=400)


@settings(max_examples=150, deadline=2000, suppress_health_check=[HealthCheck.too_slow])
@given(st.one_of(TEXT.map(str.encode), st.binary(max_size=400)), st.sampled_from(["mm", None]))
def test_any_bytes_give_readings_or_an_input_error(data, unit):
    """For any bytes: consistent readings, or one sentence."""
    export, refused = attempt(lambda: read("t", data, ExportSettings(unit=unit)))
    if refused:
        assert str(refused).startswith("t:")
        return
    n = len(export.line)
    assert export.position.shape == (n, 3)
    assert np.isfinite(export.position).all()
    assert len(export.order) == len(export.time) == n


NUMBERS = st.floats(-3e4, 3e4, allow_nan=False)
STATISTICS = {
    "mean", "average", "avg", "median", "min", "max", "minimum", "maximum", "range", "count",
    "rms", "centroid", "std", "dev", "stddev", "deviation", "stdev", "sigma", "sum",
    "mittelwert", "mittel", "standardabweichung", "stabw", "spannweite", "anzahl",
    "schwerpunkt", "summe", "moyenne", "type", "media",
}  # fmt: skip
NAME = st.text(
    st.characters(codec="utf-8", exclude_characters=',;|\t"\r\n:', exclude_categories=["C", "Z"]),
    min_size=1,
    max_size=12,
)
TARGET = NAME.filter(lambda name: not (set(re.findall(r"[^\W_]+", name.lower())) & STATISTICS))
"""A row called mean, max or CENTROID is a statistic of others, and rejected as one."""


@pytest.mark.whole
@settings(max_examples=100, deadline=2000)
@given(st.lists(st.tuples(NAME, TARGET, NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=8))
def test_any_names_and_numbers_come_back(rows):
    """Names of any letters, numbers of any size: written in metres, they are read back."""
    group, target, *xyz = zip(*rows, strict=True)
    moment = datetime(2026, 11, 3, 8)
    readings = OutgoingReadings(group, target, np.array(xyz, dtype=float).T, [moment] * len(rows))
    for name in ("plain", "spatialanalyzer"):
        export = read("t", READERS[name].write(readings, "m", None))

        assert export.group.to_pylist() == list(group)
        assert export.target.to_pylist() == list(target)
        np.testing.assert_array_equal(export.position, readings.position)
