"""The WebSocket between a page and its viewer."""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING

from starlette.websockets import WebSocket, WebSocketDisconnect

from clrender.errors import UsageError

if TYPE_CHECKING:
    from clrender.view.engine import Engine

__all__ = ["serve_page"]


async def serve_page(page: WebSocket) -> None:
    """Connect a page's WebSocket to a viewer of its own, until either side closes it.

    The event loop receives. Messages and frames are taken from the viewer in worker threads.
    """
    engine: Engine = page.app.state.engine
    loop, awake = asyncio.get_running_loop(), asyncio.Event()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(awake.set)

    await page.accept()
    try:
        viewer = engine.connect(wake)
    except UsageError as error:
        await page.close(1013, str(error))
        return

    async def send() -> None:
        while True:
            awake.clear()
            while (item := await asyncio.to_thread(viewer.take)) is not None:
                await (page.send_text(item) if isinstance(item, str) else page.send_bytes(item))
            if viewer.closed is not None:
                await page.close(1008, viewer.closed[:100])
                return
            await awake.wait()

    async def receive() -> None:
        while (message := await page.receive())["type"] != "websocket.disconnect":
            if message.get("text") is None:
                await page.close(1003, "messages are texts")
                return
            viewer.receive(message["text"])

    both = {asyncio.create_task(send()), asyncio.create_task(receive())}
    try:
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
    finally:  # one that has ended, or failed, ends the other
        viewer.close()
        for task in both:
            task.cancel()
        results = await asyncio.gather(*both, return_exceptions=True)
    for result in results:  # the server closes the socket of one that failed
        # RuntimeError: the socket was closed from this side meanwhile
        if isinstance(result, Exception) and not isinstance(result, WebSocketDisconnect | RuntimeError | OSError):
            raise result
