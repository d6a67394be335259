"""The counting of kills: whatever is lost or done twice is seen, by processes that are real."""

import json
import os
import random
import sys
import time

import pytest

from bench import kills

SLEEPS = [sys.executable, "-c", "import time; time.sleep(60)  # a marked child"]
STARTS = [sys.executable, "-c", f"import subprocess; subprocess.run({SLEEPS!r})"]


def until(there):
    """Wait until it is so."""
    end = time.monotonic() + 20
    while not there():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.fixture
def world(tmp_path):
    """A process that has a child, kept alive."""
    (tmp_path / "data" / "raw").mkdir(parents=True)
    made = kills.World(
        tmp_path, {"parent": lambda: STARTS}, {"child": "a marked child"}, os.environ
    )
    yield made
    made.end()


def test_each_kind_is_found_killed_and_begun_again(world, tmp_path):
    """The child too, which its own parent starts; what is alive already is left alone."""
    world.keep()
    world.keep()
    assert world.begun["parent"] == 1
    until(lambda: len(world.of("child")) > 1)  # the parent's own words name it, too
    rng, log = random.Random(1), tmp_path / "kills.log"
    (parent,) = world.of("parent")

    assert kills._killed(world, "parent", rng, log)
    until(lambda: not world.of("parent"))
    assert not kills._killed(world, "parent", rng, log)
    until(lambda: (world.keep(), world.begun["parent"] == 2)[1])
    assert world.of("parent") != [parent]
    assert log.read_text().split()[1:3] == ["parent", str(parent)]


def done(root, name, number=1):
    """A campaign's files, as a run leaves them."""
    for folder, file in (("data/processed", "manifest.json"), ("reports", "result.json")):
        path = root / folder / name / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"campaign": name, "number": number}))


def test_what_is_lost_doubled_or_unlike_is_counted(world, tmp_path):
    """Four campaigns came: one is whole, one done again, one other than these, one without."""
    audit = kills.Audit(tmp_path)
    for name in ("robot0000", "robot0001"):
        done(tmp_path, name)
    done(tmp_path, "robot0002", number=2)
    audit.look()
    audit.look()
    assert not audit.doubled
    os.utime(tmp_path / "data" / "processed" / "robot0001" / "manifest.json", ns=(1, 1))
    audit.look()
    (tmp_path / "reports" / "robot0000" / ".result.json.abcd1234").write_text("{")
    world.completed = lambda: kills.Counter({"robot0000": 1, "robot0002": 2})

    said = kills._told(world, audit, 4, kills.Counter(parent=3))

    assert said["lost"] == ["robot0003"]
    assert said["doubled"] == {"robot0001": 1}
    assert said["completed twice"] == {"robot0002": 2}
    assert said["kinds of result.json"] == 2
    assert said["half-written"] == 1
    assert said["kills"] == {"parent": 3}


def test_a_campaign_arrives_with_all_its_files(world, tmp_path):
    """In whatever order."""
    kills.arrive(tmp_path / "data" / "raw", "robot0000", {"a": b"1", "b": b"2"}, random.Random(1))

    assert (tmp_path / "data" / "raw" / "robot0000" / "a").read_bytes() == b"1"
    assert (tmp_path / "data" / "raw" / "robot0000" / "b").read_bytes() == b"2"
