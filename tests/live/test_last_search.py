"""New poses added to a finished search: same values; a contradiction repeats the search."""

import time

import pytest
from test_live import BASE, OTHERS, TITLES, of_pose, steps, table, wide

from pipeline import identify, load_campaign
from pipeline.library.campaign import Result
from pipeline.live.last_search import LastSearch
from pipeline.live.update import update_of
from pipeline.live.updates import QUIET_S, LiveState

SEVEN = [line for k in range(1, 8) for line in of_pose(k)]


def read(*lines):
    return load_campaign(table(*lines), name="demo")


@pytest.fixture(scope="module")
def standing():
    campaign = read(*SEVEN)
    return LastSearch.of(campaign, identify(campaign))


@pytest.mark.whole
def test_values_are_those_of_a_search(standing):
    """To a tenth of their uncertainty, at a fraction of the cost."""
    more = read(*SEVEN, *of_pose(8))
    began = time.process_time()
    found = standing.beside(more)
    quick = time.process_time() - began
    searched = identify(more)
    took = time.process_time() - began - quick

    was = [one.value for one in standing.result.stiffness if one.value]
    for one, other in zip(found.stiffness, searched.stiffness, strict=True):
        if other.value is None:
            assert one.value is None
            continue
        assert one.value == pytest.approx(other.value, abs=0.1 * other.std)
        assert one.std == pytest.approx(other.std, rel=0.1)
        assert one.relative_std == pytest.approx(one.std / one.value)
    assert not {*was} & {one.value for one in found.stiffness}
    assert found.answer.test_pose.deflection_mm == pytest.approx(
        searched.answer.test_pose.deflection_mm, abs=0.2 * searched.answer.test_pose.std_mm
    )
    assert quick < took / 2


FIRST = steps(8)[1]
CONTRADICTIONS = {
    "a wide reading": [*steps(8)[0], *[wide(one, 0.4) for one in FIRST[:1]], *FIRST[1:]],
    "a reflector of the chain off": [*steps(8)[0], *FIRST[:-1], wide(FIRST[-1], 200.0)],
    "a round of the base": [one.replace("base_start", "base_end") for one in BASE],
}


@pytest.mark.whole
@pytest.mark.parametrize("lines", CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_what_contradicts_calls_the_search(standing, lines):
    assert isinstance(standing.beside(read(*SEVEN, *lines)), tuple)


@pytest.mark.whole
def test_another_reading_in_an_old_place_calls_the_search(standing):
    """Whether it is read again further down, or the file is rewritten with another number."""
    again = [wide(SEVEN[3], 0.01)]
    anew = [*SEVEN[:3], *again, *SEVEN[4:]]

    assert standing.beside(read(*SEVEN, *again)) == ()
    assert standing.beside(read(*anew)) == ()
    assert isinstance(standing.beside(read(*SEVEN)), Result)


@pytest.mark.whole
@pytest.mark.parametrize("change", ["campaign.toml", "joints.csv", "loads.csv"])
def test_another_log_or_setting_calls_the_search(standing, change):
    files = table(*SEVEN)
    old = {
        "campaign.toml": (b"sigma_n = 2.0", b"sigma_n = 3.0"),
        "joints.csv": (b"\n1,", b"\n1,1"),
        "loads.csv": (b"\n1,1,", b"\n1,1,1"),
    }[change]
    assert old[0] in files[change]
    files[change] = files[change].replace(*old, 1)

    assert standing.beside(load_campaign(files, name="demo")) == ()


@pytest.mark.whole
def test_after_a_quarter_more_poses_causes_are_sought_again(standing):
    lines = [line for k in range(8, 10) for line in of_pose(k)]

    assert isinstance(standing.beside(read(*SEVEN, *of_pose(8))), Result)
    assert isinstance(standing.beside(read(*SEVEN, *lines)), tuple)


@pytest.mark.whole
def test_the_last_planned_pose_is_searched_and_a_pause_too():
    """The final output is the answer of `run`, to the last digit."""
    cut = {**OTHERS}
    head, *rows = cut["joints.csv"].decode().splitlines(keepends=True)
    cut["joints.csv"] = "".join([head, *rows[:8]]).encode()
    state = LiveState("demo")
    told = []
    for k in range(6, 9):
        lines = [line for j in range(1, k + 1) for line in of_pose(j)]
        files = cut | {"tracker.csv": "".join([TITLES, *BASE, *lines]).encode()}
        told.append(state.look(files, 60.0 * k))
    result = identify(load_campaign(files, name="demo"))

    assert [one.searched for one in told] == [True, False, True]
    assert [one.value for one in told[-1].stiffness] == [one.value for one in result.stiffness]
    assert told[-1].verdict == result.verdict
    assert state.look(files, 480.0 + 2 * QUIET_S) is None

    paused = LiveState("demo")
    for k in (6, 7):
        lines = [line for j in range(1, k + 1) for line in of_pose(j)]
        files = table(*lines)
        last = paused.look(files, 60.0 * k)
    assert not last.searched
    later = paused.look(files, 420.0 + 2 * QUIET_S)
    result = identify(load_campaign(files, name="demo"))
    assert later.searched
    assert [one.value for one in later.stiffness] == [one.value for one in result.stiffness]


@pytest.mark.whole
def test_what_nothing_explains_is_told_though_the_search_is_silent(standing):
    """A zero and the one pull read from it: a second pull shows which of them is off."""
    zero, pull = steps(8)[:2]
    bad = [wide(line, 0.45) if ",P2," in line else line for line in pull]
    doubted = standing.beside(read(*SEVEN, *zero, *bad))
    silent = update_of(read(*SEVEN), standing.result, None, doubted)

    (suspect,) = silent.suspects
    assert suspect.readings == doubted[0].at
    assert len(suspect.readings) == 2
    assert "pose08_rep1_loaded/P2" in suspect.text
    assert suspect.text.endswith("Measure it again, or correct the file.")
    assert update_of(read(*SEVEN), standing.result).suspects == ()


@pytest.mark.whole
def test_a_reading_that_is_shot_again_is_cleared_by_a_search():
    state = LiveState("demo")
    state.look(table(*SEVEN), 0.0)
    zero, pull = steps(8)[:2]
    bad = [wide(line, 0.45) if ",P2," in line else line for line in pull]
    told = state.look(table(*SEVEN, *zero, *bad), 8.0)
    right = [line for line in pull if ",P2," in line]
    cleared = state.look(table(*SEVEN, *zero, *bad, *right), 16.0)

    assert told.suspects
    assert cleared.suspects == ()
    assert cleared.searched
