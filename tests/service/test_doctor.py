"""`pipeline doctor` on a running service: what is wrong with it, from what it left on disk."""

import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

import pytest

from pipeline.service import doctor
from pipeline.service.server import LOOKED, RUNNING


@pytest.fixture
def noted(tmp_path):
    """A project with notes of a service: `noted(running=..., looked=...)` gives the findings."""
    processed = tmp_path / "data" / "processed"
    processed.mkdir(parents=True)
    (tmp_path / "data" / "raw" / "a").mkdir(parents=True)
    (tmp_path / "data" / "raw" / "a" / "campaign.toml").write_text("")

    def write(running=None, looked=None, seen=None, toml=""):
        for name, content in ((RUNNING, running), (LOOKED, looked), ("a/seen.json", seen)):
            if content is not None:
                (processed / name).parent.mkdir(exist_ok=True)
                (processed / name).write_text(json.dumps(content))
        (tmp_path / "pipeline.toml").write_text(toml)
        return {finding.what: finding for finding in doctor.examine(tmp_path)}

    return write


HERE = {"process": os.getpid(), "every_s": 60.0}


def test_a_disk_without_room_for_files_is_full(tmp_path):
    """Gigabytes are free, and its table of files is full; mounting takes an administrator."""
    disk = ["mount", "-t", "tmpfs", "-o", "size=3g,nr_inodes=50", "tmpfs", tmp_path]
    if subprocess.run(disk, capture_output=True, check=False).returncode:
        pytest.skip("this user may not mount a disk")
    try:
        found = {one.what: one for one in doctor.examine(tmp_path)}["disk"]
    finally:
        subprocess.run(["umount", "-l", tmp_path], check=True)

    assert (found.good, found.text) == (False, "3 GiB free, for 49 files; make room")


def test_a_service_that_is_gone_is_no_service(noted):
    """Its note stayed behind when it was killed."""
    ended = subprocess.Popen(["true"])
    ended.wait()
    found = noted(running={"process": ended.pid, "every_s": 60.0}, looked={"began": 0.0})

    assert found["service"].text.startswith("not running")
    assert "looks" not in found


@pytest.mark.parametrize(
    ("looked", "good", "said"),
    [
        ({"began": -30.0, "ended": -29.0}, True, "the last was at"),
        ({"began": -600.0, "ended": -590.0}, False, "none since"),
        ({"began": -600.0, "ended": None}, True, "one is at work"),
        ({"began": -6000.0, "ended": None}, False, "one is at work"),
        ({"began": 3600.0, "ended": 3601.0}, False, "clock was set back"),
    ],
)
def test_looks_that_do_not_come_are_told(noted, looked, good, said):
    """Seconds from now: late, hanging, or from a future that is none."""
    now = time.time()
    moments = {name: at if at is None else now + at for name, at in looked.items()}
    found = noted(running=HERE, looked=moments)["looks"]

    assert (found.good, said in found.text) == (good, True)


def test_a_service_on_another_host_is_not_looked_for_here(noted, tmp_path):
    """The number of its process and the address of its server mean others on this machine."""
    ended = subprocess.Popen(["true"])
    ended.wait()
    (tmp_path / ".prefect").mkdir()
    urls = {"page": "http://127.0.0.1:9", "api": "http://127.0.0.1:9/api", "reports": "x"}
    (tmp_path / ".prefect" / "serving.json").write_text(json.dumps(urls))
    afar = {"process": ended.pid, "every_s": 60.0, "host": "hall-7"}
    found = noted(running=afar, looked={"began": time.time()})

    said = f"runs as process {ended.pid} on hall-7, as it noted; ask there"
    assert (found["service"].good, found["service"].text) == (True, said)
    server = found["Prefect server"]
    assert (server.good, server.text) == (True, "is that of the service on hall-7")
    late = noted(running=afar, looked={"began": time.time() - 600, "ended": time.time() - 590})
    assert not late["looks"].good


@pytest.mark.skipif(os.getuid() != 0, reason="becomes another user")
def test_another_users_server_is_not_known():
    """Its folder is closed: that it cannot be read does not mean that nothing is there."""
    with tempfile.TemporaryDirectory() as name:
        root, (taken, given) = Path(name), os.pipe()
        root.chmod(0o755)
        (root / ".prefect").mkdir(mode=0o700)
        if (child := os.fork()) == 0:
            os.setuid(65534)
            os.write(given, doctor._server(root, "").text.encode())
            os._exit(0)
        os.waitpid(child, 0)
        said = os.read(taken, 1000).decode()

    assert said == f"not known: {root}/.prefect is another user's, ask as who serves"


def test_what_waits_is_told(noted):
    """A campaign that is tried again with its reason, and a verdict that nobody took."""
    failed = {"print": "x", "verdict": "failed", "said": "was away.", "attempts": 2, "tried": 1e9}
    found = noted(running=HERE, looked={"began": time.time()}, seen=failed)
    assert found["a"].text.startswith("tried 2 times, again at 2001-09-09")
    assert found["a"].text.endswith("was away.")

    done = {"print": "x", "verdict": "adequate", "told": None}
    hook = "[notify]\nwebhook = 'https://chat.example/x'\n"
    assert "the webhook did not accept" in noted(seen=done, toml=hook)["a"].text
    assert "a" not in noted(seen=done | {"told": "adequate"}, toml=hook)


def test_a_server_that_is_gone_is_told(noted, tmp_path):
    """`serve` says where it is; nobody answers there."""
    (tmp_path / ".prefect").mkdir()
    urls = {"page": "http://127.0.0.1:9", "api": "http://127.0.0.1:9/api", "reports": "x"}
    (tmp_path / ".prefect" / "serving.json").write_text(json.dumps(urls))
    found = noted(running=HERE)["Prefect server"]

    assert not found.good
    assert "server.log" in found.text
