"""Clients of a view in tests: a viewer of an engine without a transport, and a page without a screen."""

from __future__ import annotations

import http.client
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import numpy.typing as npt
from websockets.sync.client import ClientConnection, connect

import clrender
from clrender.view import Engine

__all__ = ["EngineClient", "Page", "Received", "Server"]

_SECONDS = 600.0
"""Longer than anything should take here, and a test that waits so long has failed."""

_WITH_TOKEN = """
import secrets, sys
from clrender.__main__ import main
token = sys.argv.pop(1)
secrets.token_urlsafe = lambda length: token
main()
"""


@dataclass
class Received:
    """A message: a JSON object, or the header of a frame with its pixels."""

    kind: str
    content: dict[str, Any]
    pixels: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0, 0), np.float32))

    @classmethod
    def of(cls, data: str | bytes) -> Received:
        if isinstance(data, str):
            content = json.loads(data)
            return cls(content["type"], content)
        start = 4 + int.from_bytes(data[:4], "little")
        assert start % 8 == 0
        header = json.loads(data[4:start])
        kind = {"float16": "<f2", "float32": "<f4"}[header["format"]]
        shape = header["height"], header["width"], header["channels"]
        return cls("frame", header, np.frombuffer(data[start:], kind).reshape(shape).astype(np.float32))


class _Client:
    """What both have: they receive messages until one that is waited for."""

    def __init__(self) -> None:
        self.newest: dict[str, Received] = {}
        self._done = (0, 0)

    def say(self, type_: str, /, **content: Any) -> None:
        raise NotImplementedError

    def next(self, seconds: float) -> Received:
        raise NotImplementedError

    def until(self, wanted: Callable[[Received], bool], seconds: float = _SECONDS) -> Received:
        """The next message of which something holds; frames are acknowledged on the way."""
        end = time.monotonic() + seconds
        while True:
            received = self.next(end - time.monotonic())
            self.newest[received.kind] = received
            if received.kind == "frame":
                self.say("ack", frame=received.content["frame"])
            if wanted(received):
                return received

    def until_kind(self, kind: str, **content: Any) -> Received:
        """The next message of a type that holds this content."""
        return self.until(lambda m: m.kind == kind and all(m.content.get(k) == v for k, v in content.items()))

    def until_done(self, revision: int = 0) -> str:
        """The hash of the image, once all samples are there, of another than was waited for last.

        It may have been told before: a frame may come after it that has the same samples.
        """

        def finished(m: Received) -> bool:
            told = m.content
            if m.kind != "progress" or not told["sha256"] or told["revision"] < revision:
                return False
            return (told["revision"], told["spp"]) != self._done

        newest = self.newest.get("progress")
        told = (newest if newest is not None and finished(newest) else self.until(finished)).content
        self._done = told["revision"], told["spp"]
        return str(told["sha256"])


class EngineClient(_Client):
    """A viewer of an engine."""

    def __init__(self, engine: Engine) -> None:
        super().__init__()
        self._awake = threading.Event()
        self.viewer = engine.connect(self._awake.set)

    def say(self, type_: str, /, **content: Any) -> None:
        self.viewer.receive(json.dumps({"type": type_, **content}))

    def next(self, seconds: float) -> Received:
        end = time.monotonic() + seconds
        while True:
            self._awake.clear()
            if (taken := self.viewer.take()) is not None:
                return Received.of(taken)
            if not self._awake.wait(max(0.0, end - time.monotonic())):
                raise TimeoutError(f"nothing came; so far {list(self.newest)}")


class Page(_Client):
    """A page's socket."""

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__()
        url = address.replace("http://", "ws://").replace("/?", "/socket?")
        self._open = ExitStack()
        # No pings: a page that does not read gets no answers to its own, and would end by itself on a busy machine
        # Nor does one that has stopped reading see the answer when it takes its leave: that is not waited for
        how = {"max_size": None, "compression": None, "ping_interval": None, "close_timeout": 1.0, **options}
        opened = connect(url, **how)
        self.socket: ClientConnection = self._open.enter_context(opened)

    def __enter__(self) -> Page:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._open.close()

    def say(self, type_: str, /, **content: Any) -> None:
        self.socket.send(json.dumps({"type": type_, **content}))

    def next(self, seconds: float) -> Received:
        return Received.of(self.socket.recv(timeout=max(0.0, seconds)))


class Server:
    """`clrender view` in a process of its own; with a token, at the address of an earlier one."""

    def __init__(
        self, *arguments: str, folder: Path | None = None, open_: bool = False, token: str | None = None
    ) -> None:
        program = ["-m", "clrender"] if token is None else ["-c", _WITH_TOKEN, token]
        self.process = subprocess.Popen(
            [sys.executable, *program, "view", *arguments, *([] if open_ else ["--no-open"])],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)},
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        parts = urlsplit(self.address)
        self.port = parts.port or 0
        self.token = parse_qs(parts.query).get("token", [""])[0]

    def __enter__(self) -> Server:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def get(
        self, path: str, headers: Mapping[str, str] | None = None, method: str = "GET"
    ) -> tuple[int, bytes, http.client.HTTPMessage]:
        """Status, body and headers of an answer; the path is sent as it is."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=_SECONDS)
        try:
            connection.putrequest(method, path, skip_host=headers is not None and "Host" in headers)
            for name, value in (headers or {}).items():
                connection.putheader(name, value)
            connection.endheaders()
            answer = connection.getresponse()
            return answer.status, answer.read(), answer.headers
        finally:
            connection.close()

    def end(self, number: int = signal.SIGINT) -> tuple[int, str, str]:
        """Exit code, and what it printed besides its first line."""
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=_SECONDS)
        return self.process.returncode, out, err
