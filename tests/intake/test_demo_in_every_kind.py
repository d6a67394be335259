"""The demo campaign in each kind of file that can carry it: read back unchanged."""

import csv
import itertools
import math
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from campaign_exports import german, workbook
from campaign_exports import polar as seen

from pipeline.app.outcome import named
from pipeline.base import toml
from pipeline.check.report import check
from pipeline.intake import describe_file
from pipeline.intake.by_reflectors import settled
from pipeline.readers import ExportSettings
from pipeline.readers.reflector_sets import ReflectorSet
from pipeline.reduction.ingest import ingest
from pipeline.store.campaign import in_memory

DEMO = Path(__file__).parents[2] / "data/raw/kr500_demo"
FILES = {path.name: path.read_bytes() for path in sorted(DEMO.iterdir())}
ROWS = list(csv.DictReader(FILES["tracker.csv"].decode().splitlines()))
HALF_A_DIGIT = 0.5e-7
"""Half of the last of four decimals of a millimetre, as most kinds have [m]."""
TURN_DIGIT = 0.5e-7 * math.pi / 200
"""Half of the last of seven decimals of a gon [rad]."""


def mm(row):
    """Coordinates as text."""
    return [row[f"{axis}_mm"] for axis in "xyz"]


def comma(cells):
    """The same with decimal commas."""
    return [cell.replace(".", ",") for cell in cells]


def angles(row, sense=1):
    """Horizontal and zenith angle [gon] and distance [mm] of a reading, as text."""
    far, clockwise, zenith = seen([float(cell) / 1e3 for cell in mm(row)])
    turns = f"{sense * clockwise / 0.9 % 400:.7f}", f"{zenith / 0.9:.7f}"
    return [*turns, f"{1e3 * far:.4f}"]


def other_face(cells):
    """The same reading in the second face of the instrument."""
    turn, zenith, far = map(float, cells)
    return [f"{(turn + 200) % 400:.7f}", f"{400 - zenith:.7f}", f"{far:.4f}"]


def when(row, form):
    """Its time in another format."""
    return datetime.fromisoformat(row["time"]).strftime(form)


@dataclass
class Kind:
    """How one kind of file is written, and what it leaves to be said.

    Attributes:
        lines: Lines of one reading.
        head: Lines above.
        said: What [tracker] has to say.
        assigned: Whether an assignment has to say what the rows are.
        time: Form in which times are written, None where they are not.
        end: Between lines.
        angles: Whether the digits are those of angles.
        written: The whole file from its cells, where it is no text.
    """

    lines: object
    head: list = field(default_factory=list)
    said: dict = field(default_factory=lambda: {"unit": "mm"})
    assigned: bool = False
    time: str | None = None
    end: str = "\n"
    angles: bool = False
    written: object = None

    def data(self):
        """Readings of the campaign."""
        rows = [line for row in ROWS for line in self.lines(row)]
        if self.written:
            return self.written([*self.head, *rows])
        return "".join(line + self.end for line in [*self.head, *rows]).encode("cp1252")


def one(form):
    """A reading in one line."""
    return lambda row: [form(row)]


GERMAN = "%d.%m.%Y %H:%M:%S"
MINUTES = "%d.%m.%Y %H:%M"
ZENITH = {"unit": "mm", "vertical": "zenith"}
POLAR = ZENITH | {"coordinates": "spherical", "angle": "gon", "horizontal": "clockwise"}
REPORT = "Collection;Group;Target;Azimuth (gon);Elevation (gon);Distance (mm);Offset1 (mm);"
T_MAC = "X  [mm],Y  [mm],Z  [mm],U(95)  [mm],Q0 ,Q1 ,Q2 ,Q3 ,Time Stamp,OTG Applied,Delete"
STATION = {"columns": {"target": 2, "azimuth": 3, "vertical": 4, "range": 5}, "header": 0}
KINDS = {
    "target only": Kind(one(lambda r: f"{r['target']},  {',  '.join(mm(r))}"), assigned=True),
    "blanks": Kind(one(lambda r: f"A {r['group']} {r['target']}  {'   '.join(mm(r))}")),
    "blanks and colons": Kind(one(lambda r: f"A::{r['group']}::{r['target']}  {' '.join(mm(r))}")),
    "semicolon and comma": Kind(
        one(lambda r: ";".join([f"A::{r['group']}::{r['target']}", *comma(mm(r))]))
    ),
    "tab and comma": Kind(
        one(lambda r: "\t".join([f"A::{r['group']}::{r['target']}", *comma(mm(r))]))
    ),
    "German times": Kind(
        one(lambda r: ";".join(
            [f"A::{r['group']}::{r['target']}", *comma(mm(r)), when(r, GERMAN)])),
        time=GERMAN,
    ),
    "instrument report": Kind(
        one(lambda r: ";".join(["A", r["group"], r["target"], *comma(angles(r, -1)), "11,113",
                                when(r, MINUTES), "", "", "Yes", ""])),
        [";;;;;;", "Instrument: A::0 - Leica AT960;;;;;;", f"{REPORT}Date & Time;;User;Active;"],
        {"vertical": "zenith"}, time=MINUTES, end="\r\n", angles=True,
    ),
    "uncertainties and covariance": Kind(
        one(lambda r: ", ".join(["A", r["group"], r["target"], *mm(r), "0.02", "0.03", "0.04",
                                 "0.0004", "0.0001", "0", "0.0001", "0.0009", "0.0002",
                                 "0", "0.0002", "0.0016"]))
    ),
    "two faces": Kind(
        lambda r: ["\t".join(["Instrument_0", r["target"], *cells])
                   for cells in (angles(r), other_face(angles(r)))],
        said={"unit": "mm", "horizontal": "clockwise"}, assigned=True, angles=True,
    ),
    "name Hz V D": Kind(
        one(lambda r: "\t".join([r["target"], *comma(angles(r))])),
        said=POLAR, assigned=True, angles=True,
    ),
    "self-describing": Kind(
        one(lambda r: " ".join([r["target"], *angles(r, -1)])),
        ["# Format: spherical", "# Units: gon mm", "# Data"], {}, assigned=True, angles=True,
    ),
    "name x y z": Kind(one(lambda r: f"{r['target']}   {'   '.join(mm(r))}"), assigned=True),
    "T-Mac without names": Kind(
        one(lambda r: ",".join([*mm(r), "0.06", "1", "0", "0", "0", f"'{when(r, GERMAN)}",
                                "0", "0"])),
        [T_MAC], {}, assigned=True, time=GERMAN, end="\r\n",
    ),
    "empty tail": Kind(
        one(lambda r: f"{r['target']};{';'.join(mm(r))};;;;"), assigned=True, end="\r\n"
    ),
    "robot's log": Kind(
        one(lambda r: ";".join(["1,604E+12", "1,0", "2,0", "3,0", *comma(mm(r)), "12,5"])),
        ["Timestamp;Goal x;Goal y;Goal z;measurement_x;measurement_y;measurement_z;joint 1"],
        assigned=True,
    ),
    "total station": Kind(
        one(lambda r: ",".join(["SS", r["target"], *angles(r), "1.800", ""])),
        said=POLAR | {"mapping": STATION}, assigned=True, angles=True,
    ),
    "emScon": Kind(
        one(lambda r: ",".join([*mm(r), ""])), ["dVal1,dVal2,dVal3,"],
        {"unit": "mm", "coordinates": "cartesian"}, assigned=True,
    ),
    "six degrees of freedom": Kind(
        one(lambda r: ",".join([*mm(r), "10", "20", "30"])), ["X,Y,Z,Rx,Ry,Rz"], assigned=True
    ),
    "joints and places": Kind(
        one(lambda r: ",".join(["10", "20", r["group"], r["target"], *mm(r)])),
        ["theta1_deg,theta2_deg,group,target,x_mm,y_mm,z_mm"], {},
    ),
    "index of pandas": Kind(
        one(lambda r: ",".join([r["line"], r["group"], r["target"], *mm(r), r["time"]])),
        [",group,target,x_mm,y_mm,z_mm,time"], {}, time="%Y-%m-%dT%H:%M:%S",
    ),
    "thousands apart": Kind(
        one(lambda r: ";".join([r["group"], r["target"], *german(mm(r))])),
        ["Gruppe;Punkt;X [mm];Y [mm];Z [mm]"], {},
    ),
    "workbook": Kind(
        one(lambda r: [r["group"], r["target"], *map(float, mm(r))]),
        [["Gruppe", "Punkt", "X [mm]", "Y [mm]", "Z [mm]"]], {},
        written=lambda rows: workbook({"Points": rows}),
    ),
}  # fmt: skip
for k, row in enumerate(ROWS):
    row["line"] = str(k)


def files_of(kind):
    """The demo campaign with the tracker's file in some kind."""
    name = "tracker.xlsx" if kind.written else "tracker.txt"
    files = {name: kind.data()} | {k: v for k, v in FILES.items() if k != "tracker.csv"}
    said = toml.loads(FILES["campaign.toml"].decode(), "campaign.toml")
    said["tracker"] |= {"files": [name], **kind.said}
    if kind.assigned:
        orders = itertools.count(1)
        lines = [f"{next(orders)},{r['group']},{r['target']}" for r in ROWS for _ in kind.lines(r)]
        files["names.csv"] = "\n".join(["order,group,target", *lines, ""]).encode()
        said["tracker"]["assignment"] = "names.csv"
    return files | {"campaign.toml": toml.dumps(said).encode()}


def read(kind, alone=True):
    """Its readings, from the file and [tracker] alone, or with what known reflectors settle."""
    raw = in_memory(files_of(kind))
    found = ingest(raw.settings, raw.robot, raw.files)
    assert found.rejected.num_rows == 0
    assert any(one.settled for one in found.treated) != alone
    return found.readings


@pytest.fixture(scope="module")
def ours():
    """The readings of the original demo campaign."""
    raw = in_memory(FILES)
    return ingest(raw.settings, raw.robot, raw.files).readings


UNKNOWN = {
    name: KINDS[name]
    for name in ("blanks", "instrument report", "two faces", "name Hz V D", "total station")
}
"""Kinds that name their targets and leave something ambiguous."""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", UNKNOWN)
def test_known_reflectors_settle_what_the_file_leaves_open(name, ours):
    """Unit, kind of coordinates and zero of angles, from [tool] and [base_frame] alone."""
    kind = UNKNOWN[name]
    said = {word: kind.said[word] for word in kind.said.keys() & {"horizontal", "mapping"}}
    got = read(replace(kind, said=said), alone=False)

    for axis in ("x_m", "y_m", "z_m"):
        np.testing.assert_allclose(got[axis].to_numpy(), ours[axis].to_numpy(), atol=2e-6)


@pytest.mark.slow
def test_whoever_inspects_or_checks_is_told_what_settled_it(tmp_path):
    """In the folder of a campaign the file is read, and both say what settled it."""
    kind = replace(KINDS["name Hz V D"], said={"horizontal": "clockwise"})
    folder = tmp_path / "data" / "raw" / "demo"
    folder.mkdir(parents=True)
    for name, content in files_of(kind).items():
        (folder / name).write_bytes(content)
    seen = describe_file.inspect(folder / "tracker.txt", {})
    checked = named(tmp_path, "demo", check)

    assert (seen.exit_code, seen.content["coordinates"]) == (0, "spherical")
    told = [one.partition(":")[0] for one in seen.content["settled"]]
    assert told == ["coordinates spherical", "unit mm"]
    assert "settled      coordinates spherical: so reflectors are 0.040 mm off [tool]" in seen.text
    (note,) = [one for one in checked.content["notes"] if "with unit mm" in one]
    assert note.startswith("tracker.txt was read with unit mm: so reflectors")


@pytest.mark.whole
def test_which_way_azimuths_grow_only_points_off_a_plane_settle():
    """Three points, or four coplanar ones, fit their mirror image; a tool's triangle does, too."""
    data = KINDS["name Hz V D"].data()
    said = ExportSettings(unit="mm", coordinates="spherical", angle="gon", vertical="zenith")
    settings = in_memory(FILES).settings
    found, why = settled("t.txt", data, said, settings.bodies)
    assert (found.horizontal, why) == (None, ())

    floor = {"A": (0.0, 0, 0), "B": (9.0, 0, 0), "C": (9.0, 7, 0), "D": (1.0, 8, 0)}
    for up, sense in ((0.0, None), (0.01, None), (3.0, "clockwise")):
        places = floor | {"E": (4.0, 3.0, up)}
        lines = []
        for name, at in places.items():
            far, turn, down = seen(np.add(at, (-3.0, 2.0, -1.0)))
            lines.append(f"{name};{turn / 0.9:.7f};{down / 0.9:.7f};{1e3 * far:.4f}\n")
        found, why = settled(
            "t.txt", "".join(lines).encode(), said, [ReflectorSet("[base_frame]", places)]
        )
        assert found.horizontal == sense
        assert len(why) == (sense is not None)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", KINDS)
def test_the_demo_is_read_from_every_kind(name, ours):
    """Names and states unchanged, positions to the digits written, times if present."""
    kind = KINDS[name]
    got = read(kind)
    for word in ("group", "target", "pose", "repeat", "state"):
        assert got[word].to_pylist() == ours[word].to_pylist()
    place, there = (
        np.column_stack([t[f"{axis}_m"].to_numpy() for axis in "xyz"]) for t in (got, ours)
    )
    off = np.linalg.norm(place - there, axis=1)
    digits = math.sqrt(2) * TURN_DIGIT * np.linalg.norm(there, axis=1) if kind.angles else 0.0
    times = [None] * len(ROWS)
    if kind.time:
        times = [datetime.strptime(when(row, kind.time), kind.time) for row in ROWS]

    assert len(off) == len(ROWS)
    assert (off <= 1.001 * (digits + math.sqrt(3) * HALF_A_DIGIT)).all()
    assert got["time"].to_pylist() == times
