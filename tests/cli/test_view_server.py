"""`clrender view` as its users and its enemies have it: addresses, pages, refusals, Ctrl-C."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cases import for_each
from cli_support import call
from view_clients import Page, Server
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import clrender
from clrender.film import Film
from clrender.view import server as view_server
from clrender.view.broadcaster import MOST_VIEWERS
from clrender.view.messages import MESSAGE_BYTES
from clrender.view.page_socket import serve_page

pytestmark = pytest.mark.usefixtures("only_driver")

ARGUMENTS = ("room", "--size", "96x64", "--spp", "8", "-d", "cpu")


@pytest.fixture(scope="module")
def server(cache_folder: Path, only_driver: None) -> Iterator[Server]:
    """One for all tests that leave it as it is."""
    with Server(*ARGUMENTS) as running:
        with Page(running.address) as page:
            page.until_done()
        yield running


def renders(server: Server) -> bool:
    """Whether a view goes on: a page sees the image made anew."""
    with Page(server.address) as page:
        page.until_done()
        page.say("restart")
        return bool(page.until_done())


def test_the_first_line_is_the_address(server: Server) -> None:
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32,}", server.address)


def test_the_page_comes_with_the_token_and_with_its_policy(server: Server) -> None:
    status, body, headers = server.get(f"/?token={server.token}")
    assert status == 200
    assert headers["content-type"] == "text/html; charset=utf-8"
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "*" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert "access-control-allow-origin" not in headers
    assert b"<html" in body
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    named = re.findall(rb'(?:src|href)="(page/[\w.-]+)"', body)
    assert named
    for name in named:
        path = f"/{name.decode()}"
        assert server.get(path, {"Cookie": cookie.split(";")[0]})[0] == 200
        assert server.get(f"{path}?token={server.token}")[0] == 200
        assert server.get(path)[0] == 403


REFUSED: dict[str, dict[str, str]] = {
    "another site's page": {"Origin": "http://evil.example"},
    "a page of another port": {"Origin": "http://127.0.0.1:1"},
    "a page of no site": {"Origin": "null"},
    "a name that leads here (DNS rebinding)": {"Host": "evil.example"},
    "that, with the port": {"Host": "evil.example:{port}", "Origin": "http://evil.example:{port}"},
    "another port": {"Host": "127.0.0.1:1"},
}


@for_each("name", REFUSED)
@for_each("path", ["/?token={token}", "/page/page.js?token={token}", "/download/image.film?token={token}"])
def test_nobody_else_is_answered(server: Server, name: str, path: str) -> None:
    headers = {key: value.format(port=server.port) for key, value in REFUSED[name].items()}
    status, body, sent = server.get(f"{path}?token={server.token}", headers)
    assert status == 403
    assert server.token.encode() not in body
    assert "set-cookie" not in sent


@pytest.mark.parametrize("name", REFUSED)
def test_nobody_else_gets_a_socket(server: Server, name: str) -> None:
    headers = {key: value.format(port=server.port) for key, value in REFUSED[name].items()}
    lines = {"Host": f"127.0.0.1:{server.port}", "Upgrade": "websocket", "Connection": "Upgrade"}
    lines |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13", **headers}
    assert server.get(f"/socket?token={server.token}", lines)[0] == 403
    assert server.get(f"/socket?token={server.token}", {**lines, **{k: lines_of(server)[k] for k in headers}})[0] == 101


def lines_of(server: Server) -> dict[str, str]:
    """What the page of the server itself would send."""
    return {"Host": f"127.0.0.1:{server.port}", "Origin": f"http://127.0.0.1:{server.port}"}


@for_each("token", [None, "", "x", "{token}x", "{part}", "%00", "%C3%A9"])
def test_without_the_token_there_is_nothing(server: Server, token: str | None) -> None:
    given = "" if token is None else "?token=" + token.format(token=server.token, part=server.token[:-1])
    for path in ("/", "/page/page.js", "/download/image.png", "/download/camera.toml", "/nothing"):
        assert server.get(path + given)[0] == 403
    with pytest.raises(InvalidStatus) as refused, connect(f"ws://127.0.0.1:{server.port}/socket{given}"):
        pass
    assert refused.value.response.status_code == 403


@for_each(
    "path",
    [
        "/page/../engine.py",
        "/page/..%2fengine.py",
        "/page/%2e%2e/engine.py",
        "/page/..\\engine.py",
        "/page//etc/passwd",
        "/page/%2fetc%2fpasswd",
        "/page/index.html%00",
        "/page/",
        "/page/.",
        "/engine.py",
        "/../../etc/passwd",
        "/download/../../etc/passwd",
        "/download/..%2f..%2fetc%2fpasswd",
        "/download/image.toml",
        "/download/room.toml",
        "//etc/passwd",
    ],
)
def test_no_path_leads_out(server: Server, path: str) -> None:
    status, body, _ = server.get(f"{path}?token={server.token}")
    assert status in (400, 404)
    assert b"root:" not in body
    assert b"import" not in body


@for_each("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_nothing_is_done_by_http(server: Server, method: str) -> None:
    assert server.get(f"/?token={server.token}", {"Content-Length": "0"}, method)[0] == 405


@pytest.mark.parametrize(
    ("sent", "code"),
    [("x" * (MESSAGE_BYTES + 1), 1009), ("é" * MESSAGE_BYTES, 1009), (b"\x00\x01", 1003), (b"x" * 10**6, 1009)],
    ids=["too long", "too long in bytes", "binary", "a megabyte"],
)
def test_what_is_no_message_ends_that_page_alone(server: Server, sent: str | bytes, code: int) -> None:
    with Page(server.address) as other, Page(server.address) as page:
        page.socket.send(sent)
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                page.next(60.0)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == code
        other.say("restart")
        assert other.until_done()


def test_malformed_messages_are_refused_one_by_one_and_then_end_that_page(server: Server) -> None:
    with Page(server.address) as page:
        for text in ("", "{", "[]", '{"type": "probe"}', '{"type": "save", "name": "../x.png"}', "[" * 60000):
            page.socket.send(text)
            assert page.until_kind("refused").content["message"]
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                page.socket.send("nonsense")
                page.until_kind("refused")
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008
    assert renders(server)


def test_a_thousand_connections_are_refused_and_the_render_goes_on(server: Server) -> None:
    with Page(server.address) as page, ExitStack() as opened:
        page.until_done()
        page.say("restart")
        refused = 0
        for number in range(1000):
            try:
                each = opened.enter_context(socket.create_connection(("127.0.0.1", server.port), 10.0))
                if number % 2:
                    each.sendall(b"GET /")  # and never more
            except OSError:
                refused += 1
        assert page.until_done()
        page.say("restart")
        assert page.until_done()
    assert server.get(f"/?token={server.token}")[0] in (200, 503)
    assert renders(server)


@pytest.mark.slow
def test_too_many_pages_are_refused(server: Server) -> None:
    with ExitStack() as opened:
        first = opened.enter_context(Page(server.address))
        codes = []
        for _ in range(MOST_VIEWERS + 3):
            page = opened.enter_context(Page(server.address))
            try:
                page.until_kind("hello")
            except ConnectionClosed as closed:
                codes.append(closed.rcvd.code if closed.rcvd is not None else None)
        assert codes == [1013] * 4
        first.say("restart")
        assert first.until_done()
    assert renders(server)


@pytest.mark.thorough
def test_two_pages_see_the_same_and_one_that_does_not_read_slows_nobody(server: Server) -> None:
    address = server.address
    with Page(address) as page, Page(address, max_queue=1), Page(address) as third:
        for number in range(100):
            page.say("camera", id=number, camera={"position": [0.001 * number, 2.0, 5.0]})
        last = page.until(lambda m: m.kind == "frame" and m.content["answers"] == 99).content["revision"]
        assert page.until_done(last) == third.until_done(last)
        page.say("reset", what="camera")
        page.until_done()


@pytest.mark.thorough
def test_downloads_are_the_image(server: Server, tmp_path: Path) -> None:
    files = (("image.png", b"\x89PNG"), ("image.exr", b"\x76\x2f\x31\x01"), ("image.film", b""))
    with Page(server.address) as page:
        page.until_done()
        page.say("set", settings={"seed": 3})
        digest = page.until_done()
        page.say("restart")
        assert page.until_done() == digest
    for name, begin in files:
        status, body, headers = server.get(f"/download/{name}?token={server.token}")
        assert status == 200
        assert body.startswith(begin)
        assert name in headers["content-disposition"]
        (tmp_path / name).write_bytes(body)
    done = call("render", *ARGUMENTS[:-2], "--seed", "3", "-d", "cpu", "-o", "a.film", folder=tmp_path)
    assert done.returncode == 0
    assert Film.load(tmp_path / "image.film").request == Film.load(tmp_path / "a.film").request
    assert Film.load(tmp_path / "a.film").provenance["image_sha256"] == digest
    compared = call("compare", "image.film", "a.film", "--json", folder=tmp_path)
    assert json.loads(compared.stdout)["rmse"] == 0.0
    assert b"[camera]" in server.get(f"/download/camera.toml?token={server.token}")[1]
    assert server.get(f"/download/image.png?tone_map=nonsense&token={server.token}")[0] == 400
    assert server.get(f"/download/image.png?exposure=x&token={server.token}")[0] == 400
    with Page(server.address) as page:
        page.say("reset", what="settings")
        page.until_done()


@pytest.mark.long
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
@pytest.mark.parametrize("looking", [False, True])
def test_a_signal_ends_it(cache_folder: Path, number: int, code: int, looking: bool) -> None:
    with Server(*ARGUMENTS[:4], "65536", *ARGUMENTS[5:]) as running, ExitStack() as opened:
        if looking:
            page = opened.enter_context(Page(running.address))
            page.until_kind("frame")
        ended, out, err = running.end(number)
        assert (ended, out) == (code, "")
        assert "Traceback" not in err
        if looking:  # what came before it was closed; to acknowledge a frame is too late now
            kinds = []
            with suppress(ConnectionClosed):
                while True:
                    kinds.append(page.next(60.0).kind)
            assert "bye" in kinds


@pytest.mark.long
def test_bytes_that_are_no_text_end_that_page_without_a_traceback(cache_folder: Path) -> None:
    with Server(*ARGUMENTS) as running:
        address = running.address.replace("http://", "ws://").replace("/?", "/socket?")
        with connect(address, additional_headers={"Origin": running.address.split("/?")[0]}) as page:
            mask, text = b"\1\2\3\4", b"\xff\xfe{"
            masked = bytes(byte ^ mask[k % 4] for k, byte in enumerate(text))
            page.socket.sendall(bytes([0x81, 0x80 | len(text)]) + mask + masked)
            with pytest.raises(ConnectionClosed) as closed:
                while True:
                    page.recv(timeout=60.0)
            assert closed.value.rcvd is None or closed.value.rcvd.code == 1007
        assert renders(running)
        code, _, errors = running.end()
    assert code == 0
    assert "Traceback" not in errors, errors


@pytest.mark.long
def test_files_are_written_where_the_command_line_says(cache_folder: Path, tmp_path: Path) -> None:
    with Server(*ARGUMENTS, "-o", "a.png", folder=tmp_path) as running, Page(running.address) as page:
        page.until_done()
        page.say("save", name="a.png", exposure=1.0)
        page.until_kind("saved")
        page.say("save", name="b.png")
        page.until_kind("refused")
        assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
        assert running.end()[0] == 0


@pytest.mark.thorough
def test_an_open_address_is_warned_of(cache_folder: Path) -> None:
    with Server(*ARGUMENTS, "--host", "0.0.0.0") as running:
        assert running.get(f"/?token={running.token}")[0] == 200
        assert running.get(f"/?token={running.token}", {"Host": f"evil.example:{running.port}"})[0] == 403
        code, _, err = running.end()
        assert code == 0
        assert "warning: 0.0.0.0 can be reached from other machines" in err


@pytest.mark.thorough
@for_each(
    ("arguments", "code", "words"),
    [
        (("no-such-scene",), 2, "no built-in scene"),
        (("room", "--host", "203.0.113.7"), 2, "cannot listen at 203.0.113.7"),
        (("room", "--port", "99999"), 2, "--port"),
        (("room", "--spp", "0"), 2, "--spp"),
        (("room", "--integrator", "radiosity"), 2, "radiosity"),
        (("room", "-o", "a.txt"), 2, "a.txt"),
        (("room", "-o", "no-such-folder/a.png"), 2, "no-such-folder"),
        (("room", "-d", "no such device"), 2, "no such device"),
        (("room", "--time", "3"), 2, "--time"),
    ],
)
def test_a_view_that_cannot_begin_says_why(
    cache_folder: Path, tmp_path: Path, arguments: tuple[str, ...], code: int, words: str
) -> None:
    done = call("view", *arguments, "--no-open", folder=tmp_path)
    assert (done.returncode, done.stdout) == (code, "")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_port_that_is_taken_is_told(server: Server) -> None:
    done = call("view", "room", "--no-open", "--port", str(server.port))
    assert done.returncode == 2
    assert f"port {server.port}" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("missing", ["starlette", "uvicorn", "websockets"])
def test_without_the_extra_there_is_one_clear_error(cache_folder: Path, missing: str) -> None:
    code = f"import sys; sys.modules[{missing!r}] = None; from clrender.__main__ import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "view", "room", "--no-open"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)},
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert missing in done.stderr
    assert "pip install 'starlette" in done.stderr


def answers(told: Any) -> bool:
    """Whether a state is one."""
    return {"camera", "settings", "status"} <= set(told)


def test_a_page_that_comes_later_is_told_all(server: Server) -> None:
    with Page(server.address) as page:
        assert page.until_kind("hello").content["protocol"] == 1
        assert page.until_kind("scene").content["materials"]
        assert answers(page.until_kind("state").content)
        assert page.until_kind("frame").content["final"]


# --- without a process of its own ---


def test_downloads_that_wait_take_no_thread_from_viewers() -> None:
    """A download waits for the renderer, which may take a minute; frames are made in the loop's threads meanwhile."""
    pending: list[Future[Any]] = []

    class Busy:
        ended = False

        def image(self, alpha: bool = False) -> Future[Any]:
            pending.append(Future())
            return pending[-1]

    async def ask() -> list[int]:
        app = SimpleNamespace(state=SimpleNamespace(engine=Busy()))
        request: Any = SimpleNamespace(app=app, path_params={"name": "image.png"}, query_params={})
        downloads = [asyncio.create_task(view_server._download(request)) for _ in range(64)]
        end = time.monotonic() + 20.0
        while len(pending) < len(downloads) and time.monotonic() < end:
            await asyncio.sleep(0.01)
        try:
            await asyncio.wait_for(asyncio.to_thread(lambda: None), 20.0)
        finally:
            for each in pending:
                each.set_result(None)
        return [(await download).status_code for download in downloads]

    assert asyncio.run(ask()) == [400] * 64


def test_a_socket_whose_viewer_fails_is_hung_up_on() -> None:
    """A page that only looks says nothing: its socket must not wait for a message before it ends."""
    left: list[str] = []

    def take() -> str:
        raise ValueError("made up")

    async def never() -> dict[str, Any]:
        await asyncio.Event().wait()
        return {}

    async def accept() -> None:
        pass

    viewer = SimpleNamespace(take=take, closed=None, close=lambda: left.append("viewer"))
    app = SimpleNamespace(state=SimpleNamespace(engine=SimpleNamespace(connect=lambda wake: viewer)))
    page: Any = SimpleNamespace(app=app, accept=accept, receive=never)

    async def talk() -> None:
        await asyncio.wait_for(serve_page(page), 20.0)

    with pytest.raises(ValueError, match="made up"):  # and no TimeoutError
        asyncio.run(talk())
    assert left == ["viewer"]
