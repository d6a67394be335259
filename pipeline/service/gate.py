"""What this machine shows of itself: Prefect's server and the reports, to its own browser alone.

`python -m pipeline.service.gate REPORTS PORT` serves Prefect's page and API at PORT and the folder
REPORTS one port further. A page of another origin is turned away at the door, and so is a request
for a host of another name, which is how a foreign page gets around the rule of origins.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Iterable
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pipeline.service.processes import PARENT, follow
from pipeline.service.server import HERE

_OWN_SITE = (b"same-origin", b"none")
"""What a browser says of a request from our own page, or from its address bar."""

_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"same-origin"),
)
"""So that no other page frames, embeds or reads ours."""


class Gate:
    """An ASGI application behind a check of who asks."""

    def __init__(self, app: ASGIApp, port: int) -> None:
        """Of an application that answers at a port of this machine."""
        self._app = app
        self._hosts = {f"{name}:{port}".encode() for name in (HERE, "localhost")}
        self._origins = {b"http://" + host for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or turn away."""
        if scope["type"] == "lifespan" or not (why := self._refused(scope)):
            await self._app(scope, receive, _hardened(send))
        elif scope["type"] == "http":
            await PlainTextResponse(f"{why}\n", 403)(scope, receive, _hardened(send))
        else:  # a websocket that is closed before it is accepted is answered with 403
            await send({"type": "websocket.close", "code": 1008, "reason": why})

    def _refused(self, scope: Scope) -> str:
        """Why nothing is answered; empty for one's own browser and programs."""
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
    """A link somebody clicked: the browser shows our page itself, and nobody else sees it."""
    document = _of(headers, b"sec-fetch-mode") == [b"navigate"]
    document = document and _of(headers, b"sec-fetch-dest") == [b"document"]
    return document and scope.get("method") == "GET"


def _hardened(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *_HEADERS]}
        await send(message)

    return sent


def reports(folder: str) -> ASGIApp:
    """The reports of a project; what lies elsewhere stays there, whatever links to it."""
    return Starlette(routes=[Mount("/", StaticFiles(directory=folder, html=True))])


def main(folder: str, port: str) -> None:
    """Serve both until told to stop."""
    follow(int(os.environ[PARENT]))
    from prefect.server.api.server import create_app

    asyncio.run(_served({int(port): create_app(final=True), int(port) + 1: reports(folder)}))


async def _served(apps: dict[int, Any]) -> None:
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


if __name__ == "__main__":
    main(*sys.argv[1:])
