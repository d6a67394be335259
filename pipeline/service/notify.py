"""Telling others: a webhook that a verdict has changed, systemd that the service is alive."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Mapping
from typing import Any

_PATIENCE_S = 10.0
"""How long a webhook may take to answer [s]."""


class _Stay(urllib.request.HTTPRedirectHandler):
    """Follows no redirect: a login page is no delivery, and nobody is told another address."""

    def redirect_request(self, *_: Any) -> None:
        """None to follow."""


def posted(address: str, content: Mapping[str, str | None]) -> bool:
    """Whether a webhook has taken a message; whatever it answers, this ends.

    Args:
        address: Of the webhook, http or https.
        content: What it gets, as JSON.
    """
    taken: list[bool] = []
    # a thread, because an answer that comes byte by byte keeps below every timeout of a socket
    post = threading.Thread(target=lambda: taken.append(_post(address, content)), daemon=True)
    post.start()
    post.join(2 * _PATIENCE_S)
    return taken == [True]


def _post(address: str, content: Mapping[str, str | None]) -> bool:
    try:
        request = urllib.request.Request(
            address, json.dumps(content).encode(), {"Content-Type": "application/json"}
        )
        with urllib.request.build_opener(_Stay).open(request, timeout=_PATIENCE_S) as answer:
            return 200 <= int(answer.status) < 300
    except (OSError, http.client.HTTPException, ValueError):
        return False


def systemd(said: str) -> None:
    """Tell systemd how the service is, such as `READY=1`; nothing where it did not start us."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):  # Linux's sockets without a file
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        line.sendto(said.encode(), address)
