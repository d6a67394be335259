"""Worlds of payloads, torques and 6D poses: their physics by other formulas, and their judge."""

import copy
import io
import itertools
import tomllib

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from bench.worlds import run
from bench.worlds.cell import MOUNT_S, build
from bench.worlds.judge import CONTRADICTS, Judged, Truth, judged
from bench.worlds.noise import SIGMA_M
from bench.worlds.payloads import (
    ARM,
    CENTER_SIGMA_M,
    GRAVITY,
    MASS_SIGMA_KG,
    WRONG_CENTER_M,
    WRONG_MASS,
    Carrying,
    departs,
    held,
    mounted,
    rows_of,
)
from bench.worlds.run import Fixture, Played, asked
from bench.worlds.sixd import SIGMA_RAD, Poses, bodies
from bench.worlds.table import SHOWN, lines
from bench.worlds.worlds import PAYLOADS, WORLDS
from pipeline.machine.robot import load

SEED = 11
PLACES = ("rail", "floor")


def cell_of(name, seed=SEED):
    """The cell of a world with all that hides in it."""
    world = WORLDS[name]
    robot = load(world.robot)
    return build(robot, world.plan(robot, seed), world.rules, seed, world.secrets)


def written(name, seed=SEED):
    """Cell and files."""
    world, cell = WORLDS[name], cell_of(name, seed)
    _, record, factor = run._recorded(cell, world, seed)
    return cell, run._files(cell, world, record, factor)


def frames(robot, q):
    """Joint frames, z along the axis, and the flange of one pose: steps and turns, one by one."""
    turn, at, turns, origins = np.eye(3), np.zeros(3), [], []
    for placed, value, slides in zip(robot.placement, q, robot.prismatic, strict=True):
        at, turn = at + turn @ placed[:3, 3], turn @ placed[:3, :3]
        axis = turn[:, 2]
        if slides:
            at = at + value * axis
        else:
            turn = Rotation.from_rotvec(value * axis).as_matrix() @ turn
        turns.append(turn)
        origins.append(at)
    return turns, origins, turn @ robot.flange[:3, :3], at + turn @ robot.flange[:3, 3]


def by_cross_product(robot, q, place, joint=None):
    """What holds a kilogram at a place of a joint, or of the flange: axis . ((p - o) x up)."""
    turns, origins, turn, at = frames(robot, q)
    if joint is not None:
        turn, at = turns[joint - 1], origins[joint - 1]
    up = np.array([0, 0, GRAVITY])
    return np.array(
        [
            (joint is None or k < joint)
            * (axes[:, 2] @ (up if slides else np.cross(turn @ place + at - origin, up)))
            for k, (axes, origin, slides) in enumerate(
                zip(turns, origins, robot.prismatic, strict=True)
            )
        ]
    )


def at_rest(cell):
    """Joint values with what the joints have given way under each payload, and the payloads."""
    mass, center = rows_of(cell.payloads, cell.which)
    bent = cell.one.machine.rest(cell.course.q, center, np.outer(mass, [0, 0, -GRAVITY]))
    return cell.course.q + bent, bent, mass, center


@pytest.mark.parametrize("place", PLACES)
def test_torques_that_hold_a_payload_are_those_of_its_lever(place):
    """Virtual work on the strained arm, and the cross product of lever and weight there."""
    cell = cell_of(f"payloads_torques_{place}")
    q, _, mass, center = at_rest(cell)

    by_work = held(cell.one, cell.course, mass, center, arm=False)

    lever = [
        m * by_cross_product(cell.robot, *each) for m, *each in zip(mass, q, center, strict=True)
    ]
    np.testing.assert_allclose(by_work, lever, atol=1e-3)
    assert np.abs(by_work).max() > 1000


@pytest.mark.parametrize("place", PLACES)
def test_motors_hold_the_links_with_and_without_a_payload(place):
    """Each link by its lever, up to its own joint, on the arm as the payload has bent it."""
    cell = cell_of(f"payloads_torques_{place}")
    q, _, mass, center = at_rest(cell)

    links = [
        held(cell.one, cell.course, m, center) - held(cell.one, cell.course, m, center, arm=False)
        for m in (mass, 0 * mass)
    ]

    for seen, stands in zip(links, (q, cell.course.q), strict=True):
        lever = [
            sum(kg * by_cross_product(cell.robot, row, at, j) for j, at, kg in ARM[len(row)])
            for row in stands
        ]
        np.testing.assert_allclose(seen, lever, atol=1e-3)
    assert np.abs(links[0] - links[1]).max() > 0.1


@pytest.mark.parametrize("place", PLACES)
def test_a_payload_bends_the_robot_to_the_least_energy(place):
    """Energy of springs and weight has no slope where the machine rests, by differences."""
    cell = cell_of(f"payloads_{place}")
    q, bent, mass, center = at_rest(cell)
    torque = held(cell.one, cell.course, mass, center, arm=False)
    small = 1e-6

    def energy(i, give):
        *_, turn, at = frames(cell.robot, cell.course.q[i] + give)
        height = (turn @ center[i] + at)[2]
        return 0.5 * give @ (cell.stiffness * give) + mass[i] * GRAVITY * height

    for i in (0, len(mass) // 2, len(mass) - 1):
        slope = [
            (energy(i, bent[i] + step) - energy(i, bent[i] - step)) / (2 * small)
            for step in small * np.eye(len(q[i]))
        ]
        assert np.abs(slope).max() < 1e-3
        assert np.abs(torque[i]).max() > 100


@pytest.mark.parametrize("place", PLACES)
def test_reflectors_stand_where_the_strained_arm_carries_them(place):
    """Under each payload, by the steps of one chain; unloaded, where the log puts them."""
    cell = cell_of(f"payloads_{place}")
    q, *_ = at_rest(cell)

    for k, slot in enumerate(cell.slots):
        if slot.state == "base":
            continue
        stands = q if slot.state == "loaded" else cell.course.q
        *_, turn, at = frames(cell.robot, stands[slot.pull])
        np.testing.assert_allclose(
            cell.points[k], turn @ cell.tool[1 + slot.which] + at, rtol=0, atol=1e-10
        )


@pytest.mark.parametrize("place", PLACES)
def test_the_test_pose_carries_a_payload_of_its_own(place):
    """Another mass and centre than the campaign's; its deflection is that of its levers."""
    cell = cell_of(f"payload_light_{place}")
    kg = cell.rules.carries.further_kg
    lever = kg * by_cross_product(cell.robot, cell.test_q, cell.tool[0])
    give = -lever / cell.stiffness
    small = 1e-3  # the deflected arm has other levers: they differ by as little

    *_, turn, at = frames(cell.robot, cell.test_q)
    *_, turned, moved = frames(cell.robot, cell.test_q + give)
    off = cell.tool[1:] @ turned.T + moved - cell.tool[1:] @ turn.T - at

    assert kg > 2 * max(one.true.mass_kg for one in cell.payloads)
    scale = np.abs(off).max()
    np.testing.assert_allclose(cell.deflection(), off, atol=20 * small * scale)
    assert 1e-4 < scale < 2e-2


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [world.name for world in PAYLOADS if world.rules.carries.torques])
def test_the_log_weighs_what_is_mounted(name):
    """Mass and centre by least squares of cross products on joints.csv as it is written."""
    cell, content = written(name)
    joints = pd.read_csv(io.BytesIO(content["joints.csv"]))
    loads = pd.read_csv(io.BytesIO(content["loads.csv"]))
    told = tomllib.loads(content["campaign.toml"].decode())["payload"]
    tau = joints.filter(regex="^tau").to_numpy()
    scatter = np.sqrt(2) * cell.log.scatter
    unit = np.vstack([np.zeros(3), np.eye(3)])

    for k, one in enumerate(cell.payloads):
        rows, seen = [], []
        for load_ in loads[loads["payload"] == one.name].itertuples():
            here = joints["pose"] == load_.pose
            if "repeat" in joints:
                mine = here & (joints["repeat"] == load_.repeat)
                seen.append((tau[mine] - tau[here & (joints["repeat"] == 0)])[0])
            else:
                seen.append(tau[here][0])
            first, *others = (
                by_cross_product(
                    cell.robot, cell.course.q[cell.course.pose == load_.pose - 1][0], c
                )
                for c in unit
            )
            rows.append(np.column_stack([first, *(other - first for other in others)]))
        A = np.vstack(rows) / np.tile(scatter, len(rows))[:, None]
        b = np.concatenate(seen) / np.tile(scatter, len(rows))
        cov = np.linalg.inv(A.T @ A)
        x = cov @ A.T @ b
        x = x * np.sign(x[0])
        off = x - one.true.moments
        under = np.flatnonzero(cell.which == k)
        far, C = departs(cell.one, cell.course, cell.log, one, under)

        assert off @ np.linalg.solve(cov, off) < 33.4  # chi-square of four: once in a million
        assert (told[one.name]["mass_kg"], *told[one.name]["center_m"]) == pytest.approx(
            (one.stated.mass_kg, *one.stated.center_m)
        )
        size = np.sqrt(cov.diagonal())
        np.testing.assert_allclose(C / np.outer(size, size), cov / np.outer(size, size), atol=0.03)
        assert (far > 4) == bool(one.wrong)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("what", ["", "mass", "center"])
def test_one_payload_is_not_what_is_stated(what):
    """By as much as the world says; the others are off by what campaign.toml states."""
    off_kg, off_m, wrong = [], [], []
    for seed in range(2000):
        for one in mounted(Carrying((160, 320), 480, wrong=what), np.random.default_rng(seed)):
            kg = one.stated.mass_kg - one.true.mass_kg
            m = np.subtract(one.stated.center_m, one.true.center_m)
            if one.wrong:
                part = np.linalg.norm(m) if what == "center" else abs(kg) / one.true.mass_kg
                wrong.append(part)
            if one.wrong != "mass":
                off_kg.append(kg)
            if one.wrong != "center":
                off_m.append(m)

    assert np.std(off_kg) == pytest.approx(MASS_SIGMA_KG, rel=0.05)
    assert np.std(off_m) == pytest.approx(CENTER_SIGMA_M, rel=0.05)
    assert len(wrong) == (2000 if what else 0)
    if what:
        least, most = WRONG_MASS if what == "mass" else WRONG_CENTER_M
        assert 0.5 * least < min(wrong) < 1.2 * least
        assert 0.9 * most < max(wrong) < 1.2 * most


def test_a_payload_is_mounted_in_minutes():
    """A crane and bolts, not a turnbuckle; every payload has a row of its own."""
    cell, content = written("payloads_torques_floor")
    gaps = [
        3600 * (b.hours - a.hours)
        for a, b in itertools.pairwise(cell.slots)
        if a.group != b.group and b.state == "loaded"
    ]
    loads = content["loads.csv"].decode().splitlines()
    rows = content["joints.csv"].decode().splitlines()

    assert min(gaps) > MOUNT_S[0]
    assert loads[:3] == ["pose,repeat,payload", "1,1,ballast1", "1,2,ballast2"]
    assert [row.split(",")[8] for row in rows[:4]] == ["repeat", "0", "1", "2"]


@pytest.mark.whole
def test_targets_of_a_pose_are_one_body():
    """Distances stay, while position and rotation err as stated, each axis by itself."""
    cell = cell_of("poses")
    rows = np.array(bodies(cell.slots))
    body = cell.local[rows]
    mean, turned = [], []
    for seed in range(60):
        error = Poses()(cell.slots, cell.hours, cell.local, np.random.default_rng(seed))
        seen = body + error[rows]
        for (a, b), at in itertools.product(itertools.combinations(range(3), 2), (0, 5, 50)):
            kept = np.linalg.norm(body[at, a] - body[at, b])
            assert np.linalg.norm(seen[at, a] - seen[at, b]) == pytest.approx(kept, abs=1e-12)
        mean.append(error[rows].mean(axis=1))
        for was, is_ in zip(body, seen, strict=True):
            centred = was - was.mean(axis=0), is_ - is_.mean(axis=0)
            turned.append(Rotation.align_vectors(centred[1], centred[0])[0].as_rotvec())

    np.testing.assert_allclose(np.std(mean, axis=(0, 1)), SIGMA_M, rtol=0.05)
    np.testing.assert_allclose(np.std(turned, axis=0), SIGMA_RAD, rtol=0.05)


@pytest.mark.whole
def test_a_probe_aside_errs_with_its_lever():
    """Across the normal the mean errs by sigma and lever times rotation, along it by sigma."""
    cell = cell_of("poses")
    rows = np.array(bodies(cell.slots))
    body = cell.local[rows]
    normal = np.cross(body[:, 1] - body[:, 0], body[:, 2] - body[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along, across = [], []
    for seed in range(60):
        off = Poses(0.25)(cell.slots, cell.hours, cell.local, np.random.default_rng(seed))
        off = off[rows].mean(axis=1)
        part = np.sum(off * normal, axis=1)
        along.append(part)
        across.append(np.sum(off**2, axis=1) - part**2)

    assert np.std(along) == pytest.approx(SIGMA_M, rel=0.05)
    assert np.sqrt(np.mean(across) / 2) == pytest.approx(
        np.hypot(SIGMA_M, 0.25 * SIGMA_RAD), rel=0.05
    )


@pytest.fixture(scope="module")
def weighed():
    """A campaign with torques: the truth, and the answer."""
    cell, content = written("payloads_torques_floor")
    truth = Truth(cell.stiffness.tolist(), cell.deflection(), payloads=cell.payloads)
    return truth, asked(content).answer


@pytest.mark.whole
def test_payloads_as_stated_are_let_go(weighed):
    """Nothing is accused; masses, centres and the further payload's deflection are told."""
    truth, answer = weighed

    one = judged(truth, answer)

    assert not one.accused
    assert one.contradicted == ()
    assert len(one.weighed) == 8
    assert len(one.left_mm) == 2
    assert max(abs(each.pull) for each in (*one.weighed, *one.deflections)) < 5


@pytest.mark.whole
def test_a_payload_is_contradicted_by_number_and_sentence(weighed):
    """A p-value that nobody reads says nothing, and neither does a sentence without one."""
    truth, answer = weighed
    low, said = copy.deepcopy(answer), copy.deepcopy(answer)
    low["payloads"][0]["p_value"] = 1e-9
    said["findings"].append("ballast1 is heavy")
    both = {**low, "findings": said["findings"]}

    assert [judged(truth, each).contradicted for each in (low, said, both)] == [
        (),
        (),
        ("ballast1",),
    ]


@pytest.mark.whole
def test_a_mass_beside_the_truth_is_counted(weighed):
    """What the torques say is held against what was mounted, not against what is stated."""
    truth, answer = weighed
    wrong = copy.deepcopy(answer)
    wrong["payloads"][1]["found"]["mass_kg"] *= 1.2

    told = judged(truth, wrong).weighed
    mounted_ = [v for one in truth.payloads for v in (one.true.mass_kg, *one.true.center_m)]

    assert [one.name for one in told if abs(one.pull) > 5] == ["ballast2.kg"]
    assert [one.true for one in told] == mounted_


def test_a_wrong_payload_is_due_where_the_torques_show_it():
    """Told in four cases of five at `SHOWN`; due beyond one and a half of it, apart from others."""
    power = stats.ncx2.sf(stats.chi2.isf(CONTRADICTS, 4), 4, SHOWN**2)
    name = "wrong_mass_floor"
    games = [
        Played(name, 1, Judged("answered", contradicted=("a",)), wrong="a", apart=9.0),
        Played(name, 2, Judged("answered", accused=False), wrong="a", apart=9.0),
        Played(name, 3, Judged("answered", contradicted=("b",)), wrong="a", apart=7.0),
        Played(name, 4, Judged("crashed"), wrong="a", apart=0.0),
    ]

    titles, _, row = [line.strip("| ").split(" | ") for line in lines(games)[3:]]

    assert power == pytest.approx(0.80, abs=1e-3)
    said = dict(zip(titles, row, strict=True))
    assert said["wrong payload reported, clearly visible"].startswith("50.0 % (1 of 2;")
    assert said["wrong payload reported, others"].startswith("0.0 % (0 of 1;")
    assert said["any doubt"].startswith("75.0 % (3 of 4;")
    assert "false alarm" not in said


def test_a_cause_is_sized_with_the_noise_that_is_stated():
    """Of a world of poses with theirs, of any other with white noise."""
    rng = np.random.default_rng(1)
    poses, other = cell_of("poses"), cell_of("student3")
    rows = np.array(bodies(poses.slots))

    body = poses.local[rows] + WORLDS["poses"].as_stated(poses, rng)[rows]
    white = WORLDS["student3"].as_stated(other, rng) / SIGMA_M

    kept = np.linalg.norm(poses.local[rows][:, 0] - poses.local[rows][:, 1], axis=1)
    np.testing.assert_allclose(np.linalg.norm(body[:, 0] - body[:, 1], axis=1), kept, atol=1e-12)
    assert np.mean(white**4) == pytest.approx(3, rel=0.15)


@pytest.mark.slow  # tests/system/test_weights.py has a campaign of the simulator's
@pytest.mark.parametrize("name", ["wrong_mass_floor", "wrong_center_floor"])
def test_a_payload_that_is_stated_wrong_is_told(name):
    """It and no other, where the torques show it."""
    one = run.played(Fixture(name, 0, SEED, cause=False))

    assert one.judged.outcome == "answered"
    assert one.judged.contradicted == (one.wrong,)


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["poses", "poses_payloads"])
def test_a_pose_counts_as_one_quantity(name):
    """Three targets of one pose are no three readings."""
    one = run.played(Fixture(name, 0, SEED, cause=False)).judged

    assert one.measures == "poses"
    assert not one.accused
    assert max(abs(each.pull) for each in one.deflections) < 4


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name, world in WORLDS.items() if world.rules.carries or world.reads]
)
def test_every_world_of_payloads_and_poses_is_answered(name):
    """Neither refused nor crashed, and nothing foretold is off by many uncertainties."""
    one = run.played(Fixture(name, 0, SEED, cause=False))

    assert one.judged.outcome == "answered", one.judged.message
    if not one.wrong:
        assert all(abs(each.pull) < 6 for each in one.judged.deflections)
