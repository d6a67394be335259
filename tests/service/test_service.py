"""What a service keeps of its own runs, and what becomes of it when that is damaged."""

import contextlib
import http.server
import importlib.util
import os
import sqlite3
import subprocess
import sys
import threading

import pytest

from pipeline.base.errors import UsageError
from pipeline.service import server as service
from pipeline.service import supervisor


@pytest.fixture
def base(tmp_path):
    """A database with the tables that we ask Prefect for, and enough in it to be cut."""
    path = tmp_path / ".prefect" / "prefect.db"
    path.parent.mkdir()
    with contextlib.closing(sqlite3.connect(path)) as made:
        made.execute("pragma journal_mode = wal")
        for table in ("alembic_version", "flow_run", "deployment"):
            made.execute(f"create table {table} (word text)")
            made.executemany(f"insert into {table} values (?)", [("x" * 500,)] * 300)
        made.commit()
    return path


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def torn(path):
    data = bytearray(path.read_bytes())
    data[5000:60000] = os.urandom(55000)
    path.write_bytes(data)


def without_a_table(path):
    with contextlib.closing(sqlite3.connect(path)) as made:
        made.execute("drop table flow_run")
        made.commit()


def a_folder(path):
    path.unlink()
    path.mkdir()


DAMAGES = {
    "noise": lambda path: path.write_bytes(os.urandom(20000)),
    "cut": cut,
    "torn": torn,
    "text": lambda path: path.write_text("no database"),
    "table": without_a_table,
    "folder": a_folder,
    "pipe": lambda path: (path.unlink(), os.mkfifo(path)),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_database_is_moved_aside(base, tmp_path, damage):
    """It is kept under another name, which is said; then Prefect can begin anew."""
    damage(base)

    said = service.mended(tmp_path)
    (moved,) = base.parent.glob("prefect.db.damaged-*")

    assert not base.exists()
    assert str(moved) in said
    assert "cannot be read" in said
    assert service.mended(tmp_path) == ""


def test_a_sound_database_stays(base, tmp_path):
    """Also while somebody writes into it, and where there is none or an empty one."""
    with contextlib.closing(sqlite3.connect(base)) as other:
        other.execute("begin exclusive")
        assert service.mended(tmp_path) == ""
    base.write_bytes(b"")
    assert service.mended(tmp_path) == ""
    base.unlink()
    assert service.mended(tmp_path) == ""
    assert not base.exists()


@pytest.mark.parametrize(("code", "sound"), [(200, True), (401, True), (503, False), (500, False)])
def test_a_server_works_that_can_look_something_up(code, sound):
    """Its health alone says nothing of its database."""

    class Answer(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.answered(200)

        def do_POST(self):
            self.rfile.read(int(self.headers["Content-Length"]))
            self.answered(code)

        def answered(self, number):
            self.send_response(number)
            self.end_headers()
            self.wfile.write(b"1")

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            assert service.works(f"http://127.0.0.1:{server.server_port}/api") == sound
        finally:
            server.shutdown()


@pytest.mark.parametrize(
    ("name", "value", "usual"),
    [
        ("ALL_PROXY", "socks5h://127.0.0.1:9", "http://127.0.0.1:9"),
        ("ALL_PROXY", "::::", "http://127.0.0.1:9"),
        ("no_proxy", "[::1", "::1"),
        ("SSL_CERT_FILE", "/no/such/file", ""),
        ("SSL_CERT_FILE", __file__, ""),
    ],
)
def test_a_connection_that_prefect_cannot_take_is_a_sentence(
    tmp_path, monkeypatch, name, value, usual
):
    """Before it is imported, which would end in an error of its own; a usual one is taken."""
    monkeypatch.setattr(os, "environ", os.environ.copy())
    os.environ[name] = value
    if importlib.util.find_spec("socksio") and value.startswith("socks"):
        pytest.skip("httpx can speak to such a proxy here")
    with pytest.raises(UsageError, match="all_proxy, no_proxy and SSL_CERT_FILE"):
        service.settle(tmp_path)
    os.environ[name] = usual
    service.settle(tmp_path)


@pytest.mark.whole
@pytest.mark.parametrize(
    "name", ["PREFECT_LOGGING_LEVEL", "PREFECT_PROFILES_PATH", "PREFECT_LOGGING_SETTINGS_PATH"]
)
def test_a_setting_that_prefect_rejects_is_a_sentence(tmp_path, name):
    """No level, and a file that is neither TOML nor YAML."""
    (tmp_path / "LOUD").write_text("[[[")
    code = (
        "from pathlib import Path; from pipeline.service import server\n"
        f"server.settle(Path({str(tmp_path)!r})); server.see_settings()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {name: str(tmp_path / "LOUD")},
        capture_output=True,
        text=True,
        check=False,
    )

    assert "UsageError: Prefect rejects its settings (" in done.stderr


def test_one_looks_at_a_time(tmp_path):
    """Also where the last one has met an error; the next one is told at once."""
    with service.looking(tmp_path) as first, service.looking(tmp_path) as second:
        assert (first, second) == (True, False)
    with pytest.raises(ValueError, match="in the middle"), service.looking(tmp_path):
        raise ValueError("in the middle")

    with service.looking(tmp_path) as again:
        assert again


@pytest.mark.parametrize(
    ("said", "why"), [("first\nno \x1b level.\n", r"no \\x1b level"), ("", "it is silent")]
)
def test_a_server_that_does_not_start_is_quoted(tmp_path, said, why):
    """The last line of its log; an escape in it steers no terminal."""
    log = tmp_path / "server.log"
    words = [sys.executable, "-S", "-c", f"import sys; sys.stderr.write({said!r})"]
    server = supervisor._Child("Prefect's server", words, log, lambda: False)

    with pytest.raises(UsageError, match=rf"start \({why}\); .*server.log says more"):
        supervisor._started(server, threading.Event())
