"""Who is answered by the pages of `serve`: the own browser and programs, and nobody else."""

import asyncio

import httpx
import pytest

from pipeline.service.gate import Gate, reports

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
    """A link out of reports/, a path out of it, a zero byte: not found, and no traceback."""
    folder, secret = tmp_path / "reports", tmp_path / "secret.txt"
    folder.mkdir()
    secret.write_text("secret")
    (folder / "link").symlink_to(tmp_path)
    (folder / "file").symlink_to(secret)
    for path in ("/link/secret.txt", "/file", "/../secret.txt", "/%2e%2e/secret.txt", "/%00"):
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
