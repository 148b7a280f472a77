"""The server of `mrs view`: the page's files, and a WebSocket for each viewer."""

from __future__ import annotations

import asyncio
import errno
import hmac
import ipaddress
import logging
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import quote, urlsplit

from aiohttp import WSCloseCode, WSMsgType, web

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.view.places import Once, Places
from mrs_tools.view.protocol import (
    MAX_COMMAND_BYTES,
    Answer,
    CancelTour,
    CommandError,
    Control,
    Look,
    ReleaseRobots,
    StartTour,
    StopRobots,
    encode,
    read_command,
)
from mrs_tools.view.source import Source
from mrs_tools.view.viewers import Encoded, Viewer, Viewers

#: The page.
PAGE: Final = Path(__file__).parent / "page"
#: More viewers are turned away.
MAX_VIEWERS: Final = 32
#: A viewer that does not answer a ping within half of this is closed [s].
_HEARTBEAT_S = 15.0
#: Viewers get this long to be told that the server ends [s].
_END_S = 1.0
#: Who logs what strangers do; each kind of it is logged once.
_LOGGERS = ("aiohttp.server", "asyncio")
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".json": "application/json",
    ".webmanifest": "application/manifest+json",
}
#: Nothing from elsewhere, nothing inline; and the token in the address goes nowhere else.
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True)
class Address:
    """Where the page is served, and to whom.

    Attributes:
        host: Address or name of this machine to listen on.
        port: TCP port; 0: any that is free.
        token: What the page's address must contain; empty: it is not asked for.
    """

    host: str
    port: int
    token: str = ""

    @classmethod
    def of(cls, host: str, port: int, token: str) -> Address:
        """An address, with a token of its own where other machines could reach it without."""
        if not token and not is_loopback(host):
            token = secrets.token_urlsafe(16)
        return cls(host, port, token)

    def url(self) -> str:
        """What to open in a browser."""
        everywhere = self.host in ("0.0.0.0", "::")
        host = _own_address(self.host) if everywhere else self.host
        shown = f"[{host}]" if ":" in host else host
        query = f"?token={quote(self.token, safe='')}" if self.token else ""
        return f"http://{shown}:{self.port}/{query}"


def _own_address(host: str) -> str:
    """This machine's address on the network by which it reaches others; its name if there is none.

    Args:
        host: 0.0.0.0 or ::, for the version of IP.
    """
    # Addresses of documentation: nobody has them, and a datagram socket sends nothing to connect.
    v4, v6 = (socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1")
    family, other = v6 if ":" in host else v4
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((other, 9))
            return str(probe.getsockname()[0])
    except OSError:
        return socket.gethostname()


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches what listens on this host."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


async def serve(
    source: Source,
    address: Address,
    *,
    rate: float,
    stop: threading.Event,
    ready: Callable[[str], None],
    page: Path = PAGE,
) -> None:
    """Serves the page until `stop` is set.

    Args:
        source: What is shown; it is started here, and closed.
        address: Where to serve it, and to whom.
        rate: Messages of one kind are sent at most so often [Hz].
        stop: Ends it.
        ready: Takes the page's URL once it can be opened.
        page: Folder of the page's files.

    Raises:
        PeopleLocError: The address cannot be used.
    """
    server = _Server(source, address, rate, page)
    runner = web.AppRunner(server.app, access_log=None, shutdown_timeout=_END_S)
    await runner.setup()
    try:
        port = await _listen(runner, address)
        assert runner.server is not None
        watching = asyncio.create_task(server.places.watch(runner.server))
        once = Once()
        for name in _LOGGERS:
            logging.getLogger(name).addFilter(once)
        try:
            source.start(server.viewers.publish)
            ready(Address(address.host, port, address.token).url())
            while not stop.is_set():
                await asyncio.sleep(0.1)
        finally:
            watching.cancel()
            for name in _LOGGERS:
                logging.getLogger(name).removeFilter(once)
            await asyncio.to_thread(source.close)
    finally:
        await runner.cleanup()


async def _listen(runner: web.AppRunner, address: Address) -> int:
    """Begins to listen; returns the port.

    Raises:
        PeopleLocError: It is not possible.
    """
    site = web.TCPSite(runner, address.host, address.port)
    try:
        await site.start()
    except OSError as err:
        where = f"port {address.port} of {address.host}"
        if err.errno == errno.EADDRINUSE:
            raise PeopleLocError(
                f"{where} is in use (by another `mrs view`?); end what uses it, or take another: "
                f"--port {address.port + 1}"
            ) from err
        # asyncio gives no errno where it could bind to none of a name's addresses.
        if isinstance(err, socket.gaierror) or err.errno in (None, errno.EADDRNOTAVAIL):
            raise PeopleLocError(
                f"--host {address.host} is no address or name of this machine; allowed: 127.0.0.1 "
                "(this machine only), 0.0.0.0 (all its networks), or one address of its own"
            ) from err
        raise PeopleLocError(f"{where} cannot be used: {err.strerror or err}") from err
    return int(runner.addresses[0][1])


class _Server:
    """The web application.

    Attributes:
        app: It.
        viewers: Whom it serves.
        places: Its connections.
    """

    def __init__(self, source: Source, address: Address, rate: float, page: Path) -> None:
        self.viewers, self.places = Viewers(rate, source.look), Places()
        self._source, self._address, self._page = source, address, page
        self._sockets: set[web.WebSocketResponse] = set()
        self.app = web.Application(middlewares=[self._guard], client_max_size=MAX_COMMAND_BYTES)
        self.app.router.add_get("/live", self._live)
        self.app.router.add_get("/", self._file)
        self.app.router.add_get("/{name}", self._file)
        self.app.on_shutdown.append(self._say_goodbye)

    # ---- who may look ----

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Turns strangers away, and adds the headers that keep the page to itself."""
        refusal = self._refusal(request)
        if refusal:
            refused = web.Response(status=403, text=refusal, headers=_HEADERS)
            refused.force_close()
            return refused
        self.places.busy.add(request.protocol)
        try:
            response = await handler(request)
        except web.HTTPException as err:
            err.headers.update(_HEADERS)
            raise
        finally:
            self.places.busy.discard(request.protocol)
        if not response.prepared:
            response.headers.update(_HEADERS)
            if self._address.token:
                response.set_cookie(
                    self._cookie(), self._address.token, httponly=True, samesite="Strict"
                )
        return response

    def _refusal(self, request: web.Request) -> str:
        """Why a request is turned away; empty: it is not."""
        host, token = _host_of(f"//{request.host}"), self._address.token
        if not token and not is_loopback(host):
            return (  # a page of somebody else's whose name leads here (DNS rebinding)
                f"Host is {request.host[:100]!r}; allowed: localhost, 127.0.0.1. For other names "
                "start mrs view with --token"
            )
        origin = request.headers.get("Origin")
        if origin is not None and origin.partition("://")[2] != request.host:
            return "the request comes from a page of another site"
        given = request.query.get("token") or request.cookies.get(self._cookie(), "")
        # A cookie may be no text.
        given_bytes = given.encode(errors="surrogateescape")
        if token and not hmac.compare_digest(given_bytes, token.encode()):
            return "the address lacks the right ?token=; mrs view has printed it at its start"
        return ""

    def _cookie(self) -> str:
        return f"mrs_view_{self._address.port}"  # cookies are the same for all ports

    # ---- files ----

    async def _file(self, request: web.Request) -> web.Response:
        """A file of the page, which has no folders."""
        name = request.match_info.get("name", "index.html")
        files = {path.name: path for path in self._page.iterdir() if path.is_file()}
        path = files.get(name)
        if path is None or path.suffix not in _TYPES:
            raise web.HTTPNotFound(text="there is no such file")
        kind = _TYPES[path.suffix]
        charset = "utf-8" if kind.startswith("text/") else None
        return web.Response(body=path.read_bytes(), content_type=kind, charset=charset)

    # ---- viewers ----

    async def _live(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(
            heartbeat=_HEARTBEAT_S,
            max_msg_size=MAX_COMMAND_BYTES,
            timeout=_END_S,
            compress=False,  # it would be done for each viewer again
        )
        await socket.prepare(request)
        if len(self.viewers) >= MAX_VIEWERS:
            text = f"{MAX_VIEWERS} viewers look already, and more are not served"
            await socket.send_str(encode(_answer(False, text)))
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=text.encode())
            return socket
        viewer = Viewer(socket)
        viewer.offer(("hello", ""), Encoded(self._source.hello()))
        self.viewers.add(viewer)
        self._sockets.add(socket)
        sending = asyncio.create_task(self._send(viewer, request))
        try:
            await self._listen_to(viewer, socket)
        finally:
            self._sockets.discard(socket)
            self.viewers.remove(viewer)
            sending.cancel()
            with suppress(asyncio.CancelledError):
                await sending
        return socket

    async def _send(self, viewer: Viewer, request: web.Request) -> None:
        """Sends to a viewer; one that takes nothing is cut off."""
        with suppress(ConnectionError, RuntimeError):  # it has gone
            try:
                await viewer.send()
            except (asyncio.TimeoutError, TimeoutError):
                if request.transport is not None:
                    request.transport.abort()

    async def _listen_to(self, viewer: Viewer, socket: web.WebSocketResponse) -> None:
        busy: asyncio.Task[None] | None = None
        async for message in socket:
            if message.type is not WSMsgType.TEXT:
                viewer.offer(("answer", ""), Encoded(_answer(False, "a command is a text of JSON")))
                continue
            try:
                command = read_command(message.data)
                if isinstance(command, Look):
                    self.viewers.look(viewer, command)
                    continue
                self._check(command)
                if isinstance(command, StopRobots):  # whatever else goes on
                    viewer.offer(("answer", ""), Encoded(self._done(command)))
                    continue
                if busy is not None and not busy.done():
                    raise CommandError("the last command is not done yet")
                busy = asyncio.create_task(self._control(viewer, command))
            except CommandError as err:
                viewer.offer(("answer", ""), Encoded(_answer(False, str(err))))

    def _check(self, command: Control) -> None:
        """Checks that viewers may do this here.

        Raises:
            CommandError: They may not.
        """
        hello = self._source.hello()
        if isinstance(command, StopRobots):
            if hello["mode"] != "live":
                raise CommandError("there are no robots to stop: this is a recording")
        elif isinstance(command, StartTour | CancelTour | ReleaseRobots):
            if not hello["control"]:
                raise CommandError(
                    "tours are not controlled from here: mrs view --control allows it"
                )
            if isinstance(command, StartTour) and command.name not in hello["tours"]:
                allowed = ", ".join(hello["tours"]) or "none; mrs view --tour FILE names some"
                raise CommandError(f"there is no tour {command.name!r}; allowed: {allowed}")
        elif hello["mode"] == "live":
            raise CommandError("a live team cannot be stopped or wound; only a bag can")

    async def _control(self, viewer: Viewer, command: Control) -> None:
        answer = await asyncio.to_thread(self._done, command)
        viewer.offer(("answer", ""), Encoded(answer))

    def _done(self, command: Control) -> Answer:
        """Does what a viewer asks for."""
        try:
            return _answer(True, self._source.control(command))
        except PeopleLocError as err:
            return _answer(False, str(err))

    async def _say_goodbye(self, _app: web.Application) -> None:
        for one in list(self._sockets):
            with suppress(asyncio.TimeoutError, TimeoutError, ConnectionError):
                await asyncio.wait_for(
                    one.close(code=WSCloseCode.GOING_AWAY, message=b"mrs view has ended"), _END_S
                )


def _host_of(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _answer(ok: bool, text: str) -> Answer:
    return Answer(type="answer", ok=ok, text=text)
