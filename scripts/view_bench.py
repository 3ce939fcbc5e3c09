"""How soon a live view answers: `scripts/view_bench.py [SCENE]` drives `clrender view` as a page does.

It prints lines of JSON: ``start`` (command to address), ``first_picture`` (a page that opens, to its first frame, which
a render under way has ready), ``orbit`` (a camera is sent, to the first frame that shows it; while the image refines in
between) and ``drag`` (a camera every 16 ms, to the frame that shows it or a later one).
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import statistics
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from websockets.sync.client import ClientConnection, connect

__all__ = ["main"]


class Page:
    """A headless client that behaves like the page."""

    def __init__(self, address: str) -> None:
        urllib.request.urlopen(address).read()
        url = address.replace("http", "ws").replace("/?", "/socket?")
        self._open = ExitStack()
        opened = connect(url, compression=None, max_size=None)
        self.socket: ClientConnection = self._open.enter_context(opened)
        self.said: dict[str, Any] = {}

    def close(self) -> None:
        """Disconnect."""
        self._open.close()

    def say(self, **message: Any) -> None:
        """Send a message."""
        self.socket.send(json.dumps(message))

    def frame(self, timeout: float = 60.0) -> dict[str, Any]:
        """The header of the next frame, which is acknowledged at once."""
        end = time.monotonic() + timeout
        while True:
            data = self.socket.recv(timeout=end - time.monotonic())
            if isinstance(data, str):
                message = json.loads(data)
                self.said[message["type"]] = message
                continue
            header: dict[str, Any] = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
            self.say(type="ack", frame=header["frame"])
            return header


def around(camera: dict[str, Any], angle: float) -> list[float]:
    """The camera's position, rotated around its target."""
    x, y, z = (p - t for p, t in zip(camera["position"], camera["target"], strict=True))
    turned = x * math.cos(angle) + z * math.sin(angle), y, z * math.cos(angle) - x * math.sin(angle)
    return [t + p for t, p in zip(camera["target"], turned, strict=True)]


def orbit(page: Page, camera: dict[str, Any], rounds: int, pause: float) -> list[float]:
    """Seconds from each of some cameras to the first frame that shows it, with a pause in between."""
    seconds = []
    for number in range(1, rounds + 1):
        until = time.perf_counter() + pause
        while time.perf_counter() < until:
            try:
                page.frame(max(0.001, until - time.perf_counter()))
            except TimeoutError:
                break
        begin = time.perf_counter()
        page.say(type="camera", id=number, camera={"position": around(camera, 0.3 * math.sin(number / 5.0))})
        while page.frame()["answers"] != number:
            pass
        seconds.append(time.perf_counter() - begin)
    return seconds


def drag(page: Page, camera: dict[str, Any], seconds: float) -> list[float]:
    """Seconds from each of a stream of cameras to the first frame that shows it or a later one."""
    sent: dict[int, float] = {}

    def send() -> None:
        for number in range(10_000, 10_000 + int(seconds / 0.016)):
            sent[number] = time.perf_counter()
            page.say(type="camera", id=number, camera={"position": around(camera, 0.3 * math.sin(number / 20.0))})
            time.sleep(0.016)

    thread = threading.Thread(target=send)
    thread.start()
    answered: list[float] = []
    last, end = 9_999, 9_999 + int(seconds / 0.016)
    while last < end:
        answers = page.frame()["answers"]
        if isinstance(answers, int) and answers > last:
            now = time.perf_counter()
            answered += [now - sent[number] for number in range(last + 1, answers + 1)]
            last = answers
    thread.join()
    return answered


def told(what: str, seconds: Sequence[float]) -> None:
    """Print statistics of measured times."""
    ordered = sorted(seconds)
    numbers = {
        "median_ms": statistics.median(ordered),
        "p95_ms": ordered[int(0.95 * (len(ordered) - 1))],
        "most_ms": ordered[-1],
    }
    print(json.dumps({"what": what, "count": len(ordered), **{k: round(1e3 * v, 1) for k, v in numbers.items()}}))


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="room")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rounds", type=int, default=30)
    options = parser.parse_args()
    command = [sys.executable, "-m", "clrender", "view", options.scene, "--no-open"]
    command += ["--size", options.size, "--spp", "4096", "-d", options.device]
    begin = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            told("start", [time.perf_counter() - begin])
            page = Page(address)
            page.frame()
            told("first picture after start", [time.perf_counter() - begin])
            firsts = []
            for _ in range(5):
                begin = time.perf_counter()
                other = Page(address)
                other.frame()
                firsts.append(time.perf_counter() - begin)
                other.close()
            told("first_picture", firsts)
            camera = page.said["state"]["camera"]
            told("orbit", orbit(page, camera, options.rounds, 0.5))
            told("orbit soon after", orbit(page, camera, options.rounds, 0.05))
            told("drag", drag(page, camera, 5.0))
        finally:
            server.send_signal(signal.SIGINT)
            code = server.wait(30)
    print(json.dumps({"exit": code}))


if __name__ == "__main__":
    main()
