"""Points and recordings of a controller, read as joint logs."""

import itertools

import numpy as np
import pytest

from pipeline.dialects import recorded, taught
from pipeline.intake import log_columns
from pipeline.intake.which_logs import propose_logs
from pipeline.machine.robot import axes, load
from pipeline.programs.for_plan import drive, programs
from pipeline.readers import logs

SEED = 20261125
SUFFIX = {"kuka": ".dat", "abb": ".mod", "fanuc": ".ls"}


def poses(robot, count=7):
    """Random joint values, away from limits, and approach motions."""
    rng = np.random.default_rng(SEED)
    inside = 0.05 * (robot.upper - robot.lower)
    q = rng.uniform(robot.lower + inside, robot.upper - inside, (count, robot.n))
    return q, rng.choice([-1, 1], count)


def read_as_init(name, data, whose):
    """Joint values as `init` and then `run` read them, for a robot by its name."""
    said = propose_logs({name: data})
    assert said.joints == name
    assert whose in said.robots
    robot = load(whose)
    form = log_columns.settled(said.joint_columns[whose])
    log = logs.joints(name, data, robot, form)
    assert not log.rejected
    return log, logs.joint_values(log, robot)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("brand", SUFFIX)
@pytest.mark.parametrize("name", ["kr210_r2700_2", "irb6640", "kr500_rail"])
def test_the_program_of_a_plan_is_the_joint_log_of_the_plan(name, brand):
    """Touched up at the robot or not: its poses in order, without approach motions and run-ups."""
    robot = load(name)
    q, way = poses(robot)
    via = [
        np.zeros((0, robot.n)),
        *(((a + b) / 2)[None] for a, b in itertools.pairwise(q)),
    ]
    made = drive("p", robot, q, way, [[1000.0]] * len(q), zero_after=False, via=via)
    files = programs(made, brand)
    file = next(one for one in files if one.endswith(SUFFIX[brand]))
    log, found = read_as_init(file, files[file], name)

    assert log.number["pose"].tolist() == [*range(1, 8)]
    digits = 3 if brand == "fanuc" else 6
    off = np.where(robot.prismatic, 1e3 * (found - q), np.rad2deg(found - q))
    assert np.abs(off).max() <= 1.1 * 10.0**-digits


KRL = """&ACCESS RVP
DEFDAT  MESSUNG PUBLIC
;FOLD EXTERNAL DECLARATIONS
DECL BASIS_SUGG_T LAST_BASIS={POINT1[] "P4 "}
;ENDFOLD
DECL E6AXIS XHOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0,E1 0.0,E2 0.0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}
DECL E6AXIS XP2={A1 20.5,A2 -75.25,A3 80.125,A4 10.0,A5 45.0,A6 -30.0,E1 0.0,E2 0.0}
DECL E6AXIS XP1={A1 -15.0,A2 -60.0,A3 70.0,A4 -10.0,A5 -35.0,A6 12.5,E1 0.0,E2 0.0}
DECL E6POS XP7={X 1500.0,Y 0.0,Z 900.0,A 0.0,B 90.0,C 0.0,S 2,T 10}
ENDDAT
"""


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_taught_points_are_poses_by_their_numbers(end):
    """XP1 is pose 1 wherever it is; XHOME is not a pose; the line is that of the file."""
    data = KRL.replace("\n", end).encode("cp1252")
    log, found = read_as_init("messung.dat", data, "kr210_r2700_2")
    order = np.argsort(log.number["pose"])

    assert log.number["pose"][order].tolist() == [1, 2]
    assert log.line[order].tolist() == [9, 8]
    shown = axes.displayed(load("kr210_r2700_2"), found)
    assert shown[order] == pytest.approx(
        np.array([[-15, -60, 70, -10, -35, 12.5], [20.5, -75.25, 80.125, 10, 45, -30]])
    )


def test_names_without_numbers_count_in_their_order():
    """If no name has a number, the first point of the file is pose 1."""
    text = KRL.replace("XP2", "XOBEN").replace("XP1", "XUNTEN").encode()
    rows = [row.split("\t") for row in taught.table(text).decode().splitlines() if row]

    assert [row[0] for row in rows] == ["pose", "1", "2", "3"]


def recording(q_deg, rng, form, home=None):
    """A table as a controller writes it: standing 8 s at each pose, driving in between.

    Args:
        q_deg: Poses [deg].
        rng: Draws the noise of encoders and torques.
        form: `rtde` or `trace`.
        home: Where it begins and ends [deg].
    """
    places = [*q_deg] if home is None else [home, *q_deg, home]
    rate, rows, tau = 25, [], []
    for k, at in enumerate(places):
        if k:
            share = np.linspace(0, 1, 3 * rate)[:, None]
            smooth = 3 * share**2 - 2 * share**3
            rows.append(places[k - 1] + smooth * (at - places[k - 1]))
            tau.append(np.zeros((3 * rate, 6)))
        rows.append(at + rng.normal(0, 0.001, (8 * rate, 6)))
        tau.append(100.0 * k + np.arange(1, 7) + rng.normal(0, 1, (8 * rate, 6)))
    angle, torque = np.concatenate(rows), np.concatenate(tau)
    time = np.arange(len(angle)) / rate
    if form == "rtde":
        head = " ".join(["timestamp", *(f"target_q_{k}" for k in range(6)),
                         *(f"actual_q_{k}" for k in range(6)), "robot_mode"])  # fmt: skip
        both = np.deg2rad(np.hstack([np.zeros_like(angle), angle]))
        lines = [
            " ".join(f"{x:.6f}" for x in [t, *row, 7]) for t, row in zip(time, both, strict=True)
        ]
        return "\n".join([head, *lines, ""]).encode()
    head = ";".join(["Zeit [s]", *(f"Achswinkel Soll A{k} [°]" for k in range(1, 7)),
                     *(f"Achswinkel Ist A{k} [°]" for k in range(1, 7)),
                     *(f"Moment A{k} [Nm]" for k in range(1, 7))])  # fmt: skip
    table = np.column_stack([time, np.zeros_like(angle), angle, torque])
    lines = [";".join(f"{x:.5f}".replace(".", ",") for x in row) for row in table]
    return "\n".join(["Trace Messung", "", head, *lines, ""]).encode("utf-8")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("form", "name"), [("rtde", "ur10e"), ("trace", "kr210_r2700_2")])
@pytest.mark.parametrize("homed", [True, False])
def test_a_recording_is_read_where_the_robot_stood(form, name, homed):
    """As many poses as stops, to encoder noise; the home position is not a pose."""
    robot, rng = load(name), np.random.default_rng(SEED)
    q = poses(robot, 5)[0]
    mid = axes.displayed(robot, (robot.lower + robot.upper) / 2)
    data = recording(axes.displayed(robot, q), rng, form, mid if homed else None)
    log, found = read_as_init(f"{form}.csv", data, name)

    assert log.number["pose"].tolist() == [1, 2, 3, 4, 5]
    assert np.rad2deg(np.abs(found - q)).max() < 1e-3
    if form == "trace":
        tau = np.column_stack([log.number[f"tau{k}"] for k in range(1, 7)])
        sense = (
            np.linalg.solve(robot.controller_matrix.T, np.eye(6)) if robot.controller else np.eye(6)
        )
        stops = 100.0 * (np.arange(5) + homed)[:, None] + np.arange(1, 7)
        assert tau == pytest.approx(stops @ sense.T, abs=0.5)


def test_what_is_no_recording_is_none():
    """A log with a row for each pose, or a table of points with times, is not a recording."""
    head = "pose,time,A1,A2,A3,A4,A5,A6"
    rows = [f"{k},{k * 60},{k},0,0,0,0,0" for k in range(80)]
    points = ["time,name,x_mm,y_mm,z_mm", *(f"{k},P1,{k},0,0" for k in range(80))]

    assert recorded.table("\n".join([head, *rows]).encode()) is None
    assert recorded.table("\n".join(points).encode()) is None
    assert taught.table("\n".join([head, *rows]).encode()) is None


CURPOS = """CURPOS.DG     Snapshot 18-AUG-26 09:55:13
CURRENT JOINT POSITION:
 Joint 1:      {0:.4f} deg
 Joint 2:      {1:.4f} deg
 Joint 3:      {2:.4f} deg
 Joint 4:      {3:.4f} deg
 Joint 5:      {4:.4f} deg
 Joint 6:      {5:.4f} deg
CURRENT WORLD POSITION:
 X:   1124.757   Y:   1309.888   Z:    813.735
 W:    152.929   P:    -50.633   R:     69.078
"""
ROWS = [[10.5, -20.25, 30.0, -40.0, 50.5, 60.0], [1.5, 2.5, -3.5, 4.5, -5.5, 6.5]]
PARKED = [0.0, 90.0, 0.0, 0.0, 0.0, 0.0]


def words(values, mark=","):
    return mark.join(f"{x:.3f}" for x in values)


def hyundai():
    steps = [("HOME", PARKED), ("POSE 1", ROWS[0]), ("POSE 2", ROWS[1])]
    lines = [f"     '{name}\nS{k}   MOVE P,S=30%,A=0,T=1  ({words([*row, 1250.0])})A\n     STOP"
             for k, (name, row) in enumerate(steps, 1)]  # fmt: skip
    head = "Program File Format Version : 1.6  MechType: 366(HX400L-06)  TotalAxis: 7  AuxAxis: 1"
    return "\r\n".join([head, *lines, "     END"]).encode()


def kawasaki():
    points = [("park", PARKED), ("k01", ROWS[0]), ("k02", ROWS[1])]
    lines = [f"#{name} {words([*row, 1250.0], ' ')}" for name, row in points]
    moves = "\n".join(f"  JMOVE #{name}" for name, _ in points)
    return "\n".join([".PROGRAM p()", moves, ".END", ".JOINTS", *lines, ".END"]).encode()


def kuka_log():
    rows = [f"2026-05-19 08:0{k}:51  POZ  {k}  " + "  ".join(f"A{a}= {x:.4f}"
            for a, x in enumerate(row, 1)) for k, row in enumerate(ROWS, 1)]  # fmt: skip
    return "\n".join([";AXLOG  KR C4", *rows]).encode()


def fanuc_listings():
    files = {f"CURPOS/C_{k:02d}.DG": CURPOS.format(*row).encode() for k, row in enumerate(ROWS, 1)}
    ((name, data),) = taught.gathered(files).items()
    assert name == "CURPOS/*.DG"
    return data


def comau():
    points = [("pntparkJ", PARKED), ("pnt01J", ROWS[0]), ("pnt02J", ROWS[1])]
    lines = [f"{name} JNTP Arm: 1 AX: 7 Priv\n " + " ".join(
             f"{k}: {x:.3f}" for k, x in enumerate([*row, 1250.0], 1))
             for name, row in points]  # fmt: skip
    return "\n".join(["PROGRAM pull", "  -- saved 18-AUG-26", *lines, ""]).encode()


def nachi():
    """The remarks above the motions number them, in another order."""
    move = "MOVEX A=1P,AC=0,SM=0,M1J,P,({}),M2J,P,(1250.0),S=15.0,H=1,MS"
    lines = [f'REM "POSE {k}"\n{move.format(words(ROWS[k - 1], ",  "))}\nSTOP' for k in (2, 1)]
    return "\r\n".join(["' PROGRAM 051", *lines, "END"]).encode()


def estun():
    points = [("HOME", PARKED), ("P1", ROWS[0]), ("P2", ROWS[1])]
    lines = [name + '={_type="APOS",' + ",".join(
             f"a{k}={x:.3f}" for k, x in enumerate([*row, 1250.0, 0.0, 0.0, 0.0], 1)) + "}"
             for name, row in points]  # fmt: skip
    return "\n".join([*lines, ""]).encode()


def sinumerik(stop="; MERENI {}\n{}"):
    """The rail first, in a block of its own or not; home before, between and behind the poses."""
    blocks = [" ".join(["X=1250.000", *(f"A{k}={x:.3f}" for k, x in enumerate(row, 1))])
              for row in (PARKED, *ROWS)]  # fmt: skip
    poses = [f"N{k}5 M0 ; {k} tahy" for k in (1, 2)]
    lines = [f"N10 G90 G0 F=R1 {blocks[0]} ; domu", "R4=7", "POSNR=3", stop.format(1, blocks[1]),
             poses[0], stop.format(2, blocks[2]), poses[1], f"N60 {blocks[0]}", "M30"]  # fmt: skip
    return "\r\n".join(["%_N_TAHY_MPF", *lines]).encode()


@pytest.mark.parametrize(("made", "rail"), [(hyundai, True), (kawasaki, True), (kuka_log, False),
                                            (fanuc_listings, False), (comau, True),
                                            (sinumerik, True), (nachi, True),
                                            (estun, True)])  # fmt: skip
def test_points_of_other_makers_are_poses_by_their_names(made, rail):
    rows = [row.split("\t") for row in taught.table(made()).decode().splitlines() if row]
    titles = ["pose", *(f"A{k} [deg]" for k in range(1, 7)), *["E1 [mm]"] * rail]

    assert rows[0] == titles
    assert sorted([float(x) for x in row] for row in rows[1:]) == [
        [k, *row, *[1250.0] * rail] for k, row in enumerate(ROWS, 1)
    ]
    parked = [list(axes.values())[:6] for axes in taught.unnumbered(made()).values()]
    assert parked == [PARKED] * (rail and made is not nachi)


def poses_of(data):
    """Pose and values of each row of the table."""
    rows = [row.split("\t") for row in taught.table(data).decode().splitlines() if row]
    return rows[0], [[float(x) for x in row] for row in rows[1:]]


@pytest.mark.parametrize(("above", "behind"), [("'姿勢{}\n", ""), ("", "   'Pose no. {} (up)")])
def test_remarks_of_a_job_number_its_points(above, behind):
    """C00000 is the home position; in the code of the controller, and in any order."""
    points = [PARKED, *ROWS[::-1], PARKED]
    lines = [f"C{k:05d}=" + ",".join(f"{100 * x:.0f}" for x in row)
             for k, row in enumerate(points)]  # fmt: skip
    moves = [f"{above.format(3 - k)}MOVJ C{k:05d} VJ=5.00{behind.format(3 - k)}\nPAUSE"
             for k in (1, 2)]  # fmt: skip
    job = [
        "/JOB",
        "//POS",
        "///PULSE",
        *lines,
        "//INST",
        "NOP",
        "MOVJ C00000",
        *moves,
        "MOVJ C00003",
    ]
    titles, rows = poses_of("\n".join(job).encode("cp932"))

    assert titles == ["pose", *(f"{axis} [pulses]" for axis in "SLURBT")]
    assert sorted(rows) == [[k, *(100 * x for x in row)] for k, row in enumerate(ROWS, 1)]


def test_remarks_below_the_motions_do_not_shift_numbered_points():
    """`PAUSE ; pozycja 1` comes after the motion to poz1, and above that to poz2."""
    rows = {f"poz{k}": [k, 2, 3, 4, 5, 6] for k in range(1, 5)}
    moves = [f"  JMOVE #{name}\n  PAUSE ; pozycja {row[0]}" for name, row in rows.items()]
    lines = [f"#{name} {words(row, ' ')}" for name, row in rows.items()]
    text = "\n".join([".PROGRAM p()", *moves, ".END", ".JOINTS", *lines, ".END"])

    assert [row[:2] for row in poses_of(text.encode())[1]] == [[k, k] for k in range(1, 5)]


def test_remarks_with_two_points_each_number_none():
    """Either may be the pose: the points are counted, and the readings tell."""
    blocks = [f"N{k} A1={k} A2=0 A3=0 A4=0 A5=0 A6=0" for k in range(10, 50, 10)]
    program = ["%_N_P_MPF", "; POSE 2", *blocks[:2], "; POSE 1", *blocks[2:]]
    rows = poses_of("\n".join(program).encode())[1]

    assert [row[:2] for row in rows] == [[1, 10], [2, 20], [3, 30], [4, 40]]


@pytest.mark.parametrize("head", ["", "%time,field.header.seq,field.header.frame_id,field.name0\n"])
@pytest.mark.parametrize("more", [[], [0.0] * 6])
def test_joint_states_of_ros_are_read_by_their_names(head, more):
    """In whatever order they come, with a frame before them and velocities behind or not."""
    robot = load("ur10e")
    order = [2, 0, 1, 5, 3, 4]
    rows = [[*range(1, 7)], [0.5, -1.5, 1.25, 0.1, -0.2, 3.0]]
    lines = [",".join(["1793173232", "5", "base", *(robot.joints[k].name for k in order),
             *(repr(float(row[k])) for k in order), *map(str, more)]) for row in rows]  # fmt: skip
    log = logs.joints("states.csv", (head + "\n".join(lines) + "\n").encode(), robot)

    assert log.number["pose"].tolist() == [1, 2]
    assert logs.joint_values(log, robot).tolist() == rows
    assert not head or log.line.tolist() == [2, 3]


def test_a_pose_recorded_twice_stays_twice():
    """So that the log's reader names both lines; counted on, every later pose would be another."""
    twice = kuka_log() + b"\n2026-05-19 08:03:51  POZ  2  " + kuka_log().rpartition(b"POZ  2  ")[2]
    rows = [row.split("\t")[0] for row in taught.table(twice).decode().splitlines() if row]

    assert rows == ["pose", "1", "2", "2"]
