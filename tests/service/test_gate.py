"""Who is answered by the pages of `serve`: the own browser and programs, and nobody else."""

import asyncio
import base64
import contextlib
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from starlette.responses import PlainTextResponse

from bench.bench_service import free_port
from pipeline.service import server, supervisor
from pipeline.service.gate import Door, Gate, reports

HERE = Path(__file__).parents[2]
PORT = 4200
OWN = {"host": f"127.0.0.1:{PORT}"}


def asked(folder, path="/a/index.html", method="GET", **headers):
    """What is answered to a request with these headers."""
    (folder / "a").mkdir(exist_ok=True)
    (folder / "a" / "index.html").write_text("the report")
    transport = httpx.ASGITransport(Gate(reports(str(folder)), PORT))

    async def ask():
        async with httpx.AsyncClient(transport=transport, base_url="http://x") as client:
            named = {name.replace("_", "-"): value for name, value in headers.items()}
            return await client.request(method, path, headers=OWN | named)

    return asyncio.run(ask())


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"host": f"localhost:{PORT}"},
        {"origin": f"http://127.0.0.1:{PORT}"},
        {"sec_fetch_site": "same-origin"},
        {"sec_fetch_site": "none", "sec_fetch_mode": "navigate", "sec_fetch_dest": "document"},
        {
            "sec_fetch_site": "cross-site",
            "sec_fetch_mode": "navigate",
            "sec_fetch_dest": "document",
        },
    ],
    ids=["curl", "localhost", "own origin", "own page", "typed", "a link in a chat"],
)
def test_the_own_browser_is_answered(tmp_path, headers):
    """Programs of this machine, its browser, and a link that somebody clicks."""
    answer = asked(tmp_path, **headers)

    assert (answer.status_code, answer.text) == (200, "the report")
    assert answer.headers["x-frame-options"] == "DENY"


@pytest.mark.parametrize(
    "headers",
    [
        {"host": f"evil.example:{PORT}"},
        {"host": "127.0.0.1"},
        {"host": f"127.0.0.1:{PORT + 1}"},
        {"host": f"127.0.0.1:{PORT}.evil.example"},
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": f"http://127.0.0.1:{PORT + 1}"},
        {"origin": f"https://127.0.0.1:{PORT}"},
        {"sec_fetch_site": "cross-site", "sec_fetch_mode": "no-cors", "sec_fetch_dest": "image"},
        {"sec_fetch_site": "same-site", "sec_fetch_mode": "cors", "sec_fetch_dest": "empty"},
        {
            "sec_fetch_site": "cross-site",
            "sec_fetch_mode": "navigate",
            "sec_fetch_dest": "iframe",
        },
    ],
)
def test_a_foreign_page_gets_nothing(tmp_path, headers):
    """Another host, another origin, another port, a picture or a frame in a foreign page."""
    answer = asked(tmp_path, **headers)

    assert answer.status_code == 403
    assert "the report" not in answer.text


def test_a_form_of_a_foreign_page_is_no_link(tmp_path):
    """It navigates, too, but it posts."""
    navigates = {"sec_fetch_mode": "navigate", "sec_fetch_dest": "document"}
    answer = asked(tmp_path, method="POST", sec_fetch_site="cross-site", **navigates)

    assert answer.status_code == 403


def test_what_lies_elsewhere_stays_there(tmp_path):
    """A link out of reports/ or in a circle, a path out of it, a zero byte: not found."""
    folder, secret = tmp_path / "reports", tmp_path / "secret.txt"
    folder.mkdir()
    secret.write_text("secret")
    (folder / "link").symlink_to(tmp_path)
    (folder / "file").symlink_to(secret)
    (folder / "round").symlink_to("about")
    (folder / "about").symlink_to("round")
    inside = ("/link/secret.txt", "/file", "/round", "/round/secret.txt", "/about/")
    for path in (*inside, "/../secret.txt", "/%2e%2e/secret.txt", "/%00"):
        answer = asked(folder, path)

        assert (answer.status_code, "secret" in answer.text) == (404, False), path


def test_a_websocket_of_a_foreign_page_is_closed(tmp_path):
    """Before it is accepted."""
    sent = []

    async def send(message):
        sent.append(message)

    headers = [(b"host", f"127.0.0.1:{PORT}".encode()), (b"origin", b"http://evil.example")]
    scope = {"type": "websocket", "path": "/", "headers": headers}
    asyncio.run(Gate(reports(str(tmp_path)), PORT)(scope, None, send))

    assert [message["type"] for message in sent] == ["websocket.close"]


async def prefect(scope, receive, send):
    """An application that says where it was asked."""
    await PlainTextResponse(f"asked at {scope['path']}")(scope, receive, send)


def visited(root, *paths, method="GET"):
    """What a browser gets at these addresses of Prefect's page."""
    transport = httpx.ASGITransport(Gate(Door(prefect, root), PORT))

    async def visit():
        async with httpx.AsyncClient(transport=transport, base_url="http://x") as client:
            return [await client.request(method, path, headers=OWN) for path in paths]

    return asyncio.run(visit())


@pytest.fixture
def home(tmp_path):
    """A project with a password."""
    (tmp_path / server.HOME).mkdir()
    (tmp_path / server.HOME / server.PASSWORD).write_text("pipeline:secret word")
    return tmp_path


def test_a_key_opens_once(home):
    """Its browser learns the password, in base64 as the page keeps it; the next one nothing."""
    key = supervisor.key(home)
    path = home / server.HOME / server.KEY
    assert path.stat().st_mode & 0o077 == 0
    first, second, page = visited(home, f"/enter/{key}", f"/enter/{key}", "/runs")

    assert first.status_code == 200
    assert base64.b64encode(b"pipeline:secret word").decode() in first.text
    assert first.headers["cache-control"] == "no-store"
    assert "script-src 'nonce-" in first.headers["content-security-policy"]
    assert second.status_code == 403
    assert (home / server.HOME / server.PASSWORD).as_posix() in second.text
    assert page.text == "asked at /runs"
    assert not path.exists()


@pytest.mark.parametrize("given", ["", "x", "%00", "%ff", "%2e%2e/password", "a" * 10_000])
def test_another_key_opens_nothing(home, given):
    """And leaves the right one as it is."""
    key = supervisor.key(home)
    (answer,) = visited(home, f"/enter/{given}")
    (posted,) = visited(home, f"/enter/{key}", method="POST")

    assert (answer.status_code, posted.status_code) == (403, 403)
    assert "c2VjcmV0" not in answer.text + posted.text
    assert (home / server.HOME / server.KEY).read_text() == key


def test_without_a_key_nothing_opens(home):
    """Where nobody watched the start, as under systemd, no key lies there."""
    (answer,) = visited(home, "/enter/")

    assert answer.status_code == 403


def test_the_first_page_says_how_campaigns_stand(tmp_path):
    """Also before any report is there; it is asked for again, and kept by nobody."""
    (tmp_path / "data" / "raw" / "half").mkdir(parents=True)
    (tmp_path / "reports").mkdir()
    answer = asked(tmp_path / "reports", "/")

    assert answer.status_code == 200
    assert "half" in answer.text
    assert answer.headers["refresh"] == "10"
    assert asked(tmp_path / "reports").text == "the report"


SERVED = """
import asyncio, resource, sys
from pipeline.service import gate
resource.setrlimit(resource.RLIMIT_NOFILE, (64, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
asyncio.run(gate._served({int(sys.argv[2]): gate.reports(sys.argv[1])}))
"""


def test_who_connects_and_asks_nothing_keeps_nobody_out(tmp_path):
    """Three times as many half requests as a process may open files: the next is answered."""
    (tmp_path / "a.txt").write_text("the report")
    port = free_port()
    command = [sys.executable, "-c", SERVED, str(tmp_path), str(port)]
    with contextlib.ExitStack() as stack:
        running = stack.enter_context(
            subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(HERE)})
        )
        stack.callback(running.kill)
        for _ in range(200):
            one = stack.enter_context(connected(port))
            one.sendall(b"GET / HTTP/1.1\r\n")
        answer = httpx.get(f"http://127.0.0.1:{port}/a.txt", timeout=10, trust_env=False)

    assert answer.text == "the report"


def connected(port):
    """A connection, once somebody listens."""
    until = time.monotonic() + 60
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=5)
        except OSError:
            assert time.monotonic() < until
            time.sleep(0.2)
