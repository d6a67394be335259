"""A small raw campaign, written as text here, and everything that can be wrong with it."""

import re

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.check.findings import treated_findings
from pipeline.machine.instrument import InstrumentNoise, beam_covariance
from pipeline.machine.robot import load
from pipeline.reduction.ingest import ingest
from pipeline.reduction.settings import parse
from pipeline.run import ingested
from pipeline.store.campaign import in_memory

TOML = """
format = 1
name = "small"
robot = "kr500_rail"
[tracker]
files = ["tracker.csv"]
sigma_m = 3.0e-5
[base_frame]
B1 = [0.6, -0.5, -0.30]
B2 = [0.6, 18.5, -0.30]
B3 = [-0.6, 18.5, -0.28]
[scale]
sigma_n = 2.0
[tool]
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]
"""
LOADS = "pose,repeat,force_n,branch\n1,1,702.31,up\n1,2,1403.5,up\n2,1,698.0,down\n"
JOINTS = (
    "pose,r1_m,theta2_deg,theta3_deg,theta4_deg,theta5_deg,theta6_deg,theta7_deg,approach\n"
    "1,5.3,-37.3,50,10,20,30,-82.2,1\n2,7.5,-10,35,39,81,22,-10,-1\n"
)
TOOL = {"P1": (200, 50, 120), "P2": (-120, 190, 100), "P3": (-100, -180, 220)}
BASE = {"B1": (600, -500, -300), "B2": (600, 18500, -300), "B3": (-600, 18500, -280)}
CHAIN = {"Pl1": (150, 0, 250), "Pl2": (150, 0, -350)}
AT = (1150.0, 0.0, 250.0)
"""A point near the chain [mm]."""


def tracker_rows():
    """Group, target and coordinates [mm] of a campaign of two poses with three pulls."""
    rows = [("base_start", name, *at) for name, at in BASE.items()]
    for pose, offset in ((1, 1000.0), (2, 2000.0)):
        for repeat in range(3 if pose == 1 else 2):
            group = f"pose{pose:02d}_rep{repeat}_{'loaded' if repeat else 'unloaded'}"
            for name, (x, y, z) in {**TOOL, **(CHAIN if repeat else {})}.items():
                rows.append((group, name, x + offset + repeat * 0.5, y + 0.0625, z))
    return rows


def tracker_csv(rows=None):
    """The plain CSV of some rows."""
    start = "2026-11-03T08:"
    lines = [
        f"{g},{t},{x:.4f},{y:.4f},{z:.4f},{start}{k // 60:02d}:{k % 60:02d}"
        for k, (g, t, x, y, z) in enumerate(rows or tracker_rows())
    ]
    return "\n".join(["group,target,x_mm,y_mm,z_mm,time", *lines, ""])


def read(tracker=None, toml=TOML, loads=LOADS, joints=JOINTS, **more):
    """Ingest the campaign with some files replaced; None omits a file."""
    raw = {
        "tracker.csv": tracker or tracker_csv(),
        "loads.csv": loads,
        "joints.csv": joints,
        **more,
    }
    raw = {
        name: content.encode() if isinstance(content, str) else content
        for name, content in raw.items()
        if content is not None
    }
    settings = parse(toml)
    return ingest(settings, load(settings.robot), raw)


def change(**files):
    """Differences from the clean campaign."""
    return files


def reasons(got):
    """File, line and reason of all rejections."""
    return [tuple(row.values()) for row in got.rejected.to_pylist()]


def line_of(text, *words):
    """Number of the only line that contains all these words."""
    (number,) = [n for n, line in enumerate(text.splitlines(), 1) if all(w in line for w in words)]
    return number


def without(text, *words):
    """The text without the only line that contains all these words."""
    lines = text.splitlines(keepends=True)
    del lines[line_of(text, *words) - 1]
    return "".join(lines)


def test_a_clean_campaign_is_read_whole():
    """Every reading, force and joint value arrives, in SI, with its line."""
    got = read()
    readings = got.readings.to_pandas()

    assert reasons(got) == []
    assert len(readings) == len(tracker_rows())
    row = readings[(readings.target == "Pl2") & (readings.repeat == 2)].iloc[0]
    assert (row.x_m, row.y_m, row.z_m) == (1.151, 0.0000625, -0.35)
    assert (row.pose, row.state, row.line) == (1, "loaded", line_of(tracker_csv(), "rep2", "Pl2"))
    assert str(row.time) == "2026-11-03 08:00:15"
    assert (
        readings[readings.group == "base_start"][["pose", "repeat", "state"]].isna().all(axis=None)
    )
    assert got.loads.to_pydict()["force_n"] == [702.31, 1403.5, 698.0]
    joints = got.joints.to_pandas()
    assert joints.r1_m.tolist() == [5.3, 7.5]
    assert joints.theta7_rad.tolist() == pytest.approx(
        [np.radians(-82.2), np.radians(-10)], rel=1e-15
    )
    assert joints.approach.tolist() == [1, -1]


@pytest.mark.parametrize(
    ("noise", "source", "variance"),
    [
        ("sigma_m = 3.0e-5", "stated", (9e-10, 9e-10, 9e-10)),
        ('noise = "paper"', "paper", (2.25e-10, 2.25e-10, 4.5e-10)),
        ("", "none", (np.nan,) * 3),
    ],
)
def test_the_stated_noise_is_the_covariance_of_every_reading(noise, source, variance):
    """The noise in [tracker] is assigned to each reading, with its origin."""
    readings = read(toml=TOML.replace("sigma_m = 3.0e-5", noise)).readings.to_pandas()

    assert set(readings.covariance_from) == {source}
    np.testing.assert_allclose(
        readings[["cxx_m2", "cyy_m2", "czz_m2"]], np.tile(variance, (len(readings), 1)), rtol=1e-12
    )


def test_the_instrument_model_turns_with_the_beam():
    """A reading straight above the tracker has only the range component along z."""
    noise = "range_m = 1e-5, range_per_m = 1e-6, transverse_m = 2e-5, transverse_per_m = 5e-6"
    rows = [*tracker_rows(), ("base_end", "B1", 0.0, 0.0, 2000.0)]
    got = read(tracker_csv(rows), toml=TOML.replace("sigma_m = 3.0e-5", f"noise = {{ {noise} }}"))
    row = got.readings.to_pandas().iloc[-1]

    assert row.covariance_from == "instrument"
    assert np.sqrt([row.cxx_m2, row.cyy_m2, row.czz_m2]) == pytest.approx([3e-5, 3e-5, 1.2e-5])
    assert [row.cxy_m2, row.cxz_m2, row.cyz_m2] == pytest.approx([0, 0, 0], abs=1e-20)


def test_a_reading_at_the_instrument_has_no_beam():
    """Without a direction, the larger component applies isotropically."""
    noise = InstrumentNoise(range_m=2e-5, transverse_m=1e-5)

    assert beam_covariance(np.zeros((1, 3)), noise)[0] == pytest.approx(
        [4e-10, 0, 0, 4e-10, 0, 4e-10]
    )


def test_spatial_analyzer_gives_the_same_readings():
    """The same campaign as SpatialAnalyzer writes it."""
    lines = [f"A::{g}::{t}, {x:.4f}, {y:.4f}, {z:.4f}" for g, t, x, y, z in tracker_rows()]
    text = "\r\n".join(["// Job: small", "// Units: mm", *lines, ""])
    columns = ["group", "target", "pose", "repeat", "state", "x_m", "y_m", "z_m"]

    plain = read().readings.select(columns)
    assert read(text).readings.select(columns).equals(plain)


@pytest.mark.parametrize(
    "written",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: text.encode("utf-16"),
        lambda text: text.replace(",", ";").replace(".", ","),
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace("P1,", '"P1",'),
        lambda text: text.replace("P1,", "P1 ,  "),
        lambda text: text.replace("x_mm", "X_MM"),
    ],
    ids=["crlf", "cr", "bom", "utf16", "semicolon", "tab", "quotes", "blanks", "capitals"],
)
def test_how_a_program_writes_does_not_matter(written):
    """Line ends, encodings, delimiters, quotes: the same readings."""
    assert read(written(tracker_csv())).readings.equals(read().readings)


def test_blank_lines_do_not_shift_line_numbers():
    """The line of a reading is the one an editor shows."""
    text = tracker_csv().replace("base_start,B2", "\n   \nbase_start,B2")
    numbers = read(text).readings.to_pydict()["line"]

    assert numbers[:3] == [2, 5, 6]


def test_latin_1_names_are_read():
    """A group name with an umlaut in cp1252."""
    rows = [
        ("Sockel für Basis", *row[1:]) if row[0] == "base_start" else row for row in tracker_rows()
    ]
    groups = read(tracker_csv(rows).encode("cp1252")).readings.to_pydict()["group"]

    assert groups[0] == "Sockel für Basis"


# --- a row is lost, the rest stays ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,nan", "not a number"),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,inf", "not a number"),
        (
            "pose01_rep2_loaded,P2,881.0000",
            "pose01_rep2_loaded,P2,881,0000",
            "decimal point belongs",
        ),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,88l.0000", "not a number"),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,8_81.0000", "not a number"),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,", "has nothing in column x_mm"),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,1e999", "too large"),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,-1e160", "too large"),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2,1e20", "than 1 000 km"),
        (
            "pose01_rep2_loaded,P2,881.0000",
            "pose01_rep2_loaded,,881.0000",
            "nothing in column target",
        ),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P2", "has 5 fields where 6"),
        ("pose01_rep2_loaded,P2,881.0000", "pose01_rep2_loaded,P4,881.0000", "neither in naming"),
        (
            "pose01_rep2_loaded,P2,881.0000",
            "pose01_rep2_loade,P2,881.0000",
            "does not match naming.group",
        ),
    ],
)
def test_a_bad_row_is_left_out_and_named(old, new, said):
    """One bad row costs only that reading; its line and the reason are listed."""
    clean = tracker_csv()
    assert old in clean
    got = read(clean.replace(old, new))
    bad = [r for r in reasons(got) if said in r[2]]

    assert [r[:2] for r in bad] == [("tracker.csv", line_of(clean, "rep2_loaded", "P2"))]
    kept, whole = got.readings.to_pydict()["line"], read().readings.to_pydict()["line"]
    assert sorted(set(whole) - set(kept)) == [bad[0][1]]
    assert len(got.loads) == 3


def test_a_target_of_which_every_reading_bears_another_name_is_said_to_have_none():
    """The readings of the others are used without it; with one reading left it is there."""
    clean = tracker_csv()

    assert read(clean).lost.absent == ()
    assert read(clean.replace(",P2,", ",P4,")).lost.absent == ("P2",)
    assert read(clean.replace(",P2,", ",P4,", 1)).lost.absent == ()


def test_a_header_that_comes_again_is_named_as_such():
    """A program that appends writes one each time; the rows below it are used."""
    header, *rows = tracker_csv().splitlines()
    got = read("\n".join([header, *rows[:7], header, *rows[7:], ""]))

    assert reasons(got) == [("tracker.csv", 9, "the header comes again; remove the row")]
    assert len(got.readings) == len(rows)


def test_a_force_beyond_any_scale_is_left_out():
    """1e20 N would dominate every other pull."""
    got = read(loads=LOADS.replace("702.31", "7e20"))

    assert ("loads.csv", 2) in [r[:2] for r in reasons(got) if "larger than any" in r[2]]


@pytest.mark.parametrize("force", ["0", "1e-320", "1e-9"])
def test_a_force_that_is_none_is_left_out(force):
    """A pull without a force has no direction."""
    got = read(loads=LOADS.replace("702.31", force))

    assert ("loads.csv", 2) in [r[:2] for r in reasons(got) if "not above zero" in r[2]]


@pytest.mark.parametrize("log", ["loads", "joints"])
def test_a_log_with_its_header_only_is_named(log):
    """It contains nothing, and the message says which file that is."""
    header = {"loads": LOADS, "joints": JOINTS}[log].splitlines()[0]
    with pytest.raises(InputError, match=rf"{log}\.csv: there is no row in it"):
        read(**{log: header + "\n"})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("P1 = [0.20", "P1 = [1e160", r"tool\.P1.*1e\+160 should be at most"),
        (
            "[scale]",
            "[payload.a]\nmass_kg = 1.0\ncenter_m = [0, 250.0, 0]\n[scale]",
            r"payload\.a\.center_m: .*250 m is on no effector",
        ),
        ("B2 = [0.6", "B2 = [-1e308", r"base_frame\.B2.*-1e\+308 should be at least"),
        ("sigma_m = 3.0e-5", "sigma_m = 1e160", r"tracker\.sigma_m: 1e\+160 should be at most"),
        ("sigma_m = 3.0e-5", "sigma_m = 1e-320", r"tracker\.sigma_m: .* is as good as zero"),
        ("sigma_n = 2.0", "sigma_n = 1e12", r"scale\.sigma_n: .* should be at most"),
        ("sigma_n = 2.0", "sigma_rel = 1e12", r"scale\.sigma_rel: .* should be less than"),
        ("P2 = [-0.12, 0.19, 0.10]", "P2 = [0.20, 0.05, 0.12]", "P1, P2 in one place"),
        ("[scale]", '[naming]\nmeasured = ["P1", "P2", "P2", "P3"]\n[scale]', "has P2 twice"),
        ("[scale]", '[naming]\nchain = ["Pl1", "Pl1"]\n[scale]', "has Pl1 twice"),
        (
            "[scale]",
            '[naming]\nchain = ["P1", "P2"]\n[scale]',
            '"P1" is in naming.measured and',
        ),
        ("B1 =", "P3 =", r'"P3" is in naming.measured and in \[base_frame\]'),
    ],
)
def test_settings_say_what_no_hall_has(old, new, said):
    """Values beyond all bounds, and reflectors with two positions."""
    assert old in TOML
    with pytest.raises(InputError, match=said):
        parse(TOML.replace(old, new, 1))


def test_an_unreadable_time_costs_its_row():
    """A row with a damaged time is not used."""
    clean = tracker_csv()
    got = read(clean.replace("2026-11-03T08:00:05", "2026-11-33T08:00:05"))

    assert [r[1] for r in reasons(got) if "not a time" in r[2]] == [line_of(clean, "08:00:05")]


def test_a_missing_target_is_said_and_the_others_used():
    """P2 missing in one pull: its other targets are used."""
    text = without(tracker_csv(), "rep2_loaded", "P2")
    got = read(text)
    raw = in_memory({"campaign.toml": TOML.encode(), "tracker.csv": text.encode(),
                     "loads.csv": LOADS.encode(), "joints.csv": JOINTS.encode()})  # fmt: skip

    assert not reasons(got)  # nothing was left out
    assert treated_findings(ingested(raw, plausible=False)) == [
        "P2 was not read in pose 1 pull 2: the other targets are used there."
    ]
    assert len(got.readings) == len(tracker_rows()) - 1


def test_a_missing_zero_costs_its_target_only():
    """P2 was not read unloaded in pose 1: its two loaded readings are rejected."""
    text = without(tracker_csv(), "pose01_rep0", "P2")
    got = read(text)

    lines = [line_of(text, f"pose01_rep{k}", "P2") for k in (1, 2)]
    assert [r[1] for r in reasons(got) if "P2 was not read unloaded in pose 1" in r[2]] == lines
    assert not set(lines) & set(got.readings.to_pydict()["line"])


@pytest.mark.parametrize(
    ("changed", "pull", "said"),
    [
        (
            change(tracker=without(tracker_csv(), "rep2_loaded", "Pl2")),
            (1, 2),
            "no loaded reading of Pl2",
        ),
        (
            change(
                tracker=tracker_csv(
                    [
                        (*r[:2], *AT) if r[1] in CHAIN and "1_rep2" in r[0] else r
                        for r in tracker_rows()
                    ]
                )
            ),
            (1, 2),
            "no distance between Pl1 and Pl2",
        ),
        (change(loads=without(LOADS, "1,2,")), (1, 2), "pose 1 repeat 2 has no force in loads.csv"),
        (change(joints=without(JOINTS, "2,7.5")), (2, 1), "pose 2 has no row in joints.csv"),
        (change(joints=JOINTS.replace(",35,", ",235,")), (2, 1), "joint theta3 is at 235 deg, 1"),
        (change(loads=LOADS.replace("698.0", "-698.0")), (2, 1), "force is not above zero"),
        (
            change(
                tracker=tracker_csv([r for r in tracker_rows() if r[0] != "pose02_rep0_unloaded"])
            ),
            (2, 1),
            "pose 2 has no unloaded reading",
        ),
    ],
    ids=["chain", "ends in one place", "load", "joints", "limits", "negative force", "zero"],
)
def test_an_incomplete_pull_goes_as_a_whole(changed, pull, said):
    """A pull without chain, force, joints or zero is rejected; the others stay."""
    got = read(**changed)
    loads, readings = got.loads.to_pandas(), got.readings.to_pandas()

    assert any(said in reason for _, _, reason in reasons(got))
    assert len(loads) == 2
    assert pull not in set(zip(loads.pose, loads.repeat, strict=True))
    loaded = readings[readings.state == "loaded"]
    assert pull not in set(zip(loaded.pose, loaded.repeat, strict=True))
    assert all(";" in reason for _, _, reason in reasons(got)), "each reason has its way out"


def test_a_load_without_reading_is_left_out():
    """loads.csv has a pull that the tracker never saw."""
    got = read(loads=LOADS + "2,7,500.0,up\n")

    assert [(f, n) for f, n, _ in reasons(got)] == [("loads.csv", 5)]
    assert "pose 2 repeat 7 has no usable loaded tracker reading" in reasons(got)[0][2]


def test_equal_copies_are_kept_once():
    """The same line twice: one is kept, the other listed."""
    text = tracker_csv()
    copy = text.splitlines()[line_of(text, "rep2_loaded", "P2") - 1]
    got = read(text + copy + "\n")

    assert [r[:2] for r in reasons(got)] == [("tracker.csv", len(text.splitlines()) + 1)]
    assert got.readings.equals(read().readings)


def test_contradicting_duplicates_are_both_left_out():
    """The same target twice with other coordinates: neither can be trusted."""
    text = tracker_csv() + "pose01_rep2_loaded,P2,882.0,190.0,100.0,2026-11-03T09:00:00\n"
    got = read(text)

    lines = [line_of(text, "rep2_loaded", "P2", "881.0"), len(text.splitlines())]
    assert [r[1] for r in reasons(got) if "contradicts" in r[2]] == lines
    assert not set(lines) & set(got.readings.to_pydict()["line"])


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("name", ["pose01_rep0_unloaded", "pose01_rep3_unloaded"])
def test_a_zero_after_the_pulls_may_have_the_name_of_the_one_before(name, timed):
    """As in the protocol's sheet: both are zeros of the pose, by time or by order of rows."""
    again = [(name, t, x + 1000.002, y + 0.0625, z) for t, (x, y, z) in TOOL.items()]
    rows = tracker_rows()
    last = max(k for k, row in enumerate(rows) if row[0].startswith("pose01"))
    text = tracker_csv([*rows[: last + 1], *again, *rows[last + 1 :]])
    if not timed:
        text = "".join(f"{line.rpartition(',')[0]},\n" for line in text.splitlines()[1:])
        text = "group,target,x_mm,y_mm,z_mm,time\n" + text
    got = read(text)

    assert got.rejected.num_rows == 0
    zeros = got.readings.to_pandas()
    zeros = zeros[(zeros.state == "unloaded") & (zeros.pose == 1)]
    assert zeros.groupby("repeat").size().tolist() == [3, 3]
    assert zeros.groupby("repeat").line.min().is_monotonic_increasing
    before, after = (part.x_m.to_numpy() for _, part in zeros.groupby("repeat"))
    np.testing.assert_allclose(after - before, 2e-6, atol=1e-9)


def test_a_zero_read_twice_at_once_contradicts_itself():
    """Nothing lies between the two, so that one of them must be wrong."""
    rows = tracker_rows()
    text = tracker_csv([*rows[:6], ("pose01_rep0_unloaded", "P2", 881.0, 190.0, 100.0), *rows[6:]])
    got = read(text)

    assert [line for _, line, why in reasons(got) if "contradicts" in why] == [6, 8]


def test_base_reflectors_may_be_read_again_and_again():
    """Two readings of B1 in one group are two readings."""
    text = tracker_csv() + "base_start,B1,600.01,-500.0,-300.0,2026-11-03T09:00:00\n"
    got = read(text)

    assert reasons(got) == []
    assert len(got.readings) == len(tracker_rows()) + 1


def test_a_true_copy_of_a_base_reading_is_one_reading():
    """The same line of a base reflector twice, time included, is a copy."""
    text = tracker_csv()
    got = read(text + text.splitlines()[2] + "\n")

    assert [(n, "repeats tracker.csv:3" in why) for _, n, why in reasons(got)] == [(26, True)]
    assert got.readings.equals(read().readings)


def test_the_order_of_loads_does_not_matter():
    """Rows of loads.csv and joints.csv may stand in any order."""
    header, *rows = LOADS.splitlines()
    got = read(loads="\n".join([header, *rows[::-1], "1,9,5.0,up", ""]))

    assert [n for _, n, _ in reasons(got)] == [5]
    assert got.loads.to_pandas().force_n.tolist() == [698.0, 1403.5, 702.31]


def test_a_cut_off_last_line_is_not_believed():
    """A file that ends inside a number, `-350.00`, may have lost digits."""
    text = "\n".join(line.rsplit(",", 1)[0] for line in tracker_csv().splitlines())
    got = read(text[:-2])

    assert "ends inside this line" in " ".join(r[2] for r in reasons(got))
    assert (2, 1) not in set(
        zip(*(got.loads.to_pydict()[k] for k in ("pose", "repeat")), strict=True)
    )


# --- nothing can be trusted -----------------------------------------------------------------------


SCALED = {
    "mm taken for m": lambda text: text.replace("_mm", "_m"),
    "m taken for mm": lambda text: tracker_csv(
        [(g, t, x / 1e3, y / 1e3, z / 1e3) for g, t, x, y, z in tracker_rows()]
    ),
    "mm taken for in": lambda text: text.replace("_mm", "_in"),
}


@pytest.mark.parametrize("scaled", SCALED.values(), ids=SCALED)
def test_a_wrong_unit_is_refused(scaled):
    """Reflector distances that are off by 1000 or 25.4 stop the campaign."""
    with pytest.raises(InputError, match=r"tracker.csv:\d+: .*times too (large|small).*unit"):
        read(scaled(tracker_csv()))


def test_a_wrong_unit_in_one_file_of_two_is_refused():
    """Base reflectors in m and poses in mm, both declared as mm."""
    rows = tracker_rows()
    base = tracker_csv([(g, t, x / 1e3, y / 1e3, z / 1e3) for g, t, x, y, z in rows[:3]])
    toml = TOML.replace('["tracker.csv"]', '["t*.csv"]')
    with pytest.raises(InputError, match=r"t2.csv:2: .*1000 times too small"):
        read(tracker_csv(rows), toml=toml, **{"t2.csv": base})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (change(loads=None), r"loads.csv: the file is missing; .* \[scale\] of campaign.toml"),
        (change(joints=None), r"joints.csv: the file is missing; .* \[joints\] of campaign.toml"),
        (change(toml=TOML.replace('["tracker.csv"]', '["other.csv"]')), "other.csv: .*missing; "),
        (change(tracker=" \n"), "tracker.csv: the file is empty; "),
        (change(loads=""), "loads.csv: the file is empty; "),
        (
            change(tracker=tracker_csv().replace("z_mm", "w_mm")),
            "tracker.csv:1: .*no column z_mm.*; ",
        ),
        (change(loads=LOADS.replace("force_n", "force")), "loads.csv:1: .*does not say its unit; "),
        (change(loads=LOADS.replace("force_n", "f")), "loads.csv:1: .*no column force_n.*; "),
        (
            change(joints=JOINTS.replace("theta4_deg", "t4")),
            "joints.csv:1: .*no column theta4_deg.*; ",
        ),
        (
            change(joints=JOINTS.replace(",50,", ",250,").replace(",35,", ",235,")),
            "joints.csv:2: pose 1: joint theta3 is at 250 deg.*; ",
        ),
        (
            change(tracker=tracker_csv(tracker_rows()[1:])),
            "tracker.csv: only 2 base reflectors.*; ",
        ),
        (
            change(
                tracker=tracker_csv(
                    [(g, t, *(3 * c for c in place)) for g, t, *place in tracker_rows()]
                )
                .replace("x_mm", "x")
                .replace("y_mm", "y")
                .replace("z_mm", "z")
            ),
            "unit",
        ),
        (
            change(tracker=tracker_csv().replace("x_mm", "x_m")),
            "tracker.csv:1: .*different units.*; ",
        ),
        (change(tracker="some;text\n"), "tracker.csv:1: .*none of plain CSV.*; "),
        (change(tracker=b"group,target\0"), "not text"),
        (change(tracker=tracker_csv() + "x" * 20000), "tracker.csv:.*20000 bytes, more than.*; "),
        (
            change(tracker=tracker_csv(tracker_rows()[:3])),
            "no group of the export is a loaded state",
        ),
        (change(tracker=tracker_csv().replace("Pl2", "Pl3")), "nothing usable is left"),
    ],
)
def test_what_cannot_be_trusted_is_refused_in_one_sentence(changed, message):
    """A broken file or an empty campaign: file, line, problem and way out."""
    with pytest.raises(InputError, match=message) as refused:
        read(**changed)

    assert "\n" not in str(refused.value)
    assert refused.value.way_out


# --- joint logs -----------------------------------------------------------------------------------


def test_controller_axes_are_translated():
    """A log of KUKA's axes gives the same joint values as the model's own angles."""
    toml = TOML.replace('"kr500_rail"', '"kr500_rail_kuka"')
    own = "pose,r1_mm,theta2_rad,theta3_deg,theta4_deg,theta5_deg,theta6_deg,theta7_deg\n"
    a, b = (float(np.radians(angle)) for angle in (-37.3, -10))
    own += f"1,5300,{a!r},50,10,20,30,-82.2\n2,7500,{b!r},35,39,81,22,-10\n"
    axes = "pose,E1_m,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg\n"
    axes += "1,5.3,37.3,-50,80,-20,-30,82.2\n2,7.5,10,-35,51,-81,-22,10\n"

    a, b = (read(toml=toml, joints=text).joints.to_pandas().iloc[:, 1:8] for text in (own, axes))
    np.testing.assert_allclose(a, b, rtol=1e-14)
    assert a.iloc[0, 1] == pytest.approx(np.radians(-37.3))


# --- already reduced ------------------------------------------------------------------------------

REDUCED = (
    TOML[: TOML.index("[tracker]")] + "[displacements]\nSIGMA\n" + TOML[TOML.index("[tool]") :]
)
MOVED = "pose,repeat,target,dx_m,dy_m,dz_m\n1,1,P1,1e-3,2e-3,-3e-3\n2,1,P1,2e-3,1e-3,-1e-3\n"
FORCES = "pose,repeat,fx_n,fy_n,fz_n\n1,1,10,20,-30\n2,1,15,25,-35\n"


@pytest.mark.parametrize(("sigma", "variance"), [("sigma_m = 2e-5", 4e-10), ("", np.nan)])
def test_a_reduced_campaign_arrives(sigma, variance):
    """Displacements and forces are used as given; without sigma_m their covariance is NaN."""
    got = read(
        toml=REDUCED.replace("SIGMA", sigma), **{"displacements.csv": MOVED, "forces.csv": FORCES}
    )
    moved, forces = got.displacements.to_pandas(), got.forces.to_pandas()

    assert moved[["dx_m", "dy_m", "dz_m"]].to_numpy().tolist() == [
        [1e-3, 2e-3, -3e-3],
        [2e-3, 1e-3, -1e-3],
    ]
    np.testing.assert_allclose(moved.loaded_cyy_m2, [variance] * 2, rtol=1e-12)
    assert (moved[[c for c in moved if c.endswith("_m2") and c.startswith("zero")]] == 0).all(
        axis=None
    )
    assert forces[["fx_n", "fy_n", "fz_n"]].to_numpy().tolist() == [[10, 20, -30], [15, 25, -35]]
    assert len(got.readings) == len(got.loads) == len(got.rejected) == 0


def test_a_reduced_pull_without_force_is_left_out():
    """A displacement without its force is listed; the other stays."""
    files = {"displacements.csv": MOVED, "forces.csv": FORCES.replace("2,1,", "2,2,")}
    got = read(toml=REDUCED.replace("SIGMA", ""), **files)

    assert [(f, n) for f, n, _ in reasons(got)] == [
        ("displacements.csv", 3),
        ("forces.csv", 3),
        ("joints.csv", 3),
    ]
    assert len(got.displacements) == len(got.forces) == 1


# --- exports without names ------------------------------------------------------------------------


def nameless(rows=None):
    """The campaign as a semicolon .xyz without names."""
    return "".join(f"{x:.4f};{y:.4f};{z:.4f}\n" for _, _, x, y, z in rows or tracker_rows())


def assignment(rows=None):
    """Which row of it is what."""
    lines = ["order,pose,repeat,state,target"]
    for order, (group, target, *_) in enumerate(rows or tracker_rows(), 1):
        pose, repeat, state = re.findall(r"pose0*(\d+)_rep(\d+)_(\w+)|$", group)[0] or ("",) * 3
        lines.append(f"{order},{pose},{repeat},{state},{target}")
    return "\n".join([*lines, ""])


NAMELESS = TOML.replace('["tracker.csv"]', '["tracker.csv"]\nunit = "mm"\nassignment = "rows.csv"')


def test_an_assignment_names_the_rows_of_an_export():
    """Readings without names become those of the original campaign, row by row."""
    columns = ["target", "pose", "repeat", "state", "x_m", "y_m", "z_m"]
    got = read(nameless(), toml=NAMELESS, **{"rows.csv": assignment()})

    assert got.readings.select(columns).equals(read().readings.select(columns))


def test_a_bad_row_does_not_shift_the_assignment():
    """A row that cannot be read affects only itself; later rows keep their names."""
    bad = nameless().replace("881.0000;190", "nan;190")
    got = read(bad, toml=NAMELESS, **{"rows.csv": assignment()}).readings.to_pandas()
    whole = read(nameless(), toml=NAMELESS, **{"rows.csv": assignment()}).readings.to_pandas()

    left = whole[~((whole.target == "P2") & (whole.repeat == 2))].reset_index(drop=True)
    assert got.drop(columns="time").equals(left.drop(columns="time"))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (change(rows=None), "rows.csv: the file is missing; "),
        (change(rows=without(assignment(), "5,1,0")), r"has 24 rows but rows.csv assigns 23.*; "),
        (
            change(rows=assignment() + "25,2,2,loaded,P1\n"),
            r"has 24 rows but rows.csv assigns 25.*; ",
        ),
        (
            change(rows=assignment().replace("\n5,", "\n4,")),
            "rows.csv:5: lines 5, 6 contradict.*; ",
        ),
        (
            change(rows=assignment().replace("\n5,", "\n99,")),
            "rows.csv: .*does not say what row 5 of.*; ",
        ),
        (
            change(rows=assignment().replace("loaded", "laden", 1)),
            "rows.csv:5: .*neither loaded nor.*; ",
        ),
        (change(rows="order,group\n1,a\n"), "rows.csv:1: there is no column target.*; "),
        (change(rows="order,target\n1,a\n"), "rows.csv:1: there is neither a column group.*; "),
        (
            change(toml=NAMELESS.replace('assignment = "rows.csv"', "")),
            "have no names; .*assignment",
        ),
    ],
    ids=["missing", "short", "long", "twice", "gap", "state", "target", "group", "none"],
)
def test_an_assignment_that_does_not_fit_is_refused(changed, message):
    """No reading is assigned by guessing."""
    rows = changed.get("rows", assignment())
    with pytest.raises(InputError, match=message):
        read(nameless(), toml=changed.get("toml", NAMELESS), **{"rows.csv": rows})


def test_names_of_one_piece_are_taken_apart():
    """A Tracker Pilot export with one name per reading, and an expression that splits it."""
    lines = [f"{g}-{t};{x};{y};{z}" for g, t, x, y, z in tracker_rows()]
    text = "\n".join(["Point Name;X [mm];Y [mm];Z [mm]", *lines, ""])
    toml = TOML.replace("[base_frame]", "names = '(?P<group>.+)-(?P<target>[^-]+)'\n[base_frame]")
    columns = ["group", "target", "pose", "repeat", "state", "x_m", "y_m", "z_m"]

    assert read(text, toml=toml).readings.select(columns).equals(read().readings.select(columns))


def test_covariances_of_the_file_come_first():
    """U(95) of a reading is used if given, otherwise sigma_m."""
    lines = [f"{g};{t};{x};{y};{z};0,02;0,04;0,06;" for g, t, x, y, z in tracker_rows()]
    lines = [line.replace(".", ",") for line in lines]
    lines[3] = lines[3].replace("0,02;0,04;0,06", ";;")
    axes = ";".join(f"{axis} [mm]" for axis in "XYZ")
    header = f"Group;Name;{axes};U(95) X [mm];U(95) Y [mm];U(95) Z [mm];"
    readings = read("\n".join([header, *lines, ""])).readings.to_pandas()

    assert readings.covariance_from.tolist()[2:5] == ["file", "stated", "file"]
    assert readings.cyy_m2[2] == pytest.approx((2e-5) ** 2)
    assert readings.cyy_m2[3] == pytest.approx((3e-5) ** 2)


def test_three_uncertainties_of_a_beam_are_read_as_those_of_a_beam():
    """The correlations of the axes, which the tracker's software omits, are restored."""
    noise = InstrumentNoise(
        range_m=5e-6, range_per_m=0.0, transverse_m=1.5e-5, transverse_per_m=6e-6
    )
    rows = tracker_rows()
    whole = beam_covariance(1e-3 * np.array([row[2:] for row in rows]), noise)
    std = 1e3 * np.sqrt(whole[:, [0, 3, 5]])
    head, *lines = tracker_csv(rows).splitlines()
    lines = [",".join([line, *(f"{v:.5f}" for v in s)]) for line, s in zip(lines, std, strict=True)]
    readings = read("\n".join([head + ",std_x_mm,std_y_mm,std_z_mm", *lines, ""])).readings
    table = readings.to_pandas()

    assert set(table.covariance_from) == {"file"}
    assert table.cxy_m2.to_numpy() == pytest.approx(whole[:, 1], rel=0.02, abs=1e-12)
    assert table.cyz_m2.to_numpy() == pytest.approx(whole[:, 4], rel=0.02, abs=1e-12)


SIGMA = "sigma_m = 3.0e-5\n"


def with_uncertainty(bare):
    """The campaign's export with 0.02 mm per axis, but none for some targets."""
    head, *lines = tracker_csv().splitlines()
    lines = [line + (",,," if line.split(",")[1] in bare else ",0.02,0.02,0.02") for line in lines]
    return "\n".join([head + ",std_x_mm,std_y_mm,std_z_mm", *lines, ""])


def test_a_chain_without_uncertainty_is_asked_for():
    """The targets have one and the chain's reflectors none: it is not guessed."""
    bare = with_uncertainty(["Pl1", "Pl2"])
    with pytest.raises(InputError) as refused:
        read(bare, toml=TOML.replace(SIGMA, ""))

    assert "no uncertainty, as others have" in str(refused.value)
    assert "state sigma_m in [tracker]" in str(refused.value)
    assert not read(bare).rejected.num_rows


def test_a_target_without_uncertainty_is_left_out_and_named():
    """P3 has none and is rejected; P1, P2 and the chain have one and are used."""
    got = read(with_uncertainty(["P3"]), toml=TOML.replace(SIGMA, ""))
    lost = [why for _, _, why in reasons(got) if "no uncertainty" in why]

    assert len(lost) == sum(target == "P3" for _, target, *_ in tracker_rows())
    assert set(got.readings["target"].to_pylist()) == {*BASE, *CHAIN, "P1", "P2"}


def test_no_uncertainty_anywhere_is_a_campaign_of_unstated_noise():
    """Nothing is rejected, and no covariance is invented."""
    got = read(with_uncertainty([*TOOL, *CHAIN, *BASE]), toml=TOML.replace(SIGMA, ""))

    assert not got.rejected.num_rows
    assert np.isnan(got.readings["cxx_m2"].to_numpy()).all()


def test_an_assignment_must_agree_with_the_names_there_are():
    """An export with targets but no groups: the assignment adds groups, and must agree."""
    rows = tracker_rows()
    text = "".join(f"{t};{x:.4f};{y:.4f};{z:.4f}\n" for _, t, x, y, z in rows)
    columns = ["target", "pose", "repeat", "state", "x_m", "y_m", "z_m"]
    got = read(text, toml=NAMELESS, **{"rows.csv": assignment()})

    assert got.readings.select(columns).equals(read().readings.select(columns))
    swapped = assignment().replace("unloaded,P2", "unloaded,P9", 1)
    with pytest.raises(
        InputError, match=r"tracker.csv:5: the export calls this reading P2, rows.csv"
    ):
        read(text, toml=NAMELESS, **{"rows.csv": swapped})


def test_base_reflectors_read_within_a_pose_are_base_readings():
    """B1 in the group of a pose belongs to the base, not to the pose."""
    rows = [*tracker_rows(), ("pose01_rep1_loaded", "B1", 600.0, -500.0, -300.0)]
    row = read(tracker_csv(rows)).readings.to_pandas().iloc[-1]

    assert row.group == "pose01_rep1_loaded"
    assert row[["pose", "repeat", "state"]].isna().all()


def test_base_readings_without_a_group_are_called_by_their_file():
    """Every sentence on them has a name to give."""
    lines = [f"{g.replace('base_start', '')}-{t};{x};{y};{z}" for g, t, x, y, z in tracker_rows()]
    text = "\n".join(["Point Name;X [mm];Y [mm];Z [mm]", *lines, ""])
    toml = TOML.replace("[base_frame]", "names = '(?P<group>.*)-(?P<target>[^-]+)'\n[base_frame]")
    table = read(text, toml=toml).readings.to_pandas()

    assert set(table[table["pose"].isna()]["group"]) == {"tracker.csv"}
    assert len(table) == len(lines)


def test_group_names_of_any_letters_are_read():
    """An expression with non-ASCII letters, which the fast matcher does not support."""
    rows = [
        (g.replace("pose", "Prüfung").replace("_loaded", "_loaded·"), *r)
        for g, *r in tracker_rows()
    ]
    group = r"\w+?0*(?P<pose>\d+)_rep(?P<repeat>\d+)_(?P<state>unloaded|loaded)\W?"
    toml = TOML.replace("[base_frame]", f"[naming]\ngroup = '{group}'\n[base_frame]")
    columns = ["target", "pose", "repeat", "state", "x_m"]

    assert (
        read(tracker_csv(rows), toml=toml)
        .readings.select(columns)
        .equals(read().readings.select(columns))
    )


@pytest.mark.parametrize(
    "group",
    [
        r"x|pose(?P<pose>[0-9]+)_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)",
        r"(pose)(?P<pose>[0-9]+)[\]_]rep(?P<repeat>[0-9]+)_(?P<state>unloaded|(l)oaded)",
        r"(?i)POSE(?P<pose>[0-9]+)_rep(?P<repeat>[0-9]+)_(?P<state>(?:un)?loaded)",
    ],
    ids=["alternatives", "parts without names", "flags"],
)
def test_any_expression_reads_groups_alike(group):
    """However it is written, and whatever other parts of a name it extracts."""
    toml = TOML.replace("[base_frame]", f"[naming]\ngroup = '{group}'\n[base_frame]")
    rows = [*tracker_rows(), ("again_pose01_rep2_loaded", "P1", 1201.0, 50.0, 120.0)]
    got = read(tracker_csv(rows), toml=toml)

    assert got.readings.equals(read().readings)
    assert ["does not match naming.group" in why for _, _, why in reasons(got)] == [True]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("unbelastet", 'states = { "unbelastet" = "unloaded" } into [naming]'),
        ("Last", 'states = { "Last" = "loaded" } into [naming]'),
        ("blue", 'states = { "blue" = ... } with "unloaded" or "loaded" into [naming]'),
    ],
)
def test_a_word_of_others_for_a_state_is_offered_in_its_own_sense(word, said):
    """What it means is not guessed where it is not known."""
    toml = TOML.replace(
        "[base_frame]",
        "[naming]\ngroup = 'pose(?P<pose>[0-9]+)_rep(?P<repeat>[0-9]+)_(?P<state>.+)'\n"
        "[base_frame]",
    )
    with pytest.raises(InputError, match=re.escape(said)):
        read(tracker_csv().replace("unloaded", word), toml=toml)
