"""The pages of `pipeline page`, on an address of this machine, for holders of its token."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import os
import re
import secrets
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, zip_longest
from operator import add, itemgetter
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2
import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
)
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from pipeline.answer.contract import About, Answer
from pipeline.base import files, toml
from pipeline.base.errors import CannotWrite, InputError, UsageError
from pipeline.base.quantities import common_prefix, plain, prefixed
from pipeline.base.shown import printable
from pipeline.machine.robot import SHIPPED, load
from pipeline.page import drawing, entries
from pipeline.page.desk import MOST_BYTES, TOML, Desk, campaigns, named
from pipeline.page.jobs import CommandOutput, LiveJob, Runs, command, stage
from pipeline.store.campaign import CampaignFolder

HERE = "127.0.0.1"

_STAGES = ("files", "setup", "check", "run", "answer")

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy of our own pages: nothing external, no inline script or style."""

_OF_REPORTS = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: "
    "'self'; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "sandbox allow-scripts allow-downloads allow-popups allow-popups-to-escape-sandbox"
)
"""Content security policy of a report, which has its own scripts: a separate origin without our
rights."""

_HEADERS = {
    "x-content-type-options": "nosniff",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
}

_MOST_ROWS = 500
"""Maximum number of lines of a corrected program shown beside the old ones."""

_OF_ROBOT = ("joints.columns",)
"""Tables of campaign.toml that depend on the robot: its joints name the columns."""

_MOST_TYPED = 2**20
"""Maximum size of a request that is not a file [B]."""


class _Door:
    """An application behind a token, passed in the first address and then kept in a cookie.

    Requests with other host names (DNS rebinding), other origins or without the token are rejected.
    """

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        """Guard an application that answers at a port of this machine."""
        self._app, self._token = app, token
        self._cookie = f"page{port}"
        self._hosts = {f"{HERE}:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer the request, or reject it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        request = Request(scope)
        if why := self._refused(request):
            await PlainTextResponse(f"{why}\n", 403)(scope, receive, send)
        elif request.url.path == "/enter" and self._is(request.query_params.get("token", "")):
            way_in = RedirectResponse("/", 303)
            way_in.set_cookie(self._cookie, self._token, httponly=True, samesite="lax", path="/")
            # lax: links of a report come from its own separate origin; requests that change
            # anything are accepted from our own origin only
            await way_in(scope, receive, send)
        elif self._is(request.cookies.get(self._cookie, "")):
            await self._app(scope, receive, send)
        else:
            words = "open the address that `pipeline page` printed: its token is missing here"
            await PlainTextResponse(f"{words}\n", 403)(scope, receive, send)

    def _is(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    def _refused(self, request: Request) -> str:
        if request.headers.getlist("host") not in [[one] for one in self._hosts]:
            return "this server answers to 127.0.0.1 and localhost only"
        own = {f"http://{one}" for one in self._hosts}
        if any(one not in own for one in request.headers.getlist("origin")):
            return "this server answers to its own pages only"
        return ""


@dataclass
class _State:
    """State of the pages apart from the files.

    Attributes:
        root: Root of the project.
        runs: Campaigns being computed.
        checked: Digest of the files and output of `_check` for them, by campaign.
        looked: Output of `inspect`, by file and digest.
        stands: By campaign, a mark of files and report, and whether the report is up to date.
        busy: Limits the number of commands that run at the same time.
    """

    root: Path
    runs: Runs = field(default_factory=Runs)
    checked: dict[str, tuple[str, CommandOutput]] = field(default_factory=dict)
    looked: dict[str, CommandOutput] = field(default_factory=dict)
    stands: dict[str, tuple[str, bool]] = field(default_factory=dict)
    busy: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))

    def desk(self, request: Request) -> Desk:
        """The campaign named in an address.

        Raises:
            UsageError: There is no such campaign.
        """
        desk = Desk(self.root, named(request.path_params["name"], "campaign"))
        if not desk.folder.is_dir():
            raise UsageError(f"there is no campaign {desk.name}: it may have been removed")
        return desk

    def passed(self, desk: Desk) -> bool:
        """Whether `_check` accepted the campaign with its present files."""
        digest, output = self.checked.get(desk.name, ("", None))
        return output is not None and output.runs_next and digest == desk.digest()

    async def asked(self, *desks: Desk) -> None:
        """Ask `status` which reports are up to date, if anything has changed."""
        marks = {desk.name: await asyncio.to_thread(_mark, desk) for desk in desks}
        if all(self.stands.get(name, ("",))[0] == mark for name, mark in marks.items()):
            return
        output = await self.look("status", "--root", self.root, "--json")
        done = {one.get("campaign") for one in output.records if one.get("state") == "done"}
        self.stands |= {name: (mark, name in done) for name, mark in marks.items()}

    def done(self, desk: Desk) -> bool:
        """Whether the report is up to date with the files."""
        return self.stands.get(desk.name, ("", False))[1]

    def reached(self, desk: Desk) -> dict[str, str]:
        """What each stage waits for; empty if it is done."""
        text, run, done = desk.text(), self.runs.of.get(desk.name), self.done(desk)
        setup, passed = _left(text) if text else "files", self.passed(desk)
        return {
            "files": "" if text else "go on below" if desk.names() else "drop what was measured",
            "setup": setup,
            "check": "" if passed else "setup" if setup else "check",
            "run": "running" if run and run.said is None else "" if done else _ARMED[passed],
            "answer": "" if done else "run",
        }

    def answer(self, desk: Desk) -> Answer | None:
        """Content of result.json; None if there is none.

        Raises:
            UsageError: It is of an earlier version, or damaged.
        """
        from pipeline.answer import archive

        found = (desk.reports / "result.json").is_file()
        return archive.read(CampaignFolder(self.root, desk.folder)) if found else None

    async def look(self, *words: str | Path) -> CommandOutput:
        """Output of a command that only reads; two run at a time."""
        async with self.busy:
            return await command(*words)


def _stiffness(value: float, unit: str) -> str:
    """`3.80 MN·m/rad`."""
    factor, letter = common_prefix([value])
    return f"{plain(value / factor, 4)} {prefixed(unit, letter)}"


_PAGES = jinja2.Environment(
    loader=jinja2.PackageLoader("pipeline.page"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=jinja2.StrictUndefined,
)
_PAGES.filters["path"] = lambda text: quote(str(text), safe="")
_PAGES.filters["shown"] = lambda text: printable(str(text), 400)
_PAGES.filters["whole"] = lambda text: printable(str(text), 4000)  # sentences of ours
_ARMED = {False: "check", True: "run"}
"""What Run waits for, by whether the check has passed."""
_PAGES.filters["stiffness"] = _stiffness

_Handler = Callable[[_State, Request], Awaitable[Response]]


def _mark(desk: Desk) -> str:
    """Mark that changes with the files or the report."""
    report = desk.reports / "result.json"
    when = report.stat().st_mtime_ns if report.is_file() else 0
    return f"{desk.digest()} {when}"


async def _page(
    request: Request, state: _State, template: str, desk: Desk | None, **more: Any
) -> Response:
    if desk is not None:
        await state.asked(desk)
    reached = state.reached(desk) if desk else {}
    body = _PAGES.get_template(f"{template}.html.jinja").render(
        stages=_STAGES, here=template, reached=reached, campaign=desk.name if desk else "", **more
    )
    return HTMLResponse(body, headers={**_HEADERS, "content-security-policy": _POLICY})


async def _home(state: _State, request: Request) -> Response:
    """Page of all campaigns, with a form for a new one."""
    found = [Desk(state.root, name) for name in campaigns(state.root)]
    await state.asked(*found)
    rows = []
    for one in found:
        try:
            rows.append((one.name, state.reached(one)))
        except UsageError as problem:  # of one campaign, and no other
            rows.append((one.name, dict.fromkeys(_STAGES, str(problem))))
    return await _page(request, state, "home", None, rows=rows)


async def _files_page(state: _State, request: Request) -> Response:
    """Page of the files of a campaign, with the format detected for each."""
    desk = state.desk(request)
    names = [name for name in desk.names() if name != TOML]
    return await _page(request, state, "files", desk, names=names, has_toml=desk.text() is not None)


async def _look_page(state: _State, request: Request) -> Response:
    """The detected format of one file."""
    desk = state.desk(request)
    name = request.path_params["file"]
    described = await _looked(state, desk, desk.file(name))
    body = _PAGES.get_template("_file.html.jinja").render(
        campaign=desk.name, name=name, said=described, seen=desk.digest(TOML)
    )
    return HTMLResponse(body, headers=_HEADERS)


async def _looked(state: _State, desk: Desk, path: Path) -> dict[str, Any]:
    """What `inspect` says of a file."""
    if path.suffix == ".toml":
        return {"dialect": "robot file"}
    key = f"{path}:{desk.digest(path.relative_to(desk.folder).as_posix(), TOML)}"
    if key not in state.looked:
        state.looked[key] = await state.look("inspect", "--json", "--", path)
    found = state.looked[key]
    return dict(found.content) or {"error": {"message": " ".join(found.words[-1:])}}


async def _columns(state: _State, request: Request) -> Response:
    """Write what each column of a table is; names that it shows get their entries."""
    desk, typed = state.desk(request), await _typed(request)
    described = await _looked(state, desk, desk.file(request.path_params["file"]))
    chosen = _chosen([str(one["title"]) for one in described.get("columns", ())], typed)
    new = desk.text() or (await _proposed(state, desk, ""))[0] or ""
    text = entries.with_columns(new, chosen)
    again, words = await _proposed(state, desk, text)
    if again is None:
        return _reply(words or "these columns cannot be read")
    desk.written(entries.carried_over(text, again), str(typed.get("seen", "")))
    return _reply()


def _chosen(titles: Sequence[str], typed: Mapping[str, object]) -> dict[str, str | int]:
    """Column of each role that was chosen, by its title, or its number if another has the same."""
    chosen: dict[str, str | int] = {}
    for number, title in enumerate(titles, 1):
        role = str(typed.get(str(number), ""))
        if role in chosen:
            raise UsageError(f'columns {chosen[role]} and {title or number} are both "{role}"')
        if role:
            chosen[role] = title if title and titles.count(title) == 1 else number
    return chosen


async def _put(state: _State, request: Request) -> Response:
    """Store a dropped file."""
    desk = state.desk(request)
    data = await _body(request, MOST_BYTES)
    instead = request.query_params.get("instead") == "1"
    new = await asyncio.to_thread(desk.taken, request.path_params["file"], data, instead)
    return _reply("" if new else "this file was there already", new=new)


async def _remove(state: _State, request: Request) -> Response:
    """Delete a file."""
    state.desk(request).removed(request.path_params["file"])
    return _reply()


async def _create(state: _State, request: Request) -> Response:
    """Create a campaign."""
    typed = await _typed(request)
    desk = Desk(state.root, named(str(typed.get("name", "")).strip(), "campaign"))
    desk.begun()
    return _reply(go=f"/c/{quote(desk.name, safe='')}/files")


async def _set_up(state: _State, request: Request) -> Response:
    """Have campaign.toml written for the files; entries of an old one are kept."""
    desk = state.desk(request)
    old, seen = desk.text(), desk.digest(TOML)
    new, words = await _proposed(state, desk, old or "")
    if new is None:
        return _reply(words or "campaign.toml could not be written")
    desk.written(new if old is None else entries.carried_over(old, new), seen)
    return _reply(go=f"/c/{quote(desk.name, safe='')}/setup")


async def _proposed(state: _State, desk: Desk, text: str) -> tuple[str | None, str]:
    """campaign.toml as `init` writes it for the files and what a text states of robot and exports.

    Returns:
        It, None if there is none, and the last line of the messages.
    """
    with tempfile.TemporaryDirectory(dir=state.root) as folder:
        beside = Desk(Path(folder), desk.name)
        await asyncio.to_thread(desk.copied, beside)
        stated = Path(folder) / TOML
        files.write(stated, text.encode())
        robot = str(_stated(text).get("robot", ""))
        chosen = [f"--stated={stated}", *([f"--robot={robot}"] if robot else [])]
        output = await state.look("init", "--root", beside.root, *chosen, "--", desk.name)
        return beside.text(), " ".join(output.words[-1:])


def _stated(text: str) -> dict[str, Any]:
    """Content of a campaign.toml; empty if it cannot be read."""
    with contextlib.suppress(InputError):
        return toml.loads(text, TOML)
    return {}


async def _setup_page(state: _State, request: Request) -> Response:
    """Page of campaign.toml as fields, with the cell as entered."""
    desk = state.desk(request)
    text = desk.text()
    if text is None:
        return RedirectResponse(f"/c/{quote(desk.name, safe='')}/files", 303)
    found = entries.entries(text)
    tables: dict[str, list[entries.FormEntry]] = {}
    for one in found:
        tables.setdefault(one.table, []).append(one)
    robots = [(name, load(name, desk.folder).description) for name in SHIPPED]
    robots += [
        (one, "in this campaign") for one in desk.names() if one.endswith(".toml") and one != TOML
    ]
    return await _page(
        request, state, "setup", desk,
        tables=tables, text=text, seen=desk.digest(TOML), robots=robots,
        names=[one for one in desk.names() if not one.endswith(".toml")],
        picture=await asyncio.to_thread(_picture, desk, text),
        fields=sum(one.needed for one in found),
        missing=[one for one in found if one.needed],
    )  # fmt: skip


def _picture(desk: Desk, text: str) -> str:
    """The cell as far as campaign.toml states it."""
    with contextlib.suppress(ValueError, TypeError, KeyError):  # not stated yet: not drawn
        stated = _stated(text)
        points = {
            table: {
                name: at
                for name, at in stated.get(table, {}).items()
                if isinstance(at, list) and len(at) == 3
                and all(isinstance(one, int | float) and abs(one) < 1e4 for one in at)
            }
            for table in ("tool", "base_frame")
        }  # fmt: skip
        return drawing.cell(
            str(stated["robot"]), desk.folder, None, points["tool"], points["base_frame"]
        )
    return ""


async def _fill(state: _State, request: Request) -> Response:
    """Change one line of campaign.toml."""
    desk, typed = state.desk(request), await _typed(request)
    text = desk.text() or ""
    line, stated = int(str(typed.get("line", 0))), typed.get("said", "")
    one = next((each for each in entries.entries(text) if each.line == line), None)
    if typed.get("confirm"):
        new = await _asked_anew(state, desk, entries.confirmed(text, line), one)
        desk.written(new, str(typed.get("seen", "")))
        return _reply(seen=desk.digest(TOML))
    if isinstance(stated, list):
        value = entries.point([str(part) for part in stated], str(typed.get("unit", "m")))
    else:
        value = entries.value(str(stated), one.words if one else (), one.key if one else "")
    filled = entries.filled(text, line, value)
    new = await _asked_anew(state, desk, filled, one)
    desk.written(new, str(typed.get("seen", "")))
    return _reply(seen=desk.digest(TOML), reload=new != filled or (one and one.key == "robot"))


async def _asked_anew(state: _State, desk: Desk, text: str, one: entries.FormEntry | None) -> str:
    """A text, with what depends on an entry that was changed in it.

    The robot names the columns of the joint log. An answer on how exports are read may show names
    of groups and targets, which have entries of their own.
    """
    if one is None or not one.decides:
        return text
    new = (await _proposed(state, desk, text))[0] or text
    if not one.table:
        for table in _OF_ROBOT:
            text = entries.with_table(text, new, table)
        return text
    asked = [{(each.table, each.key) for each in entries.entries(some)} for some in (text, new)]
    return text if asked[1] <= asked[0] else entries.carried_over(text, new)


async def _rewrite(state: _State, request: Request) -> Response:
    """Replace the whole campaign.toml."""
    desk, typed = state.desk(request), await _typed(request)
    desk.written(entries.sound(str(typed.get("text", ""))), str(typed.get("seen", "")))
    return _reply(seen=desk.digest(TOML))


async def _check_page(state: _State, request: Request) -> Response:
    """Page of the output of `_check`, with the lines of campaign.toml concerned."""
    desk = state.desk(request)
    digest, output = state.checked.get(desk.name, ("", None))
    lines = (desk.text() or "").splitlines()
    return await _page(
        request, state, "check", desk,
        said=output, current=digest == desk.digest(), lines=lines, passed=state.passed(desk),
    )  # fmt: skip


async def _check(state: _State, request: Request) -> Response:
    """Check the campaign with its present files."""
    desk = state.desk(request)
    digest = await asyncio.to_thread(desk.digest)
    state.checked[desk.name] = (
        digest,
        await state.look("check", "--root", state.root, "--json", "--", desk.name),
    )
    return _reply(go=f"/c/{quote(desk.name, safe='')}/check")


async def _run_page(state: _State, request: Request) -> Response:
    """Page to run the campaign, with progress and cancellation."""
    desk = state.desk(request)
    return await _page(
        request, state, "run", desk, run=state.runs.of.get(desk.name), passed=state.passed(desk)
    )


async def _run(state: _State, request: Request) -> Response:
    """Compute the campaign, if `_check` accepted it with its present files."""
    desk = state.desk(request)
    if not await asyncio.to_thread(state.passed, desk):
        raise UsageError("the files have changed since they were checked, or were not: check first")
    await state.runs.begin(state.root, desk.name)
    return _reply()


async def _cancel(state: _State, request: Request) -> Response:
    """Cancel the run."""
    state.runs.cancel(state.desk(request).name)
    return _reply()


async def _progress(state: _State, request: Request) -> Response:
    """Progress of a run."""
    desk = state.desk(request)
    one = state.runs.of.get(desk.name)
    if one is None:
        return JSONResponse({"state": "none"}, headers=_HEADERS)
    began = time.time() - one.seconds
    at = stage(state.root / "data" / "processed" / desk.name, began) if one.said is None else ""
    words = list(one.said.words[-8:]) if one.said else []
    end = "cancelled" if one.cancelled else "done" if one.said and one.said.accepted else "failed"
    return JSONResponse(
        {"state": end if one.said else "running", "seconds": round(one.seconds, 1), "at": at,
         "words": words},
        headers=_HEADERS,
    )  # fmt: skip


async def _live_page(state: _State, request: Request) -> Response:
    """Page of the campaign while it is measured."""
    desk = state.desk(request)
    live = state.runs.live.get(desk.name)
    running = live is not None and live.running
    return await _page(request, state, "live", desk, running=running, shown=_live(desk, live))


async def _live_now(state: _State, request: Request) -> Response:
    """The latest update, the number of updates, and the number of suspected readings."""
    desk = state.desk(request)
    live = state.runs.live.get(desk.name)
    told = live.updates if live else []
    suspects = len(told[-1].get("suspects", [])) if told else 0
    return _reply(
        html=_live(desk, live), told=len(told), suspects=suspects,
        running=live is not None and live.running,
    )  # fmt: skip


def _live(desk: Desk, live: LiveJob | None) -> str:
    last = live.updates[-1] if live and live.updates else None
    return _PAGES.get_template("_live.html.jinja").render(
        campaign=desk.name, last=last, words=live.words if live else None,
        curves=drawing.curves(live.updates) if live else "",
    )  # fmt: skip


async def _look_on(state: _State, request: Request) -> Response:
    """Start live judgement of the campaign."""
    await state.runs.look_on(state.root, state.desk(request).name)
    return _reply()


async def _look_away(state: _State, request: Request) -> Response:
    """Stop live judgement."""
    state.runs.look_away(state.desk(request).name)
    return _reply()


async def _answer_page(state: _State, request: Request) -> Response:
    """Page with the first sentences, the report, downloads, and a form to correct a program."""
    desk = state.desk(request)
    await state.asked(desk)
    found = state.answer(desk)
    reports = desk.reports
    names = sorted(
        one.relative_to(reports).as_posix()
        for one in (reports.rglob("*") if reports.is_dir() else ())
        if one.is_file() and "figures" not in one.parts and not one.name.startswith(".")
    )
    stale = found is not None and not state.done(desk)
    return await _page(
        request, state, "answer", desk,
        found=found, facts=_facts(found), names=_by_use(names), stale=stale,
    )  # fmt: skip


def _facts(found: Answer | None) -> list[tuple[str, str]]:
    """The first sentences of an answer and what each is about; stiffnesses are a table."""
    from pipeline.answer.words import ABOUT

    labels = {about.value: label for about, label in ABOUT.items() if about is not About.NUMBERS}
    lines = found.first_screen if found else ()
    return [(labels[one.about], one.text) for one in lines if one.about in labels]


def _by_use(names: Sequence[str]) -> dict[str, list[str]]:
    """Files of a report by what people do with them."""
    out: dict[str, list[str]] = {use: [] for use in (*_USES.values(), "Other")}
    for name in names:
        use = _USES.get(Path(name).suffix, "Other") if "/" not in name else "Tables"
        out[use].append(name)
    return {use: some for use, some in out.items() if some}


_USES = {
    ".html": "To read", ".pdf": "To read", ".xlsx": "Tables", ".json": "Complete answer",
    **dict.fromkeys((".toml", ".urdf", ".sdf", ".xml"), "Model of the robot"),
}  # fmt: skip


async def _report(state: _State, request: Request) -> Response:
    """A file of the report."""
    desk = state.desk(request)
    top = desk.reports.resolve()
    path = Path(os.path.realpath(top / request.path_params["path"]))  # a circle is no error
    if not path.is_relative_to(top) or not path.is_file():
        raise UsageError("there is no such file in the report")
    return FileResponse(path, headers={**_HEADERS, "content-security-policy": _OF_REPORTS})


async def _correct(state: _State, request: Request) -> Response:
    """Correct a dropped program; return the lines that differ, and what was not corrected.

    Its content may be followed by that of `beside`, the companion file that is read with it: the
    .dat of a .src.
    """
    desk = state.desk(request)
    name, other = named(request.path_params["file"]), request.query_params.get("beside", "")
    data = await _body(request, 8 * 2**20)
    first = request.query_params.get("first", "")
    size = int(first) if re.fullmatch("[0-9]{1,9}", first) else len(data)
    data, rest = data[:size], data[size:]
    options = _options(request)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        if other and named(other) != name:
            path.with_name(other).write_bytes(rest)
        output = await state.look(
            "compensate", "--root", state.root, *options, "--", desk.name, path
        )
    if output.code:
        return _reply("\n".join(output.words[-12:]) or f"it ended with {output.code}")
    old, new = (one.decode("utf-8", "replace").splitlines() for one in (data, output.output))
    rows = [*_side_by_side(old, new)]
    text = output.output.decode("latin-1")
    more = [f"{len(rows) - _MOST_ROWS} more lines differ"] if len(rows) > _MOST_ROWS else []
    return _reply(rows=rows[:_MOST_ROWS], corrected=text, words=[*output.words, *more])


def _options(request: Request) -> list[str]:
    """Options of `compensate` as typed into the page."""
    asked = ("force", "tool", "base", "world", "flange", "start")
    typed = {key: request.query_params.get(key, "").strip() for key in asked}
    partial = ["--partial"] * (request.query_params.get("partial") == "1")
    return [*(f"--{key}={value}" for key, value in typed.items() if value), *partial]


def _side_by_side(old: list[str], new: list[str]) -> Iterator[dict[str, Any]]:
    """Lines that differ, with their number in the old program; an inserted line has no old text.

    A correction changes lines and inserts some at one place: the one for which the fewest other
    lines differ.
    """
    more = max(len(new) - len(old), 0)
    before = accumulate(map(_unlike, old, new), initial=0)  # differences before an insertion
    behind = [*accumulate(map(_unlike, reversed(old), reversed(new)), initial=0)][::-1]
    at = min(enumerate(map(add, before, behind)), key=itemgetter(1))[0] if more else len(old)
    apart = [*old[:at], *[""] * more, *old[at:]]
    for k, (one, other) in enumerate(zip_longest(apart, new, fillvalue="")):
        if one != other:
            yield {"line": min(k, max(k - more, at)) + 1, "old": one, "new": other}


def _unlike(old: str, new: str) -> int:
    """Degree to which two lines differ; a motion with new coordinates keeps its first word."""
    return (old != new) + (old.split(None, 1)[:1] != new.split(None, 1)[:1])


async def _body(request: Request, most: int) -> bytes:
    """Body of a request, limited in size.

    Raises:
        UsageError: It is larger.
    """
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > most:
            raise UsageError(f"more than {most // 2**20} MB are not taken here: split the file")
        parts.append(part)
    return b"".join(parts)


async def _typed(request: Request) -> dict[str, Any]:
    import json

    try:
        found = json.loads(await _body(request, _MOST_TYPED))
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise UsageError("what the page sent cannot be read: load it again")
    return found


def _reply(problem: str = "", **more: Any) -> Response:
    return JSONResponse(
        {"problem": problem, **more}, 400 if problem and not more else 200, _HEADERS
    )


_ROUTES: tuple[tuple[str, str, _Handler], ...] = (
    ("GET", "/", _home),
    ("POST", "/campaigns", _create),
    ("GET", "/c/{name}/files", _files_page),
    ("GET", "/c/{name}/look/{file:path}", _look_page),
    ("PUT", "/c/{name}/file/{file}", _put),
    ("DELETE", "/c/{name}/file/{file:path}", _remove),
    ("POST", "/c/{name}/columns/{file:path}", _columns),
    ("POST", "/c/{name}/init", _set_up),
    ("GET", "/c/{name}/setup", _setup_page),
    ("POST", "/c/{name}/fill", _fill),
    ("POST", "/c/{name}/text", _rewrite),
    ("GET", "/c/{name}/check", _check_page),
    ("POST", "/c/{name}/check", _check),
    ("GET", "/c/{name}/run", _run_page),
    ("POST", "/c/{name}/run", _run),
    ("POST", "/c/{name}/cancel", _cancel),
    ("GET", "/c/{name}/progress", _progress),
    ("GET", "/c/{name}/live", _live_page),
    ("GET", "/c/{name}/live/now", _live_now),
    ("POST", "/c/{name}/live", _look_on),
    ("POST", "/c/{name}/live/stop", _look_away),
    ("GET", "/c/{name}/answer", _answer_page),
    ("GET", "/c/{name}/report/{path:path}", _report),
    ("POST", "/c/{name}/correct/{file}", _correct),
)


def _answering(state: _State, handler: _Handler) -> Callable[[Request], Awaitable[Response]]:
    """A handler that turns errors into sentences."""

    async def answered(request: Request) -> Response:
        try:
            return await handler(state, request)
        except (UsageError, InputError, CannotWrite) as problem:
            return await _said(state, request, str(problem))
        except TimeoutError:
            return await _said(
                state, request, "this took more than two minutes: use the command instead"
            )
        except (OSError, ValueError) as problem:
            return await _said(state, request, f"this did not work: {printable(str(problem), 200)}")
        except Exception as problem:  # last resort: the terminal shows the traceback
            sys.stderr.write("".join(traceback.format_exception(problem)))
            kind = type(problem).__name__
            return await _said(
                state, request, f"internal error ({kind}): please report what the terminal says"
            )

    return answered


async def _said(state: _State, request: Request, problem: str) -> Response:
    if request.method == "GET" and "text/html" in request.headers.get("accept", ""):
        answer = await _page(request, state, "problem", None, problem=problem)
        answer.status_code = 400
        return answer
    return _reply(problem)


def application(root: Path, port: int, token: str) -> ASGIApp:
    """The pages of a project at a port of this machine, for holders of the token."""
    state = _State(root)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        await state.runs.close()

    routes: list[Route | Mount] = [
        Route(path, _answering(state, handler), methods=[method])
        for method, path, handler in _ROUTES
    ]
    looks = Path(__file__).with_name("looks")
    routes.append(Mount("/looks", StaticFiles(directory=looks)))
    return Starlette(
        routes=routes, lifespan=lifespan, middleware=[Middleware(_Door, port=port, token=token)]
    )


def serve(root: Path, port: int, say: Callable[[str], object], opened: bool) -> None:
    """Serve until Ctrl-C."""
    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            free.bind((HERE, port))
        except OSError as problem:
            why = problem.strerror
            raise UsageError(f"port {port} cannot be taken ({why}): name another, --port") from None
    token = secrets.token_urlsafe(24)
    address = f"http://{HERE}:{port}/enter?token={token}"
    config = uvicorn.Config(
        application(root.resolve(), port, token),
        host=HERE,
        port=port,
        log_level="error",
        server_header=False,
        timeout_graceful_shutdown=3,
    )
    say(f"{address}\nOpen it in a browser on this machine; Ctrl-C stops.")
    if opened:
        import webbrowser

        webbrowser.open(address)
    uvicorn.Server(config).run()


def _left(text: str) -> str:
    """Number of open questions in a campaign.toml, in words; empty if there are none."""
    left = sum(one.needed for one in entries.entries(text))
    return f"{left} open" if left else ""
