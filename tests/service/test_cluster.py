"""A Dask cluster on this machine: what it computes is what is computed here, whoever is lost."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pipeline.app.shell import run_all
from pipeline.base.errors import Unfinished, UsageError
from pipeline.service.cluster import Cluster
from pipeline.service.many import several

HERE = Path(__file__).parents[2]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
NAMES = [f"c{k}" for k in range(4)]
DASK = [sys.executable, "-m", "dask"]

distributed = pytest.importorskip("distributed", reason="pip install 'rail-stiffness[cluster]'")
pytestmark = [
    pytest.mark.slow,
    # the client's own: it closes its sockets after its loop
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def cluster(tmp_path):
    """A scheduler and two workers, which know the project but not the folder."""
    address = f"tcp://127.0.0.1:{free_port()}"
    options = ["--no-dashboard", "--host", "127.0.0.1"]
    environment = os.environ | {
        "PYTHONPATH": f"{HERE}{os.pathsep}{Path(__file__).parent}",
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2",
    }
    commands = [[*DASK, "scheduler", *options, "--port", address.rpartition(":")[2]]]
    for k in range(2):
        room = tmp_path / f"worker{k}"
        room.mkdir()
        commands += [[*DASK, "worker", address, "--nthreads", "1", "--no-nanny", *options,
                      "--local-directory", room]]  # fmt: skip
    with contextlib.ExitStack() as stack, (tmp_path / "dask.log").open("wb") as log:
        running = []
        for command in commands:
            one = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=log, stderr=log)
            stack.callback(one.wait)
            stack.callback(one.kill)
            running.append(one)
        with distributed.Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=120)
        yield address, running[1:]


def project(root):
    for name in NAMES:
        shutil.copytree(KEPT, root / "data" / "raw" / name)
    (root / "data" / "raw" / NAMES[-1] / "joints.csv").write_bytes(b"no table at all")
    return root


def test_a_killed_worker_costs_nothing(cluster, tmp_path):
    """Each campaign is told once, as it would be here; what is rejected is remembered here."""
    address, workers = cluster
    there, here = project(tmp_path / "there"), project(tmp_path / "here")
    told = []
    for done in run_all(there, [], "local", False, several(None, address)):
        if not told:
            workers[0].send_signal(signal.SIGKILL)
        told.append((done.campaign, json.dumps(done.content), done.exit_code))

    plain = [(o.campaign, json.dumps(o.content), o.exit_code)
             for o in run_all(here, [], "local", False)]  # fmt: skip
    assert sorted(told) == sorted(plain)
    for path in (here / "reports").rglob("result.json"):
        assert (there / path.relative_to(here)).read_bytes() == path.read_bytes()
    assert (there / "data" / "processed" / NAMES[-1] / "rejection.json").is_file()


class Unreadable:
    """What a worker can send and nobody can take."""

    def __reduce__(self):
        return int, ("no number",)


def halved(item):
    if item == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if item == 3:
        raise ValueError("three is odd")
    if item == 5:
        return Unreadable()
    return item / 2


def test_what_an_item_raises_comes_back_as_its_problem(cluster):
    """And stops none of the others."""
    found = {done.item: done for done in Cluster(cluster[0]).results(halved, [0, 2, 3, 4, 5])}

    values = {0: 0.0, 2: 1.0, 3: None, 4: 2.0, 5: None}
    assert {k: done.value for k, done in found.items()} == values
    with pytest.raises(Unfinished, match=r"cannot be read here \(ValueError: invalid"):
        raise found[5].problem
    assert "in halved" in found[3].problem.__notes__[0]


def test_an_item_that_kills_every_worker_is_given_up(cluster):
    """Where none is left the run ends with a sentence instead of waiting for ever."""
    with pytest.raises(Unfinished, match="no worker any more"):
        list(Cluster(cluster[0]).results(halved, [1]))


def slept(item):
    time.sleep(5)
    return item


def test_a_worker_that_stands_still_costs_nothing(cluster, monkeypatch):
    """Its item is another one's long before the scheduler would give it up, after ten minutes."""
    monkeypatch.setattr("pipeline.service.cluster._DESERTED_S", 15.0)
    address, workers = cluster
    threading.Timer(2.0, workers[0].send_signal, [signal.SIGSTOP]).start()
    began = time.monotonic()
    found = sorted(done.value for done in Cluster(address).results(slept, range(4)))

    assert found == [0, 1, 2, 3]
    assert time.monotonic() - began < 180


def test_a_cluster_without_workers_says_so(cluster):
    """After the last one is gone: what it kills is no endless wait, and the next run is told."""
    address, workers = cluster
    for worker in workers:
        worker.kill()
        worker.wait()
    with distributed.Client(address, timeout=60, set_as_default=False) as client:
        until = time.monotonic() + 60
        while client.nthreads() and time.monotonic() < until:
            time.sleep(0.2)
    with pytest.raises(UsageError, match="has no workers: start some"):
        list(Cluster(address).results(halved, [0]))
