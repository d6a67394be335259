"""Notifications: to a webhook that a verdict has changed, to systemd that the service is alive."""

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
"""Timeout of a webhook [s]."""


class _Stay(urllib.request.HTTPRedirectHandler):
    """Follows no redirect: a login page is no delivery, and content goes to no other address."""

    def redirect_request(self, *_: Any) -> None:
        """Return None: no redirect is followed."""


def posted(address: str, content: Mapping[str, str | None]) -> bool:
    """Post a message to a webhook; return whether it was accepted. Ends whatever it answers.

    Args:
        address: Address of the webhook, http or https.
        content: Message, sent as JSON.
    """
    taken: list[bool] = []
    # a thread, because an answer that arrives byte by byte never reaches a socket's timeout
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


def systemd(state: str) -> None:
    """Send a state such as `READY=1` to systemd; does nothing if it did not start this process."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):  # abstract sockets of Linux, which have no file
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        line.sendto(state.encode(), address)
