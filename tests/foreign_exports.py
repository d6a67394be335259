"""Small files of the kinds found on a tracker's PC, with contents known by hand.

Numbers are invented; formats are those of programs. Positions are computed here with sines and
cosines, independently of the readers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

GON, DEG = math.pi / 200, math.pi / 180


@dataclass(frozen=True)
class Foreign:
    """One kind of file.

    Attributes:
        data: Its content.
        read: Whether it is read once `said` is stated; else it is asked, and `answers` settle it.
        said: What the file does not say and nobody can know.
        names: Group and target of each reading; None where the file has none.
        places: Coordinates of the readings [m].
        answers: What [tracker] has to say in the place of what was proposed first.
        facts: More that `inspect` says.
        tolerance: How well places agree [m].
    """

    data: bytes
    read: bool
    names: list[tuple[str | None, str | None]]
    places: list[tuple[float, float, float]]
    said: dict[str, str] = field(default_factory=dict)
    answers: dict[str, str] = field(default_factory=dict)
    facts: dict[str, object] = field(default_factory=dict)
    tolerance: float = 1e-9


def polar(far, azimuth, zenith):
    """End of a beam, from distance, azimuth and zenith angle [rad]."""
    level = far * math.sin(zenith)
    return (level * math.cos(azimuth), level * math.sin(azimuth), far * math.cos(zenith))


def mirrored(place):
    """Position from the same numbers if horizontal angles increase clockwise."""
    x, y, z = place
    return x, -y, z


def rows(*lines, end="\n"):
    """Lines as a file."""
    return "".join(line + end for line in lines)


MM = {"unit": "mm"}
TARGETS = [(None, name) for name in ("1", "2", "3", "1", "2", "3")]
ROUNDS = [
    (2.296497861, -2.416256713, -0.442566334),
    (2.331149279, -2.301256713, -0.401566334),
    (2.411149279, -2.391256713, -0.381566334),
    (3.296497861, -2.316256713, -0.442566334),
    (3.331149279, -2.201256713, -0.401566334),
    (3.411149279, -2.291256713, -0.381566334),
]
POSE = "pose01_rep1_loaded"
TWO = [(POSE, "P1"), (POSE, "P2")]
TWO_PLACES = [(4.6839307, 5.2825332, -0.5505429), (4.7839307, 5.1825332, -0.5305429)]
PREAMBLE = [
    "Instrument Report;;;;;;;;;;;;", "Job;Hall 3;;;;;;;;;;;", ";;;;;;;;;;;;",
    *[f"Line {k} of the report;;;;;;;;;;;;" for k in range(8)],
    "Instrument: A::0 - Leica AT960;;;;;;;;;;;;", ";;;;;;;;;;;;",
]  # fmt: skip
REPORT = (
    "Collection;Group;Target;Azimuth (gon);Elevation (gon);Distance (mm);Offset1 (mm);Offset2 (mm);"
    "Date & Time;;User;Active;"
)
SHOTS = [
    "A;Plate;1;-78,9632;103,2881;1171,729;11,113;11,113;01.03.2022 10:27;;;Yes;",
    "A;Plate;2;-70,1000;101,0000;1271,729;11,113;11,113;01.03.2022 10:28;;;No;",
    "A;Plate;3;-60,0000;98,0000;1371,729;11,113;11,113;01.03.2022 10:29;;;Yes;",
]
SHOT_PLACES = [
    polar(1.171729, -78.9632 * GON, 103.2881 * GON),
    polar(1.371729, -60 * GON, 98 * GON),
]
T_MAC = (
    "X  [mm],Y  [mm],Z  [mm],U(95)  [mm],U(95) X  [mm],U(95) Y  [mm],U(95) Z  [mm],Roll  [deg],"
    "Tilt  [deg],Q0 ,Q1 ,Q2 ,Q3 ,Time Stamp,Temperatur [°C],OTG Applied,Delete"
)
T_MAC_REST = "0.06,0.03,0.03,0.04,1,2,1,0,0,0"
LOG = (
    "Timestamp;Goal x;Goal y;Goal z;measurement_x;measurement_y;measurement_z;measurement_std_x;"
    "measurement_std_y;measurement_std_z;joint 1"
)
U = "0.02, 0.03, 0.04"
MATRIX = "0.0004, 0.0001, 0.0000, 0.0001, 0.0009, 0.0002, 0.0000, 0.0002, 0.0016"
P5 = [(-0.274556, -3.189212, -0.248113), (-1.374556, -3.289212, -0.148113)]
ROOM = [(1.651551699, 1.072124336, -0.265975287), (1.751551699, 2.072124336, -0.165975287)]
HZ = [polar(1.065984, -71.2831 * GON, 102.8494 * GON), polar(1.165984, -61 * GON, 98.5 * GON)]
STATION = [polar(58.876, 0.0, 96.9854 * GON), mirrored(polar(41.1, 25 * GON, 101.5 * GON))]
FIRST, SECOND = (1996.8235, 236.31352, 110.43128), (1996.8231, 36.31478, 289.56919)
FACES = [
    tuple(
        (a + b) / 2
        for a, b in zip(
            polar(FIRST[0] / 1e3, FIRST[1] * GON, FIRST[2] * GON),
            polar(SECOND[0] / 1e3, SECOND[1] * GON, SECOND[2] * GON),
            strict=True,
        )
    ),
    polar(1.796, 240 * GON, 95 * GON),
]

KINDS: dict[str, Foreign] = {
    "target only": Foreign(
        rows(*(f"{name},  {x * 1e3:.6f},  {y * 1e3:.6f},  {z * 1e3:.6f}"
               for (_, name), (x, y, z) in zip(TARGETS, ROUNDS, strict=True))).encode(),
        True, TARGETS, ROUNDS, MM, facts={"rounds": 2},
    ),
    "blanks": Foreign(
        rows("A pose01_rep1_loaded P1 4683.9307 5282.5332 -550.5429",
             "A pose01_rep1_loaded   P2   4783.9307 5182.5332   -530.5429").encode(),
        True, TWO, TWO_PLACES, MM,
    ),
    "blanks and colons": Foreign(
        rows("A::pose01_rep1_loaded::P1   4683.9307  5282.5332  -550.5429",
             "A::pose01_rep1_loaded::P2   4783.9307  5182.5332  -530.5429").encode(),
        True, TWO, TWO_PLACES, MM,
    ),
    "semicolon and comma": Foreign(
        rows(f"A::{POSE}::P1;4683,9307;5282,5332;-550,5429",
             f"A::{POSE}::P2;4783,9307;5182,5332;-530,5429").encode(),
        True, TWO, TWO_PLACES, MM,
    ),
    "tab and comma": Foreign(
        rows("A::pose01_rep1_loaded::P1\t4683,9307\t5282,5332\t-550,5429",
             "A::pose01_rep1_loaded::P2\t4783,9307\t5182,5332\t-530,5429").encode(),
        True, TWO, TWO_PLACES, MM,
    ),
    "German times": Foreign(
        rows(f"A::{POSE}::P1;4683,9307;5282,5332;-550,5429;03.11.2026 08:00:08",
             f"A::{POSE}::P2;4783,9307;5182,5332;-530,5429;03.11.2026 08:00:48").encode(),
        True, TWO, TWO_PLACES, MM, facts={"time_first": "2026-11-03T08:00:08"},
    ),
    "instrument report": Foreign(
        ("\ufeff" + rows(";;;;;;;;;;;;", *PREAMBLE, REPORT, *SHOTS, end="\r\n")).encode(),
        False, [("Plate", "1"), ("Plate", "3")], SHOT_PLACES, answers={"vertical": "zenith"},
        facts={"coordinates": "spherical", "time_first": "2022-03-01T10:27:00"},
    ),
    "uncertainties and covariance": Foreign(
        rows(f"A, {POSE}, P1, 4683.9307, 5282.5332, -550.5429, {U}, {MATRIX}",
             f"A, {POSE}, P2, 4783.9307, 5182.5332, -530.5429, {U}, {MATRIX}").encode(),
        True, TWO, TWO_PLACES, MM, facts={"covariance": "standard"},
    ),
    "two faces": Foreign(
        rows(*("\t".join(["Instrument_0", name, *cells]) for name, *cells in (
            ("PQ62_12", "236.31352", "110.43128", "1996.8235"),
            ("PQ62_12", "36.31478", "289.56919", "1996.8231"),
            ("PQ62_13", "240.00000", "95.00000", "1796.0000"),
        ))).encode(),
        False, [(None, "PQ62_12"), (None, "PQ62_13")], FACES, MM,
        answers={"horizontal": "counter-clockwise"},
        facts={"coordinates": "spherical", "angle": "gon"},
    ),
    "Hz V D": Foreign(
        rows("0\t-71,2831\t102,8494\t1065,984", "1\t-61,0000\t98,5000\t1165,984").encode(),
        False, [(None, "0"), (None, "1")], [*map(mirrored, HZ)], MM,
        answers={"coordinates": "spherical", "angle": "gon", "vertical": "zenith",
                 "horizontal": "clockwise"},
    ),
    "self-describing": Foreign(
        rows("# Format: spherical", "# Units: gon mm", "# Data",
             "P1 -71.2831 102.8494 1065.984", "P2 -61.0000 98.5000 1165.984").encode(),
        True, [(None, "P1"), (None, "P2")], HZ,
    ),
    "name x y z": Foreign(
        rows("P0   1651.551699   1072.124336   -265.975287",
             "P1   1751.551699   2072.124336   -165.975287").encode(),
        True, [(None, "P0"), (None, "P1")], ROOM, MM,
    ),
    "T-Mac without names": Foreign(
        rows(T_MAC,
             f"4683.9307,5282.5332,-550.5429,{T_MAC_REST},'03.11.2026 08:00:08,21,0,0",
             f"4783.9307,5182.5332,-530.5429,{T_MAC_REST},'03.11.2026 08:00:48,21,0,0",
             end="\r\n").encode("cp1252"),
        True, [(None, None)] * 2, TWO_PLACES, facts={"covariance": "expanded"},
    ),
    "empty tail": Foreign(
        rows("P5;-274.556;-3189.212;-248.113;;;;", "P6;-1374.556;-3289.212;-148.113;;;;",
             end="\r\n").encode(),
        True, [(None, "P5"), (None, "P6")], P5, MM,
    ),
    "robot's log": Foreign(
        rows(LOG, "1,604E+12;4684,1;5282,1;-550,1;4683,9307;5282,5332;-550,5429;0,02;0,02;0,03;1",
             "1,604E+12;4784;5182;-530;4783,9307;5182,5332;-530,5429;0,02;0,02;0,03;12,9",).encode(),
        True, [(None, None)] * 2, TWO_PLACES, MM,
        facts={"untimed": 'Timestamp ("1,604E+12")', "covariance": "standard"},
    ),
    "total station": Foreign(
        rows("SS,S1,0.0000,96.9854,58.876,1.800,", "SS,S2,25.0000,101.5000,41.100,1.800,").encode(),
        False, [("SS", "S1"), ("SS", "S2")], STATION, {"unit": "m"},
        answers={"angle": "gon", "vertical": "zenith"},
    ),
    "six degrees of freedom": Foreign(
        rows("X,Y,Z,Rx,Ry,Rz", "4683.9307,5282.5332,-550.5429,10,20,30",
             "4783.9307,5182.5332,-530.5429,11,21,31").encode(),
        True, [(None, None)] * 2, TWO_PLACES, MM, facts={"dialect": "table"},
    ),
    "joints and places": Foreign(
        rows("theta1_deg,theta2_deg,theta3_deg,x_mm,y_mm,z_mm",
             "10,20,30,4683.9307,5282.5332,-550.5429",
             "11,21,31,4783.9307,5182.5332,-530.5429").encode(),
        True, [(None, None)] * 2, TWO_PLACES, facts={"dialect": "table"},
    ),
    "index of pandas": Foreign(
        rows(",group,target,x_mm,y_mm,z_mm",
             f"0,{POSE},P1,4683.9307,5282.5332,-550.5429",
             f"1,{POSE},P2,4783.9307,5182.5332,-530.5429").encode(),
        True, TWO, TWO_PLACES, facts={"dialect": "plain CSV"},
    ),
}  # fmt: skip
