"""The server of `mrs view` over real connections: who may look, and nobody holds up another."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import threading
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

pytest.importorskip("aiohttp", reason="the server needs aiohttp")

import aiohttp

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.view import places, protocol, server, viewers
from mrs_tools.view.protocol import CommandError, Control, Hello, Look, Publish
from mrs_tools.view.server import Address, serve
from tools.view.serving import PATIENCE_S, served, until


class Source:
    """What a test publishes; remembers what it is asked for."""

    def __init__(self, control: bool = False) -> None:
        self.looks: list[Look] = []
        self.commands: list[Control] = []
        self.closed = False
        self.publish: Publish = lambda _: None
        self._control = control

    def hello(self) -> Hello:
        return Hello(
            type="hello", version=protocol.VERSION, mode="live", title="a test",
            control=self._control, bag=None, tours=["museum", "refused"],
        )  # fmt: skip

    def start(self, publish: Publish) -> None:
        self.publish = publish

    def look(self, wanted: Look) -> None:
        self.looks.append(wanted)

    def control(self, command: Control) -> str:
        self.commands.append(command)
        if command == protocol.StartTour("refused"):
            raise CommandError("nobody guides")
        return "it has begun"

    def close(self) -> None:
        self.closed = True


def run(test: Callable[[Any], Awaitable[None]]) -> None:
    """Runs a test with a session of a client that keeps no cookies."""

    async def with_session() -> None:
        async with aiohttp.ClientSession(cookie_jar=aiohttp.DummyCookieJar()) as session:
            await asyncio.wait_for(test(session), PATIENCE_S)

    asyncio.run(with_session())


def event(text: str) -> protocol.Event:
    return protocol.Event(type="event", t=0.0, text=text)


def state(t: float, text: str = "") -> protocol.State:
    # The name of a tour makes it as long as a test wants.
    tour: Any = {"name": text}
    return protocol.State(type="state", t=t, age=0.0, people=[], groups=[], robots=[], tour=tour)


def image(robot: str, t: float) -> protocol.Image:
    return protocol.Image(
        type="image", robot=robot, t=t, age=0.0, image="", disparity=None, note=""
    )


async def wait_for(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.01)


def test_viewer_that_comes_late_is_shown_what_there_is() -> None:
    source = Source()

    async def test(session: Any) -> None:
        async with session.ws_connect(f"{url}live") as first:
            source.publish(state(1.0))
            for number in range(60):
                source.publish(event(str(number)))
            await until(first, lambda m: m.get("text") == "59")
        async with session.ws_connect(f"{url}live") as late:
            got = await until(late, lambda m: m.get("text") == "59")
        assert got[0] == source.hello()
        assert [m["t"] for m in got if m["type"] == "state"] == [1.0]
        assert [m["text"] for m in got if m["type"] == "event"] == [str(n) for n in range(10, 60)]

    with served(source) as url:
        run(test)


def test_source_that_becomes_another_one_leaves_nothing_of_before() -> None:
    source = Source()

    async def test(session: Any) -> None:
        async with session.ws_connect(f"{url}live") as viewer:
            source.publish(state(1.0))
            source.publish(event("of before"))
            await until(viewer, lambda m: m.get("text") == "of before")
            source.publish(source.hello())
            source.publish(state(2.0))
            got = await until(viewer, lambda m: m["type"] == "state")
            assert [m["type"] for m in got] == ["hello", "state"]
            # To look at something else brings neither again.
            await viewer.send_json({"type": "look", "cells": True})
            source.publish(event("now"))
            (said,) = await until(viewer, lambda m: m["type"] == "event")
            assert said["text"] == "now"
        async with session.ws_connect(f"{url}live") as late:
            got = await until(late, lambda m: m["type"] == "event")
        assert [m["type"] for m in got] == ["hello", "state", "event"]
        assert (got[1]["t"], got[2]["text"]) == (2.0, "now")

    with served(source) as url:
        run(test)


def test_ten_viewers_get_a_message_that_is_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    source, encoded = Source(), []

    def encode(message: protocol.Message) -> str:
        encoded.append(message["type"])
        return protocol.encode(message)

    monkeypatch.setattr(viewers, "encode", encode)

    async def test(session: Any) -> None:
        sockets = [await session.ws_connect(f"{url}live") for _ in range(10)]
        for viewer in sockets:
            await until(viewer, lambda m: m["type"] == "hello")
        source.publish(state(2.0))
        for viewer in sockets:
            assert (await until(viewer, lambda m: m["type"] == "state"))[-1]["t"] == 2.0
        assert encoded.count("state") == 1
        for viewer in sockets:
            await viewer.close()

    with served(source) as url:
        run(test)


def test_states_that_come_too_fast_are_replaced_by_the_latest() -> None:
    source = Source()

    async def test(session: Any) -> None:
        async with session.ws_connect(f"{url}live") as viewer:
            await until(viewer, lambda m: m["type"] == "hello")
            for number in range(2000):
                source.publish(state(float(number)))
            got = [m["t"] for m in await until(viewer, lambda m: m["t"] == 1999.0)]
            assert len(got) < 100
            assert got == sorted(got)

    with served(source, rate=5.0) as url:
        run(test)


def test_viewer_that_reads_nothing_holds_up_nobody_and_is_cut_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(viewers, "SEND_S", 0.5)
    source = Source()

    async def test(session: Any) -> None:
        host, port = url.removeprefix("http://").rstrip("/").split(":")
        with socket.socket() as hung:
            hung.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            hung.connect((host, int(port)))
            hung.sendall(
                f"GET /live HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: Upgrade\r\n"
                "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
            )
            look = b'{"type":"look","robots":["robot_h"]}'
            hung.sendall(bytes([0x81, 0x80 | len(look), 0, 0, 0, 0]) + look)  # a mask of zeros
            await wait_for(lambda: Look(frozenset({"robot_h"})) in source.looks)
            async with session.ws_connect(f"{url}live", max_msg_size=0) as viewer:
                number = 0.0
                # Until what it lets wait is full, and it is cut off: nobody looks any more.
                while source.looks[-1] != Look():
                    number += 1.0
                    source.publish(state(number, "x" * 1_000_000))
                    got = await until(viewer, lambda m: m["type"] == "state")
                    assert got[-1]["t"] == number
                assert number > 1.0

    with served(source, rate=1000.0) as url:
        run(test)


def test_images_and_cells_are_for_those_who_look() -> None:
    source = Source()

    async def test(session: Any) -> None:
        async with (
            session.ws_connect(f"{url}live") as looks,
            session.ws_connect(f"{url}live") as other,
        ):
            await looks.send_str('{"type":"look","robots":["robot_a"],"cells":true}')
            await wait_for(lambda: source.looks == [Look(frozenset({"robot_a"}), True)])
            source.publish(image("robot_a", 1.0))
            source.publish(image("robot_b", 2.0))
            source.publish(protocol.Cells(type="cells", t=3.0, robots={}))
            source.publish(event("done"))

            def is_done(message: dict) -> bool:
                return message.get("text") == "done"

            shown = [m["type"] for m in await until(looks, is_done)]
            assert shown == ["hello", "image", "cells", "event"]
            assert [m["type"] for m in await until(other, is_done)] == ["hello", "event"]
            # The latest image that somebody looks at is there at once for another.
            await other.send_str('{"type":"look","robots":["robot_a"]}')
            assert (await until(other, lambda m: m["type"] == "image"))[-1]["t"] == 1.0
            await looks.close()
            await wait_for(lambda: source.looks[-1] == Look(frozenset({"robot_a"})))
            await other.close()
            await wait_for(lambda: source.looks[-1] == Look())

    with served(source) as url:
        run(test)


async def _answers(session: Any, url: str, commands: Sequence[str]) -> list[tuple[bool, str]]:
    answers = []
    async with session.ws_connect(f"{url}live") as viewer:
        for command in commands:
            await viewer.send_str(command)
            answer = (await until(viewer, lambda m: m["type"] == "answer"))[-1]
            answers.append((answer["ok"], answer["text"]))
    return answers


START = '{"type":"tour","start":"museum"}'


def test_tours_are_read_only_unless_control_is_allowed() -> None:
    source = Source()

    async def test(session: Any) -> None:
        commands = [START, '{"type":"tour","cancel":true}', '{"type":"pause"}', "what"]
        started, cancelled, paused, what = await _answers(session, url, commands)
        assert started == cancelled
        assert started == (
            False,
            "tours are not controlled from here: mrs view --control allows it",
        )
        assert paused[0] is False
        assert "only a bag" in paused[1]
        assert what == (False, "a command is no JSON")

    with served(source) as url:
        run(test)
    assert source.commands == []


def test_everybody_may_stop_the_robots_and_who_controls_releases_them() -> None:
    stop, release = '{"type":"stop"}', '{"type":"release"}'
    lookers, controls = Source(), Source(control=True)

    async def test(session: Any, url: str) -> None:
        answers.append(await _answers(session, url, [stop, release]))

    answers: list[list[tuple[bool, str]]] = []
    for source in (lookers, controls):
        with served(source) as url:
            run(partial(test, url=url))
    assert [ok for ok, _ in answers[0]] == [True, False]
    assert [ok for ok, _ in answers[1]] == [True, True]
    assert lookers.commands == [protocol.StopRobots()]
    assert controls.commands == [protocol.StopRobots(), protocol.ReleaseRobots()]


def test_cookie_that_is_no_text_is_refused() -> None:
    with served(Source(), token="secret") as url:
        host, port = url.split("/")[2].split(":")
        with socket.create_connection((host, int(port))) as stranger:
            cookie = f"mrs_view_{port}=".encode() + b"\xff\xfe"
            stranger.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nCookie: " + cookie + b"\r\n\r\n")
            assert stranger.recv(1000).startswith(b"HTTP/1.1 403 ")
            while stranger.recv(1000):  # and the connection is closed
                pass


def test_half_requests_keep_nobody_out_and_are_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "SILENT_S", 1.0)
    with served(Source(), token="secret") as url:
        host, port = url.split("/")[2].split(":")

        def half() -> socket.socket:
            made = socket.create_connection((host, int(port)), timeout=20.0)
            made.sendall(b"GET / HTTP/1.1\r\nHost")
            return made

        async def test(session: Any) -> None:
            async with session.ws_connect(f"{url.replace('?', 'live?')}") as viewer:
                await until(viewer, lambda m: m["type"] == "hello")
                for _ in range(5):
                    strangers.extend(half() for _ in range(60))
                    async with session.get(url) as page:
                        assert page.status == 200
                await asyncio.sleep(2.0)
                await viewer.send_str('{"type":"stop"}')
                await until(viewer, lambda m: m["type"] == "answer")

        strangers: list[socket.socket] = []
        try:
            run(test)
            for one in strangers:
                with suppress(ConnectionError):
                    assert one.recv(1) == b""
        finally:
            for one in strangers:
                one.close()


def test_each_kind_of_trouble_is_logged_once() -> None:
    once = places.Once()
    kinds = ["Error handling request from %s", "socket.accept()\nline 2", "socket.accept()\nline 3"]
    records = [logging.LogRecord("x", 40, "f", 1, kind, (), None) for kind in kinds * 2]
    assert [once.filter(record) for record in records] == [True, True, False, False, False, False]


def test_control_is_answered() -> None:
    source = Source(control=True)

    async def test(session: Any) -> None:
        commands = [START, START.replace("museum", "refused"), START.replace("museum", "zoo")]
        begun, refused, unknown = await _answers(session, url, commands)
        assert begun == (True, "it has begun")
        assert refused == (False, "nobody guides")
        assert unknown == (False, "there is no tour 'zoo'; allowed: museum, refused")

    with served(source) as url:
        run(test)
    assert [type(c) for c in source.commands] == [protocol.StartTour] * 2


def test_command_that_is_too_long_ends_only_its_own_connection() -> None:
    source = Source()

    async def test(session: Any) -> None:
        async with (
            session.ws_connect(f"{url}live") as floods,
            session.ws_connect(f"{url}live") as other,
        ):
            await floods.send_str("x" * (protocol.MAX_COMMAND_BYTES + 1))
            await floods.receive_str()  # hello
            assert (await floods.receive()).data == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
            source.publish(event("still here"))
            await until(other, lambda m: m["type"] == "event")

    with served(source) as url:
        run(test)


def test_too_many_viewers_are_turned_away_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "MAX_VIEWERS", 1)

    async def test(session: Any) -> None:
        async with session.ws_connect(f"{url}live") as one:
            await until(one, lambda m: m["type"] == "hello")
            async with session.ws_connect(f"{url}live") as more:
                answer = json.loads(await more.receive_str())
                assert (answer["ok"], "1 viewers" in answer["text"]) == (False, True)
                assert (await more.receive()).data == aiohttp.WSCloseCode.TRY_AGAIN_LATER

    with served(Source()) as url:
        run(test)


@pytest.fixture
def page(tmp_path: Path) -> Path:
    (tmp_path / "secret.js").write_text("secret")
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "index.html").write_text("<p>page</p>")
    (folder / "map.js").write_text("map")
    (folder / "notes.txt").write_text("not for the page")
    (folder / "linked").mkdir()
    return folder


def test_page_is_served_with_headers_that_keep_it_to_itself(page: Path) -> None:
    async def test(session: Any) -> None:
        async with session.get(url) as answer:
            assert await answer.text() == "<p>page</p>"
            assert answer.content_type == "text/html"
            policy = answer.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy
            assert "unsafe" not in policy
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
            assert answer.headers["Referrer-Policy"] == "no-referrer"
        async with session.get(f"{url}map.js") as answer:
            assert (await answer.text(), answer.content_type) == ("map", "text/javascript")

    with served(Source(), page) as url:
        run(test)


def test_only_files_of_the_page_are_served(page: Path) -> None:
    async def test(session: Any) -> None:
        from yarl import URL

        paths = ("..%2fsecret.js", "%2e%2e/secret.js", "linked", "notes.txt", "no.js", "%00.js")
        for path in paths:
            async with session.get(URL(f"{url}{path}", encoded=True)) as answer:
                assert answer.status == 404, path
                assert answer.headers["X-Content-Type-Options"] == "nosniff"

    with served(Source(), page) as url:
        run(test)


def test_pages_of_other_sites_are_turned_away(page: Path) -> None:
    async def test(session: Any) -> None:
        own = url.removeprefix("http://").rstrip("/")
        for headers, status in (
            ({"Host": "evil.example"}, 403),  # a name that was made to lead here
            ({"Host": "127.0.0.1.evil.example:8642"}, 403),
            ({"Host": "["}, 403),
            ({"Origin": "http://evil.example"}, 403),
            ({"Origin": "null"}, 403),
            ({"Origin": "http://localhost:1"}, 403),
            ({"Origin": f"http://{own}"}, 200),
            ({"Host": "localhost:1234"}, 200),  # as through a tunnel
        ):
            async with session.get(url, headers=headers) as answer:
                assert answer.status == status, headers
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            await session.ws_connect(f"{url}live", origin="http://evil.example")
        assert caught.value.status == 403
        async with session.ws_connect(f"{url}live", origin=f"http://{own}"):
            pass

    with served(Source(), page) as url:
        run(test)


@pytest.mark.parametrize(
    ("token", "encoded"), [("sesame", "sesame"), ("a b;&é+", "a%20b%3B%26%C3%A9%2B")]
)
def test_token_is_asked_for_by_everything(page: Path, token: str, encoded: str) -> None:
    async def test(session: Any) -> None:
        assert url.endswith(f"/?token={encoded}")
        base = url.removesuffix(f"?token={encoded}")
        for query in ("", "?token=", "?token=sesam", "?token=sesame2", "?token=s%C3%A9same"):
            for path in ("", "map.js", "live"):
                async with session.get(f"{base}{path}{query}") as answer:
                    assert answer.status == 403, (path, query)
        async with session.get(url) as answer:
            assert answer.status == 200
            cookie = answer.headers["Set-Cookie"].partition(";")[0]
            assert "httponly" in answer.headers["Set-Cookie"].lower()
            assert "samesite=strict" in answer.headers["Set-Cookie"].lower()
        async with session.get(f"{base}map.js", headers={"Cookie": cookie}) as answer:
            assert answer.status == 200
        async with session.ws_connect(f"{base}live", headers={"Cookie": cookie}) as viewer:
            await until(viewer, lambda m: m["type"] == "hello")
        async with session.ws_connect(f"{base}live?token={encoded}") as viewer:
            await until(viewer, lambda m: m["type"] == "hello")

    with served(Source(), page, token=token) as url:
        run(test)


@pytest.mark.parametrize(
    ("host", "needs_token"),
    [
        ("127.0.0.1", False),
        ("localhost", False),
        ("::1", False),
        ("0.0.0.0", True),
        ("192.0.2.7", True),
        ("::", True),
        ("robot-hub", True),
    ],
)
def test_other_addresses_than_loopback_have_a_token(host: str, needs_token: bool) -> None:
    one, other = Address.of(host, 8642, ""), Address.of(host, 8642, "")
    assert bool(one.token) is needs_token
    assert (one.token != other.token) is needs_token
    assert Address.of(host, 8642, "own").token == "own"


def test_address_of_all_networks_is_one_that_others_can_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    url = Address("0.0.0.0", 8642, "a b&c#ü/+").url()
    host = urlsplit(url).hostname
    assert host not in ("", "0.0.0.0", None)
    assert url == f"http://{host}:8642/?token=a%20b%26c%23%C3%BC%2F%2B"

    def refuse(*_: object) -> None:
        raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(socket, "socket", refuse)
    assert Address("::", 80, "").url() == f"http://{socket.gethostname()}:80/"


@pytest.mark.parametrize("host", ["300.1.1.1", "203.0.113.7"])
def test_host_that_is_not_of_this_machine_is_named(
    host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look_up(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    if host.startswith("300"):  # nobody is asked for it
        monkeypatch.setattr(socket, "getaddrinfo", look_up)
    stop = threading.Event()
    working = serve(Source(), Address(host, 0), rate=30.0, stop=stop, ready=lambda _: stop.set())
    with pytest.raises(PeopleLocError, match=rf"^--host {host} is no .*allowed: 127\.0\.0\.1"):
        asyncio.run(working)


def test_port_in_use_is_named() -> None:
    with served(Source()) as url:
        port = int(url.rstrip("/").rpartition(":")[2])
        again = serve(
            Source(),
            Address("127.0.0.1", port),
            rate=30.0,
            stop=threading.Event(),
            ready=lambda _: None,
        )
        with pytest.raises(PeopleLocError, match=f"port {port} of 127.0.0.1 is in use"):
            asyncio.run(again)
