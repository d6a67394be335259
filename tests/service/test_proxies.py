"""A proxy from the environment is used for the web, but never for this machine."""

import http.server
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

HERE = Path(__file__).parents[2]
NOWHERE = "http://127.0.0.1:9"
ASKED = """
import sys
import pipeline.app
import httpx
from pipeline.service.server import answers
print(answers(sys.argv[1]), httpx.get(sys.argv[1] + "/health").status_code)
print(*sorted(__import__("urllib.request").request.getproxies()["no"].split(",")))
"""


class Well(http.server.BaseHTTPRequestHandler):
    """Responds that all is well."""

    def do_GET(self):
        """Respond only that."""
        self.send_response(200)
        self.end_headers()

    def log_message(self, *_):
        """Log nothing."""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["no_proxy", "NO_PROXY"])
def test_pages_of_this_machine_are_asked_directly(name):
    """By urllib and by Prefect's httpx, whatever the proxies; the user's exclusions are kept."""
    proxies = dict.fromkeys(("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"), NOWHERE)
    clean = {k: v for k, v in os.environ.items() if not k.lower().endswith("_proxy")}
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Well) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        done = subprocess.run(
            [sys.executable, "-c", ASKED, f"http://127.0.0.1:{server.server_port}"],
            capture_output=True,
            text=True,
            env=clean | proxies | {name: "intern.example", "PYTHONPATH": str(HERE)},
            timeout=120,
            check=False,
        )
        server.shutdown()

    assert done.stdout.splitlines() == ["True 200", "127.0.0.1 intern.example localhost"], done
