"""Weights at the load point and payloads on the flange: forces, errors, springs, rejections.

The truth is a FANUC computed here from products of rotations and its potential energy.
"""

import numpy as np
import pandas as pd
import pytest

from pipeline.annex.sections.method import method
from pipeline.answer.inputs import payload_entries
from pipeline.base.errors import InputError
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.assemble import assemble
from pipeline.system.estimate import identify
from pipeline.system.fit import fit

G = 9.80665
ROWS = [  # alpha, a, theta, d of the FANUC R-2000iC, modified DH
    (0.0, 0.0, 0.0, 0.67),
    (-90.0, 0.312, -90.0, 0.0),
    (0.0, 1.075, 0.0, 0.0),
    (-90.0, 0.225, 0.0, 1.28),
    (90.0, 0.0, 0.0, 0.0),
    (-90.0, 0.0, 0.0, 0.215),
]
X = np.array([2e-7, 3.1e-7, 2.6e-7, 9e-7, 1.1e-6, 1.6e-6])
TOOL = {"load_point": (0.15, 0.02, 0.25), "P1": (0.2, 0.05, 0.12), "P2": (-0.12, 0.19, 0.1),
        "P3": (-0.1, -0.18, 0.22)}  # fmt: skip
PAYLOADS = {"light": (40.0, (0.08, 0.03, 0.1)), "heavy": (130.0, (-0.05, 0.12, 0.3))}
SIGMA = 3e-5


def turn(axis, angle):
    """A rotation about x or z as a 4x4 matrix."""
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    i, j = (1, 2) if axis == "x" else (0, 1)
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def shift(x=0.0, z=0.0):
    T = np.eye(4)
    T[0, 3], T[2, 3] = x, z
    return T


def place(q, point):
    """A point of the flange in F_b [m]."""
    T = np.eye(4)
    for (alpha, a, theta, d), angle in zip(ROWS, q, strict=True):
        T = T @ turn("x", np.radians(alpha)) @ shift(x=a)
        T = T @ turn("z", np.radians(theta) + angle) @ shift(z=d)
    return (T @ [*point, 1.0])[:3]


def slopes(q, point, h=1e-6):
    """Its derivative with respect to each joint, shape (3, 6)."""
    steps = h * np.eye(6)
    return np.stack([(place(q + e, point) - place(q - e, point)) / (2 * h) for e in steps], 1)


def column_block(q, point, mass, at):
    """Displacement by a weight with unit compliances.

    The joints follow the gradient of its energy.
    """
    tau = -mass * G * slopes(q, at)[2]
    return slopes(q, point) * tau


def hang(loads, seed=1, noise=SIGMA, poses=10, more="", **toml):
    """Files of a campaign: at every pose each of `loads` (cell of loads.csv, mass, where)."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.2, 1.2, (poses, 6)) + np.array([0, 0.3, -0.2, 0, 0.9, 0])
    names, lines, c, B = ["P1", "P2", "P3"], ["group,target,x_m,y_m,z_m"], [], []
    for k, here in enumerate(q, 1):
        rows = {name: place(here, TOOL[name]) for name in names}
        zero = {n: p + noise * rng.standard_normal(3) for n, p in rows.items()}
        lines += [
            f"pose{k}_rep0_unloaded,{n},{','.join(map(repr, map(float, p)))}"
            for n, p in zero.items()
        ]
        for r, (_, mass, at) in enumerate(loads, 1):
            for n in names:
                block = column_block(here, TOOL[n], mass, at)
                p = rows[n] + block @ X + noise * rng.standard_normal(3)
                lines.append(f"pose{k}_rep{r}_loaded,{n},{','.join(map(repr, map(float, p)))}")
                c.append(p - zero[n])
                B.append(block)
    header = "pose,repeat," + ("payload" if isinstance(loads[0][0], str) else "mass_kg")
    rows = [f"{k},{r},{cell}" for k in range(1, poses + 1) for r, (cell, *_) in enumerate(loads, 1)]
    head = "pose," + ",".join(f"theta{j}_rad" for j in range(1, 7))
    logged = [f"{k}," + ",".join(map(repr, map(float, one))) for k, one in enumerate(q, 1)]
    tool = "\n".join(f"{name} = {list(at)}" for name, at in TOOL.items())
    text = f'format = 1\nname = "hung"\nrobot = "fanuc_r2000ic"\n{more}\n[tool]\n{tool}\n'
    text += f'[tracker]\nfiles = ["tracker.csv"]\nsigma_m = {SIGMA}\n'
    files = {"campaign.toml": text, "loads.csv": "\n".join([header, *rows]) + "\n"}
    files |= {
        "tracker.csv": "\n".join(lines) + "\n",
        "joints.csv": "\n".join([head, *logged]) + "\n",
    }
    return {name: one.encode() for name, one in files.items()}, np.array(c), np.array(B), q


def case_of(files):
    """As ingested."""
    return ingested(in_memory(files))


def weighed(c, B, pulls):
    """All springs but the first by least squares; a zero is shared by the pulls of its pose."""
    n = len(c) // (3 * pulls)
    V = np.eye(pulls) + 1.0  # loaded readings with one zero
    W = np.kron(np.eye(n), np.kron(np.linalg.inv(V), np.eye(9)))
    A, y = B.reshape(-1, 6)[:, 1:], c.ravel()
    return np.linalg.solve(A.T @ W @ A, A.T @ W @ y)


def payload_tables(sigma=0.0, off=0.0, heavier=1.0):
    """[payload.NAME] of both."""
    return "".join(
        f"[payload.{name}]\nmass_kg = {mass * heavier}\nmass_sigma_kg = {sigma}\n"
        f"center_m = {list(at)}\ncenter_sigma_m = {off}\n"
        for name, (mass, at) in PAYLOADS.items()
    )


MOUNTED = [(name, *PAYLOADS[name]) for name in PAYLOADS]
HUNG = [(mass, mass, TOOL["load_point"]) for mass in (60.0, 140.0)]


@pytest.mark.parametrize(("loads", "more"), [(HUNG, ""), (MOUNTED, payload_tables())])
def test_the_springs_are_those_of_an_independent_fit(loads, more):
    """To 1e-6, without scale or chain; the vertical joint is never loaded."""
    files, c, B, _ = hang(loads, more=more)
    case = case_of(files)
    data = bring(case).data
    _, found = identify(case.cell, data, case.robot.nominal_compliance)

    assert found.value[1:] == pytest.approx(weighed(c, B, len(loads)), rel=1e-6)
    assert not found.identifiable[0]
    assert found.identifiable[1:].all()


@pytest.mark.whole
def test_a_payload_acts_at_its_centre_and_not_at_the_load_point():
    """Its springs are wrong otherwise."""
    files = hang(MOUNTED, more=payload_tables(), noise=0.0)[0]
    case = case_of(files)
    found = fit(case, bring(case)).estimate
    wrong = dict(files, **{"loads.csv": files["loads.csv"].replace(b"payload", b"mass_kg")
                           .replace(b"light", b"40.0").replace(b"heavy", b"130.0")})  # fmt: skip
    astray = case_of(wrong)

    assert found.value[1:] == pytest.approx(X[1:], rel=1e-6)
    assert fit(astray, bring(astray)).estimate.value[5] != pytest.approx(X[5], rel=0.05)


def test_gravity_pulls_where_campaign_toml_says():
    """Along -z of F_b, or along a direction of any length with its own magnitude."""
    plain_case = case_of(hang(HUNG)[0])
    down = bring(plain_case).data.pulls.force
    more = "[gravity]\ndirection = [0.0, 0.3, -0.4]\nm_s2 = 9.81\n"
    aslant = bring(case_of(hang(HUNG, more=more)[0])).data.pulls.force

    assert down[:2] == pytest.approx(np.array([[0, 0, -60 * G], [0, 0, -140 * G]]))
    assert aslant[1] == pytest.approx([0, 0.6 * 140 * 9.81, -0.8 * 140 * 9.81])


def test_what_is_uncertain_of_a_payload_is_one_error_for_all_its_rows():
    """A mass error scales all displacements under it; a centre error acts through its lever."""
    sigma, off = 0.8, 0.004
    files, _, B, q = hang(MOUNTED, more=payload_tables(sigma, off))
    case = case_of(files)
    errors = assemble(case.cell, bring(case).data, X).errors
    mass, center = (errors.G[:, errors.source == name].toarray()
                    for name in ("payload_mass", "payload_center"))  # fmt: skip
    moved = (B @ X).reshape(len(q), 2, 9)

    assert mass.shape[1] == 2
    assert center.shape[1] == 6
    assert errors.common[
        np.isin(errors.source.astype(str), ["payload_mass", "payload_center"])
    ].all()
    for k, (m, at) in enumerate(PAYLOADS.values()):
        own = mass[:, k].reshape(len(q), 2, 9)
        assert np.abs(own[:, k]) == pytest.approx(np.abs(moved[:, k]) * sigma / m, rel=1e-6)
        assert not own[:, 1 - k].any()
        for axis in range(3):
            there = np.array(at) + off * np.eye(3)[axis]
            expected = [column_block(here, TOOL[p], m, there) @ X for here in q
                        for p in ("P1", "P2", "P3")]  # fmt: skip
            expected = np.reshape(expected, (len(q), 9)) - moved[:, k]
            here = center[:, 3 * k + axis].reshape(len(q), 2, 9)[:, k]
            assert np.abs(here) == pytest.approx(np.abs(expected), abs=1e-9)


@pytest.mark.slow
def test_intervals_of_payload_campaigns_cover():
    """Masses and centres wrong as stated: 95 % intervals hold the truth in 95 % of the cases.

    The readings have noise as well. Without the two errors, 72 % of the intervals would.
    """
    plan = Plan(name="p", poses={"count": 6}, pulls={"load": "payloads"}, payload={
        "light": {"mass_kg": 60.0, "mass_sigma_kg": 1.5, "center_m": (0.05, 0.02, 0.1),
                  "center_sigma_m": 0.01},
        "heavy": {"mass_kg": 220.0, "mass_sigma_kg": 4.0, "center_m": (-0.04, 0.1, 0.25),
                  "center_sigma_m": 0.01}})  # fmt: skip
    inside = []
    for seed in range(40):
        case = case_of(simulate(plan.model_copy(update={"seed": seed})).files)
        found = fit(case, bring(case)).estimate
        z = (found.value - case.robot.nominal_compliance) / found.std
        inside += (np.abs(z) < found.quantile)[found.identifiable].tolist()

    assert len(inside) > 190
    assert 0.90 < np.mean(inside) < 0.99


@pytest.mark.whole
def test_a_campaign_of_weights_has_an_answer_without_suspects_of_chain_and_scale():
    """No chain or scale is accused or a blind spot, and the springs are right."""
    raw = in_memory(hang(HUNG, more="[naming]\nmeasured = ['P1', 'P2', 'P3']\n")[0])
    answer = campaign_answer("hung", raw).answer
    off = [
        (one.compliance - x) / one.compliance_std
        for one, x in zip(answer.stiffness[1:], X[1:], strict=True)
    ]
    case = case_of(raw.files)
    names = {effect.name for effect in catalogue(case.robot, bring(case).data.pulls)}
    spots = {spot.name for spot in answer.diagnosis.blind_spots}

    assert answer.diagnosis.verdict == "adequate"
    assert np.abs(off).max() < 4
    assert not answer.stiffness[0].identifiable
    assert not any(name.startswith(("chain", "scale")) for name in names | spots)
    assert "force_noise" not in names
    written = str(method(answer, {}))
    assert "chain" not in written
    assert "weight of what hangs" in written


def test_pulls_and_weights_stand_in_one_log():
    """A cell is empty if the row is of another kind; only pulls have a chain and its errors."""
    made = simulate(Plan(name="m", poses={"count": 4}, pulls={"steps_n": [1500.0, 2500.0]}))
    rows = made.files["loads.csv"].decode().splitlines()
    mixed = ["pose,repeat,force_n,branch,mass_kg,payload"]
    mixed += [f"{r},," if not r.startswith("2,") else "" for r in rows[1:]]
    mixed[3:5] = ["2,1,,,152.9,", "2,2,,,,box"]
    tracker = [line for line in made.files["tracker.csv"].decode().splitlines()
               if not ("pose02" in line and ",Pl" in line)]  # fmt: skip
    more = b"[payload.box]\nmass_kg = 200.0\ncenter_m = [0.0, 0.1, 0.2]\n"
    files = dict(made.files, **{"loads.csv": "\n".join(mixed).encode() + b"\n"})
    files |= {"tracker.csv": "\n".join(tracker).encode() + b"\n"}
    files["campaign.toml"] += b"\n" + more
    case = case_of(files)
    got = bring(case)
    forces = got.shown["forces"]

    assert len(forces) == 8
    assert forces["by"].tolist() == [0, 0, 1, 2, 0, 0, 0, 0]
    assert forces["reading_std_n"].tolist() == [2, 2, 0, 0, 2, 2, 2, 2]
    assert forces["fz_n"][2:4].tolist() == pytest.approx([-152.9 * G, -200 * G])
    assert forces[["uxx", "uyz"]][2:4].to_numpy().tolist() == [[0, 0], [0, 0]]
    assert forces["at_y_m"].isna().tolist() == [True] * 3 + [False] + [True] * 4
    assert len(pd.unique(forces["body"])) == 3


BAD_ROWS = {
    "two loads": ("1,1,60.0", "1,1,60.0,light", "more than one of force, mass and payload"),
    "no load": ("1,1,60.0", "1,1,,", "has no force, mass or payload"),
    "no payload of this name": ("1,1,60.0", "1,1,,lihgt", "no [payload] table of this name"),
    "no mass": ("1,1,60.0", "1,1,0,", "the mass is not above zero"),
}


@pytest.mark.parametrize("name", BAD_ROWS)
def test_a_row_that_is_no_load_is_left_out_and_named(name):
    """With its line, the reason and the way out; the other rows stay."""
    old, new, reason = BAD_ROWS[name]
    files = hang(HUNG, more=payload_tables())[0]
    rows = files["loads.csv"].decode().replace("mass_kg", "mass_kg,payload").splitlines()
    rows = [new if row == old else row if "pose" in row else f"{row}," for row in rows]
    case = case_of(dict(files, **{"loads.csv": "\n".join(rows).encode() + b"\n"}))
    told = case.rejected[case.rejected["file"] == "loads.csv"]

    assert len(case.loads) == 19
    assert told["line"].tolist() == [2]
    assert reason in told["reason"].iloc[0]


def test_readings_of_a_scale_need_its_table():
    """Without [scale] its uncertainty is unknown; weights do not need it."""
    files = dict(hang(HUNG)[0])
    files["loads.csv"] = files["loads.csv"].replace(b"mass_kg", b"force_n")

    with pytest.raises(InputError, match=r"loads.csv.*no table \[scale\].*sigma_n"):
        case_of(files)


def torques(files, q, repeats, seed=1, offset=3.0, noise=0.5, sense=-1.0, arm=200.0):
    """joints.csv with torques: those of the log's rows are of the load alone, or one row per state.

    The torques of a robot include its own weight, which is not part of the payload's.
    """
    rng = np.random.default_rng(seed)
    head = ["pose", *(["repeat"] if repeats else []), *(f"theta{j}_rad" for j in range(1, 7))]
    lines = [",".join([*head, *(f"tau{j}_nm" for j in range(1, 7))])]
    zero = offset * rng.standard_normal(6)
    for k, here in enumerate(q, 1):
        own = arm * np.sin(here) if repeats else np.zeros(6)
        work = [np.zeros(6), *(m * G * -slopes(here, at)[2] for m, at in PAYLOADS.values())]
        for r in range(3) if repeats else [k % 2 + 1]:
            tau = sense * (work[r] + own) + zero + noise * rng.standard_normal(6)
            cells = [k, *([r] if repeats else []), *map(float, here), *map(float, tau)]
            lines.append(",".join(map(repr, cells)))
    return dict(files, **{"joints.csv": ("\n".join(lines) + "\n").encode()})


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("repeats", [True, False])
def test_joint_torques_weigh_a_payload(repeats):
    """Mass and centre with correct uncertainties, whatever the sense, the offsets and the arm."""
    z, p = [], []
    files, _, _, q = hang(MOUNTED, more=payload_tables(), poses=12)
    if not repeats:  # each pose has one payload
        rows = [f"{k},1,{'heavy' if k % 2 else 'light'}" for k in range(1, 13)]
        files["loads.csv"] = "\n".join(["pose,repeat,payload", *rows]).encode()
    for seed in range(12):
        case = case_of(torques(files, q, repeats, seed, sense=(-1.0) ** seed))
        found = {one.name: one for one in payload_entries(case)}
        for name, (mass, center) in PAYLOADS.items():
            one, body = found[name], found[name].found
            z.append((body.mass_kg - mass) / body.mass_std_kg)
            z += ((np.array(body.center_m) - center) / body.center_std_m).tolist()
            p.append(one.p_value)
            assert body.mass_std_kg < 0.5
            assert one.poses == (12 if repeats else 6)

    assert 0.7 < np.std(z) < 1.4
    assert min(p) > 0.001
    assert np.mean(np.array(p) < 0.2) < 0.5


@pytest.mark.whole
def test_a_payload_that_the_torques_contradict_is_said():
    """Stated a tenth too heavy.

    The answer has both values, and the springs follow the statement.
    """
    files, _, _, q = hang(MOUNTED, more=payload_tables(heavier=1.1), poses=12)
    raw = in_memory(torques(files, q, True))
    answer = campaign_answer("heavy", raw).answer
    light, heavy = answer.payloads

    assert heavy.stated.mass_kg == pytest.approx(143)
    assert heavy.found.mass_kg == pytest.approx(130, abs=3)
    assert heavy.p_value < 0.001
    assert any("contradict the payload heavy" in line for line in answer.findings)
    assert light.name == "light"


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("stated", "accused"), [(143.0, {"light", "heavy"}), (130.0, set())])
def test_two_payloads_that_disagree_are_rivals(stated, accused):
    """One is a tenth lighter than stated, and only the other payload could tell which."""
    more = payload_tables().replace("mass_kg = 130.0", f"mass_kg = {stated}")
    answer = campaign_answer("two", in_memory(hang(MOUNTED, more=more, poses=12)[0])).answer
    causes = answer.diagnosis.causes
    named = {(one.name, one.where) for cause in causes for one in (cause, *cause.rivals)}

    assert {where for name, where in named if name == "payload_mass"} == accused
    assert {name for name, _ in named} <= {"payload_mass"}
    assert answer.diagnosis.verdict == ("ambiguous" if accused else "adequate")
    for one, x in zip(answer.stiffness, X, strict=True):
        if one.identifiable:
            low, high = one.compliance - 2.5 * one.compliance_std, one.compliance_std * 2.5
            assert low < x < one.compliance + high


def test_a_payload_alone_has_no_mass_to_compare_with():
    """An error of its mass would shift all stiffnesses alike; its centre may still be wrong."""
    alone = case_of(hang(MOUNTED[:1], more=payload_tables(), poses=12)[0])
    both = case_of(hang(MOUNTED, more=payload_tables(), poses=12)[0])

    labels = {effect.label for effect in catalogue(alone.robot, bring(alone).data.pulls)}
    of_two = {effect.label for effect in catalogue(both.robot, bring(both).data.pulls)}

    assert {one for one in labels if one.startswith("payload")} == {"payload_center:light"}
    assert {one for one in of_two if one.startswith("payload_mass")} == {
        "payload_mass:light", "payload_mass:heavy",
    }  # fmt: skip


@pytest.mark.whole
def test_a_centre_of_mass_elsewhere_is_named():
    """A tenth of a metre from its place in campaign.toml, with the payload's name."""
    more = payload_tables()
    at = PAYLOADS["heavy"][1]
    moved = more.replace(str(list(at)), str([at[0] + 0.1, *at[1:]]))
    assert moved != more
    answer = campaign_answer("aside", in_memory(hang(MOUNTED, more=moved, poses=12)[0])).answer
    cause = answer.diagnosis.causes[0]

    assert (cause.name, cause.where) == ("payload_center", "heavy")
    assert cause.parameters[0].value == pytest.approx(-0.1, abs=4 * cause.parameters[0].std)
    assert "wrong centre of mass of heavy" in " ".join(answer.verdict_sentence)


@pytest.mark.slow
def test_each_payload_is_predicted_from_the_other():
    """To the scatter of the readings if both are right; not if one of them is wrong."""
    good = campaign_answer("good", in_memory(hang(MOUNTED, more=payload_tables())[0])).answer
    wrong = payload_tables().replace("mass_kg = 130.0", "mass_kg = 160.0")
    bad = campaign_answer("bad", in_memory(hang(MOUNTED, more=wrong)[0])).answer
    alone = campaign_answer("one", in_memory(hang(MOUNTED[:1], more=payload_tables())[0])).answer
    held = good.validation.by_payload

    assert held.keys() == {"light", "heavy"}
    for name, rms in held.items():
        assert 1e3 * SIGMA < rms < 4e3 * SIGMA * (4 if name == "heavy" else 1)
    assert bad.joint_springs.validation.by_payload["heavy"] > 3 * held["heavy"]
    assert alone.validation.by_payload == {}


SLIPS = {
    "a mistyped mass": (
        "weights", "loads.csv", b"\n5,2,250", b"\n5,2,520", "520 kg", "agree with 248.",
    ),
    "another payload": ("payloads", "loads.csv", b"\n4,1,light", b"\n4,1,heavy", "heavy", "N"),
    "F_b upside down": (
        "weights", "campaign.toml", b"[joints]", b"[gravity]\ndirection = [0, 0, 1]\n\n[joints]",
        "move against them", "pull the other way",
    ),
}  # fmt: skip


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_in_the_loads_is_found_and_put_right(name):
    """In the unit of the row, once, and the springs are right without it."""
    load, file, old, new, *told = SLIPS[name]
    files = dict(simulate(Plan(name="s", seed=3, pulls={"load": load})).files)
    assert files[file].count(old) == 1
    files[file] = files[file].replace(old, new)
    answer = campaign_answer("slip", in_memory(files)).answer

    off = [
        (joint.value - joint.nominal) / joint.std
        for joint in answer.stiffness
        if joint.identifiable
    ]

    assert answer.diagnosis.verdict == "bad_data"
    assert len(answer.diagnosis.causes) == 1
    assert all(word in " ".join(answer.verdict_sentence) for word in told)
    assert len(off) == 5
    assert np.abs(off).max() < 4
