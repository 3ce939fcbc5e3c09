"""The web server of the live view: the page, its socket, and files to download. It needs the extra `view`."""

from __future__ import annotations

import asyncio
import logging
import secrets
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

from clrender.drawing.bundle import page_file
from clrender.errors import ClrenderError, UsageError
from clrender.extras import missing_extra
from clrender.rendering.rendered_image import RenderedImage
from clrender.view.edited_scene import EditedScene, camera_toml
from clrender.view.engine import Engine
from clrender.view.guard import CONTENT_POLICY, Guard
from clrender.view.keep import ARCHIVE, write_archive
from clrender.view.messages import MESSAGE_BYTES

try:
    import uvicorn
    import websockets  # noqa: F401  # which uvicorn imports only when it is asked for it
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import PlainTextResponse, Response, StreamingResponse
    from starlette.routing import Route, WebSocketRoute
    from starlette.types import ASGIApp, Message, Receive, Scope, Send
    from uvicorn.protocols.http.h11_impl import H11Protocol

    from clrender.view.page_socket import serve_page
except ImportError as missing:
    raise missing_extra(
        "view", f"the live view needs {missing.name or 'a web server'}, which is not installed"
    ) from None

__all__ = ["listen", "serve"]

_MOST_CONNECTIONS: Final = 128
"""Open at the same time; a new one beyond them is closed at once."""
_GOODBYE_SECONDS: Final = 2.0
"""To send what is queued at the end."""
_SILENT_SECONDS: Final = 10.0
"""A connection without a request is closed after so long."""
_TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".json": "application/json",
}
_HEADERS: Final = {
    "content-security-policy": CONTENT_POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
_BLOCK_BYTES: Final = 1 << 20
_DOWNLOADS: Final = {"image.png": "image/png", "image.exr": "image/x-exr", "image.film": "application/octet-stream"}


class _Connection(H11Protocol):
    """An HTTP connection with limits: on how many there are, and on the time until its first request."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if len(self.connections) > _MOST_CONNECTIONS:
            transport.abort()
        else:
            self.loop.call_later(_SILENT_SECONDS, self._close_if_silent)

    def _close_if_silent(self) -> None:
        if self.cycle is None and not self.transport.is_closing() and self in self.connections:
            self.transport.abort()


class _Server(uvicorn.Server):
    """A server that sends viewers the end of the view before it closes their sockets."""

    def __init__(self, config: uvicorn.Config, engine: Engine) -> None:
        super().__init__(config)
        self._engine = engine

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Take SIGHUP as SIGTERM, unless it is ignored; then the signals that came are raised again."""
        number = getattr(signal, "SIGHUP", signal.SIGTERM)
        before = signal.getsignal(number)
        takes = threading.current_thread() is threading.main_thread() and before not in (signal.SIG_IGN, None)
        if takes:
            signal.signal(number, self.handle_exit)
        with super().capture_signals():
            try:
                yield
            finally:
                if takes:
                    signal.signal(number, before)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._engine.send_goodbye()
        end = time.monotonic() + _GOODBYE_SECONDS
        while not self._engine.drained and time.monotonic() < end:
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.05)  # for the sockets to send what was taken
        await super().shutdown(sockets)


class _Guarded:
    """ASGI middleware: refuses what the guard does not allow, and adds the security headers."""

    def __init__(self, app: ASGIApp, guard: Guard) -> None:
        self._app, self._guard = app, guard

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        asked = Request({**scope, "type": "http", "method": "GET"})
        token = asked.query_params.get("token")

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                more = dict(_HEADERS)
                if scope["path"] == "/" and message["status"] == 200 and token is not None:
                    more["set-cookie"] = f"{self._guard.cookie}={token}; HttpOnly; SameSite=Strict; Path=/"
                extra = [(name.encode(), value.encode("latin-1")) for name, value in more.items()]
                message = {**message, "headers": [*message.get("headers", []), *extra]}
            await send(message)

        if self._guard.allows(headers, token):
            await self._app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": ""})  # before it is accepted: 403
        else:
            refusal = PlainTextResponse("403: open the address that clrender printed, with its token\n", 403)
            await refusal(scope, receive, send_with_headers)


def listen(host: str, port: int) -> socket.socket:
    """Open a listening socket.

    Parameters
    ----------
    host : str
        Name or number of an address of this machine.
    port : int
        0: one that is free.

    Raises
    ------
    UsageError
        It is taken, or not of this machine.
    """
    try:
        family, kind, proto, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        taken = socket.socket(family, kind, proto)
        try:
            taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            taken.bind(address)
            taken.listen(128)
        except BaseException:
            taken.close()
            raise
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot listen at {host} port {port}: {error}; name another --host or --port") from None
    return taken


def serve(
    engine: Engine, listening: socket.socket, host: str, ready: Callable[[str], None], token: str | None = None
) -> None:
    """Serve an engine's view until SIGINT, SIGTERM or SIGHUP; in the main thread.

    Parameters
    ----------
    engine : Engine
    listening : socket.socket
        As of `listen`.
    host : str
        As of `listen`.
    ready : callable
        Told the address with its token.
    token : str, optional
        Default: a new one, that nobody can guess.
    """
    token = token or secrets.token_urlsafe(24)
    port = listening.getsockname()[1]
    guard = Guard(token, port, host)
    routes = [
        Route("/", _page),
        Route("/page/{name}", _page_file),
        Route("/download/{name}", _download),
        WebSocketRoute("/socket", serve_page),
    ]
    app = Starlette(routes=routes)
    app.state.engine = engine
    app.state.archiving = asyncio.Semaphore(1)
    config = uvicorn.Config(
        _Guarded(app, guard),
        http=_Connection,
        ws="websockets-sansio",
        ws_max_size=MESSAGE_BYTES,
        ws_per_message_deflate=False,
        log_level="error",
        access_log=False,
        lifespan="off",
        server_header=False,
        timeout_graceful_shutdown=1,
        h11_max_incomplete_event_size=16384,
    )
    logging.getLogger("uvicorn.error").addFilter(_is_ours)
    shown = "localhost" if host == "localhost" else f"[{host}]" if ":" in host else host
    ready(f"http://{shown}:{port}/?token={token}")
    server = _Server(config, engine)
    # Around the event loop too: an exception that a signal raises in one of its tasks is logged when that is collected.
    with server.capture_signals():
        server.run(sockets=[listening])


def _is_ours(record: logging.LogRecord) -> bool:
    """Whether a log record is of a fault here, and not of bytes that a client sent as a text in UTF-8."""
    return not (record.exc_info and isinstance(record.exc_info[1], UnicodeDecodeError))


async def _page(request: Request) -> Response:
    return _package_file("index.html")


async def _page_file(request: Request) -> Response:
    return _package_file(request.path_params["name"])


def _package_file(name: str) -> Response:
    """A file of the page."""
    kind, found = _TYPES.get(Path(name).suffix), page_file(name)
    if found is None or kind is None or not found.is_file():
        return PlainTextResponse("404: there is no such file\n", 404)
    return Response(found.read_bytes(), media_type=kind)


async def _download(request: Request) -> Response:
    engine: Engine = request.app.state.engine
    name = request.path_params["name"]
    if name == "camera.toml":
        return Response(camera_toml(engine.edited_scene.camera), media_type="application/toml", headers=_as_file(name))
    if name == ARCHIVE:
        return await _scene_archive(request)
    if name not in _DOWNLOADS:
        return PlainTextResponse("404: there is no such file\n", 404)
    try:
        exposure = float(request.query_params.get("exposure", "0"))
        # Awaited here: threads that wait for the renderer would be missing where frames are made for viewers.
        image = await asyncio.wrap_future(engine.image(request.query_params.get("alpha") == "1"))
        if image is None:
            raise UsageError("there is no sample yet, and so nothing to save")
        data = await asyncio.to_thread(_saved, image, name, request.query_params.get("tone_map", "srgb"), exposure)
    except (ClrenderError, ValueError) as error:
        return PlainTextResponse(f"400: {error}\n", 400)
    except asyncio.CancelledError:
        if not engine.ended:
            raise
        return PlainTextResponse("400: the view has ended\n", 400)
    return Response(data, media_type=_DOWNLOADS[name], headers=_as_file(name))


async def _scene_archive(request: Request) -> Response:
    engine: Engine = request.app.state.engine
    try:
        edited = await asyncio.wrap_future(engine.scene_to_keep())
        # One at a time: it may have as many bytes as all files of the scene.
        async with request.app.state.archiving:
            file = await asyncio.to_thread(_archived, edited)
    except (ClrenderError, OSError) as error:
        return PlainTextResponse(f"400: {error}\n", 400)
    except asyncio.CancelledError:
        if not engine.ended:
            raise
        return PlainTextResponse("400: the view has ended\n", 400)
    return StreamingResponse(_blocks(file), media_type="application/zip", headers=_as_file(ARCHIVE))


def _archived(edited: EditedScene) -> IO[bytes]:
    """A temporary file with the archive of a scene, which is gone when it is closed."""
    file = tempfile.TemporaryFile(prefix="clrender-view-")  # noqa: SIM115  # which `_blocks` closes
    try:
        write_archive(edited, file)
        file.seek(0)
    except BaseException:
        file.close()
        raise
    return file


def _blocks(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        while block := file.read(_BLOCK_BYTES):
            yield block


def _as_file(name: str) -> dict[str, str]:
    return {"content-disposition": f'attachment; filename="{name}"'}


def _saved(image: RenderedImage, name: str, tone_map: str, exposure: float) -> bytes:
    """The bytes of an image file, written to a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="clrender-view-") as folder:
        path = Path(folder) / name
        image.save(path, tone_map, exposure)
        return path.read_bytes()
