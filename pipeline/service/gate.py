"""Prefect's server and the reports, served to browsers of this machine only.

`python -m pipeline.service.gate REPORTS PORT` serves Prefect's page and API at PORT and the folder
REPORTS at the next port. Requests from pages of another origin are rejected, and so are requests
for a host of another name, by which a foreign page could evade the same-origin policy. The first
page of the reports shows the state of every campaign. A link printed where the service was started
admits its browser to Prefect's page, once.
"""

from __future__ import annotations

import asyncio
import base64
import errno
import json
import os
import resource
import secrets
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pipeline.base.errors import UsageError
from pipeline.service.processes import PARENT, follow
from pipeline.service.server import ENTER, HERE, HOME, KEY, PASSWORD, known_password, see_settings

_OWN_SITE = (b"same-origin", b"none")
"""Values of Sec-Fetch-Site for a request from our own page, or from the address bar."""

_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"same-origin"),
)
"""Headers that prevent other pages from framing, embedding or reading ours."""


class Gate:
    """ASGI application behind a check of host and origin."""

    def __init__(self, app: ASGIApp, port: int) -> None:
        """Guard an application that answers at a port of this machine."""
        self._app = app
        self._hosts = {f"{name}:{port}".encode() for name in (HERE, "localhost")}
        self._origins = {b"http://" + host for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer the request, or reject it."""
        if scope["type"] == "lifespan" or not (why := self._refused(scope)):
            await self._app(scope, receive, _hardened(send))
        elif scope["type"] == "http":
            await PlainTextResponse(f"{why}\n", 403)(scope, receive, _hardened(send))
        else:  # a websocket closed before it is accepted is answered with 403
            await send({"type": "websocket.close", "code": 1008, "reason": why})

    def _refused(self, scope: Scope) -> str:
        """Why a request is rejected; empty for the local browser and local programs."""
        headers = list(scope["headers"])
        if _of(headers, b"host") not in [[host] for host in self._hosts]:
            return "this server answers to 127.0.0.1 and localhost only"
        if any(origin not in self._origins for origin in _of(headers, b"origin")):
            return "this server answers to its own pages only"
        foreign = any(site not in _OWN_SITE for site in _of(headers, b"sec-fetch-site"))
        if foreign and not _followed(scope, headers):
            return "this server answers to its own pages only"
        return ""


def _of(headers: Iterable[tuple[bytes, bytes]], name: bytes) -> list[bytes]:
    return [value for key, value in headers if key.lower() == name]


def _followed(scope: Scope, headers: Iterable[tuple[bytes, bytes]]) -> bool:
    """Whether a link was followed: our page is then shown, and no other page can read it."""
    document = _of(headers, b"sec-fetch-mode") == [b"navigate"]
    document = document and _of(headers, b"sec-fetch-dest") == [b"document"]
    return document and scope.get("method") == "GET"


def _hardened(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *_HEADERS]}
        await send(message)

    return sent


class Door:
    """Prefect's application, and a link by which its owner's browser learns the password, once.

    The key is in a file that only its owner can read; it is deleted at first use.
    """

    def __init__(self, app: ASGIApp, root: Path) -> None:
        """Guard Prefect's application for a project."""
        self._app, self._root = app, root

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer the link, or pass the request on to the application."""
        asked = scope["type"] == "http" and scope["path"].startswith(ENTER)
        await (self._entered(scope) if asked else self._app)(scope, receive, send)

    def _entered(self, scope: Scope) -> Response:
        given, password = scope["path"].removeprefix(ENTER), known_password(self._root)
        if scope["method"] != "GET" or password is None or not self._taken(given):
            why = f"used up; Prefect's page asks for the line in {self._root / HOME / PASSWORD}\n"
            return PlainTextResponse(why, 403, _UNKEPT)
        mark = secrets.token_urlsafe(16)
        known = base64.b64encode(password.encode()).decode()  # encoded as Prefect's page stores it
        words = f"localStorage.setItem('prefect-password', {json.dumps(known)})"
        script = f"<script nonce='{mark}'>{words}; location.replace('/')</script>"
        policy = f"default-src 'none'; script-src 'nonce-{mark}'"
        kept = {**_UNKEPT, "content-security-policy": policy}
        return HTMLResponse(f"<!doctype html><title>Prefect</title>{script}", headers=kept)

    def _taken(self, given: str) -> bool:
        """Whether this is the key; the file is removed, so that only one request succeeds."""
        path = self._root / HOME / KEY
        try:
            right = secrets.compare_digest(path.read_bytes(), given.encode("utf-8", "replace"))
            if right:
                path.unlink()
        except OSError:
            return False
        return right


_UNKEPT = {"cache-control": "no-store"}


def reports(folder: str) -> ASGIApp:
    """The reports of a project; links to files elsewhere are not followed."""

    def first(_: Request) -> Response:
        from pipeline.service.status import now  # imports pandas, which takes a second

        return HTMLResponse(now(Path(folder).parent), headers={**_UNKEPT, "refresh": "10"})

    return Starlette(routes=[Route("/", first), Mount("/", _Found(directory=folder, html=True))])


class _Found(StaticFiles):
    """Files of a folder; what a link in a circle leads to is not there."""

    def lookup_path(self, path: str) -> tuple[str, os.stat_result | None]:
        try:
            return super().lookup_path(path)
        except OSError as problem:
            if problem.errno == errno.ELOOP:
                return "", None
            raise


def main(folder: str, port: str) -> None:
    """Serve both until told to stop."""
    follow(int(os.environ[PARENT]))
    try:
        see_settings()
    except UsageError as problem:
        sys.exit(str(problem))
    from prefect.server.api.server import create_app

    prefect = Door(create_app(final=True), Path(folder).parent)
    asyncio.run(_served({int(port): prefect, int(port) + 1: reports(folder)}))


async def _served(apps: dict[int, Any]) -> None:
    _with_room()
    servers = [
        uvicorn.Server(
            uvicorn.Config(
                Gate(app, port),
                host=HERE,
                port=port,
                log_level="warning",
                server_header=False,
                timeout_graceful_shutdown=3,
            )
        )
        for port, app in apps.items()
    ]
    await asyncio.gather(*(server.serve() for server in servers))


_CONNECTIONS = 2**16
"""Maximum number of open connections, if the system allows as many: all that one address can
open."""


def _with_room() -> None:
    """Raise the limit of open files, so that idle connections cannot exhaust the usual 1024."""
    few, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _CONNECTIONS if most == resource.RLIM_INFINITY else min(most, _CONNECTIONS)
    if few != resource.RLIM_INFINITY and few < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))


if __name__ == "__main__":
    main(*sys.argv[1:])
