"""Connection to one worker's process: calls with time limits, and whether the worker can be called."""

from __future__ import annotations

import asyncio
import concurrent.futures
import importlib
import threading
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from clrender.cluster.remote import Answer, RemoteRenderer, State
from clrender.errors import ClrenderError, DeviceFailure, RenderError
from clrender.version import __version__

if TYPE_CHECKING:
    from distributed import Client

    from clrender.cluster.peer import Peer

__all__ = ["Connection"]

_Future = concurrent.futures.Future[Any]

ANSWER_SECONDS: float = 15.0
"""Time without an answer after which a worker's process counts as lost, until it answers again."""
_ASK_SECONDS: Final = 1.0
"""Interval at which a worker is asked for its state during a long call."""
_STOP_SECONDS: Final = 0.8
"""Time for a worker to send its partial result when the render is stopped: Ctrl-C must take effect within a second."""
_WAIT: Final = 0.2
"""Polling interval during a call, long enough that a thousand threads do not load this process."""
_ANEW_SECONDS: Final = 2.0
"""Interval between requests to a worker that has not answered. After a network failure an old connection takes minutes
to recover, but each request may open a new one."""
_MOST_QUESTIONS: Final = 8
_FORGET_SECONDS: Final = 10.0
"""Time after which an address whose connection broke is called again, if the scheduler still lists it."""


class Connection:
    """The connection to a worker: an actor in its process, once created.

    Parameters
    ----------
    client : distributed.Client
    spec : tuple or None
        See `RemoteRenderer`.
    peers : callable
        Returns the workers that the scheduler currently knows.
    on_answer : callable
        Called after each answer.

    Attributes
    ----------
    state : State
        The last known state.
    lost : int
        Number of times that the connection broke or the worker did not answer.
    """

    def __init__(
        self,
        client: Client,
        spec: tuple[str | int, ...] | None,
        peers: Callable[[], Mapping[str, Peer]],
        on_answer: Callable[[], None],
    ) -> None:
        self._client, self._spec, self._peers, self._on_answer = client, spec, peers, on_answer
        self.state = State()
        self.lost = 0
        self._peer: Peer | None = None
        self._actor: Any = None
        self._holder: Any = None  # Dask's future of the actor, which keeps it alive
        self._given_up = threading.Event()
        self._broken: tuple[str, float] | None = None
        self._questions: list[_Future] = []
        self._asked = 0.0

    def give_up(self) -> None:
        """Stop waiting for any call in progress, except rendering."""
        self._given_up.set()

    def close(self) -> None:
        """Release the actor; Dask deletes it when there are no more references here."""
        self._given_up.set()
        for question in self._questions:
            question.cancel()
        self._actor = self._holder = None

    def leads_to(self, peer: Peer) -> bool:
        """Whether the actor is in this peer's current process."""
        return self._actor is not None and self._peer is not None and self._peer.address == peer.address

    def is_open(self, peer: Peer) -> bool:
        """Whether the peer can be called: its connection did not break, and it has no overdue answer."""
        if self._broken is not None and self._broken[0] == peer.address:
            return time.monotonic() - self._broken[1] > _FORGET_SECONDS
        if self._peer is None or self._peer.address != peer.address or not self._questions:
            return True
        if any(each.done() and not each.cancelled() and each.exception() is None for each in self._questions):
            self._on_answer()
            self._questions = []
            return True
        if self._actor is not None and time.monotonic() - self._asked > _ANEW_SECONDS:
            self._asked = time.monotonic()
            with suppress(ClrenderError):
                self._questions = [*self._questions[-_MOST_QUESTIONS + 1 :], self._begin("state")]
        return False

    def connect(self, peer: Peer) -> None:
        """Create an actor in this worker's process, unless there is one.

        Raises
        ------
        DeviceFailure
            When the worker does not answer.
        RenderError
            When the worker cannot create one.
        """
        if self.leads_to(peer):
            return
        self._questions, self._broken, self._actor, self._peer = [], None, None, peer
        # Import the module first: a class that cannot be loaded would end the worker's process, which others may share
        loaded = self._submit(importlib.import_module, RemoteRenderer.__module__)
        if self._await(loaded) and loaded.status != "error":
            self._holder = self._submit(RemoteRenderer, self._spec, actor=True)
            if self._await(self._holder):
                self._actor = self._result(self._holder.result)
        elif loaded.status == "error":
            raise RenderError(
                f"{peer.title} cannot load clrender ({_first_line(self._result(loaded.exception))}); install clrender "
                f"{__version__} there"
            )

    def _submit(self, function: Callable[..., Any], *arguments: Any, actor: bool = False) -> Any:
        """Run a function on this worker only; returns Dask's future of the result."""
        assert self._peer is not None
        try:
            return self._client.submit(
                function, *arguments, key=f"clrender-{uuid.uuid4().hex}", workers=[self._peer.address],
                allow_other_workers=False, pure=False, retries=0, actor=actor,
            )  # fmt: skip
        except (
            Exception
        ):  # after losing the scheduler the client closes itself, with an error that depends on the version
            raise self._lose("cannot be reached any more") from None

    def _await(self, future: Any) -> bool:
        """Wait for one of Dask's futures; returns whether it is done, False if given up."""
        begun = time.monotonic()
        while not future.done():
            if self._given_up.is_set():
                return False
            if self._moved() or time.monotonic() - begun > ANSWER_SECONDS:
                raise self._lose("did not take the job")
            time.sleep(_WAIT / 8)
        return True

    def _result(self, get: Callable[..., Any]) -> Any:
        """Result of one of Dask's futures that is done."""
        try:
            return get(timeout=ANSWER_SECONDS)
        except (OSError, concurrent.futures.CancelledError, asyncio.CancelledError):
            raise self._lose("broke off") from None
        except Exception as error:  # any exception of the remote Python
            raise RenderError(
                f"{self._title} cannot take jobs ({type(error).__name__}: {_first_line(error)})"
            ) from None

    def call(self, method: str, *arguments: Any, should_stop: Callable[[], bool] | None = None) -> Any:
        """Call a method of the actor and return its result; None if the call was given up.

        With `should_stop`, the call ends when that returns True; a partial result is then waited for briefly.

        Raises
        ------
        DeviceFailure
            When the connection breaks, or the worker does not answer.
        ClrenderError
            Any that the method raises.
        """
        try:
            return self._call(method, arguments, should_stop)
        except DeviceFailure:
            if should_stop is None or not should_stop():
                raise
            return None

    def _call(self, method: str, arguments: Sequence[Any], should_stop: Callable[[], bool] | None) -> Any:
        if self._actor is None:
            if should_stop is None:  # the call was given up while connecting
                return None
            raise DeviceFailure(f"{self._title} is not connected")
        future = self._begin(method, *arguments)
        question: _Future | None = None
        heard, stopped = time.monotonic(), 0.0
        while not future.done():
            now = time.monotonic()
            if should_stop is None and self._given_up.is_set():
                return None
            if stopped and now - stopped > _STOP_SECONDS:
                return None
            if should_stop is not None and not stopped and should_stop():
                stopped = now
                self._begin("stop")
            if self._moved():
                raise self._lose("broke off")
            if question is None and now - heard > _ASK_SECONDS:
                question, asked = self._begin("state"), now
            if question is not None and question.done():
                self._hear(question)
                question, heard = None, now
            elif question is not None and now - asked > ANSWER_SECONDS:
                self._questions, self._asked = [question], now
                self.lost += 1
                raise DeviceFailure(f"{self._title} has not answered for {ANSWER_SECONDS:g} s")
            concurrent.futures.wait([future], _WAIT)
        return self._hear(future)

    @property
    def _title(self) -> str:
        assert self._peer is not None
        return self._peer.title

    def _moved(self) -> bool:
        """Whether the worker was restarted at another address."""
        assert self._peer is not None
        now = self._peers().get(self._peer.key)
        return now is not None and now.address != self._peer.address

    def _begin(self, method: str, *arguments: Any) -> _Future:
        try:
            answer = getattr(self._actor, method)(*arguments)
            loop: Any = self._client.loop
            return asyncio.run_coroutine_threadsafe(_awaited(answer), loop.asyncio_loop)
        except RuntimeError:  # Dask already knows that the actor is lost, or has closed the client
            raise self._lose("broke off") from None

    def _hear(self, future: _Future) -> Any:
        """Result of a call that is done; also updates the state."""
        try:
            answer = future.result()
        except (Exception, asyncio.CancelledError):
            raise self._lose("broke off") from None
        self._on_answer()
        if isinstance(answer, ClrenderError):
            raise type(answer)(f"{self._title}: {answer}")
        if isinstance(answer, State):
            self.state = answer
        elif isinstance(answer, Answer):
            self.state = answer.state
            return answer.value
        return answer

    def _lose(self, how: str) -> DeviceFailure:
        """Record that the worker's process appears to be gone; returns the error to raise."""
        assert self._peer is not None
        self.lost += 1
        self._actor = self._holder = None
        self._broken = self._peer.address, time.monotonic()
        return DeviceFailure(f"{self._title} {how}")


async def _awaited(answer: Any) -> Any:
    return await answer


def _first_line(error: Exception) -> str:
    return str(error).split("\n", maxsplit=1)[0]
