"""Calls of one worker's process, each with limits of time, and whether it is worth calling."""

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

    from clrender.cluster.dask_cluster import Peer

__all__ = ["Connection"]

_Future = concurrent.futures.Future[Any]

ANSWER_SECONDS: float = 15.0
"""A worker whose process answers nothing for so long counts as lost until it answers again."""
_ASK_SECONDS: Final = 1.0
"""In a call that takes longer the worker is asked how far it is, and as often."""
_STOP_SECONDS: Final = 0.8
"""What a worker gets to send what it has when the render is to end: Ctrl-C is answered within a second."""
_WAIT: Final = 0.2
"""From one look at what else happens, while a call is out, to the next: a thousand threads must not keep this busy."""
_ANEW_SECONDS: Final = 2.0
"""Between two questions to a worker that owes an answer. Over a network that was cut, an old connection takes minutes
to come back; each question may have a new one."""
_MOST_QUESTIONS: Final = 8
_FORGET_SECONDS: Final = 10.0
"""After which an address that broke off is called again, if the scheduler still knows it."""


class Connection:
    """The connection with a worker: an actor in its process, once there is one.

    Parameters
    ----------
    client : distributed.Client
    spec : tuple or None
        As of `RemoteRenderer`.
    peers : callable
        Gives the workers that the scheduler knows now.
    on_answer : callable
        Told of each answer.

    Attributes
    ----------
    state : State
        The last that is known.
    lost : int
        How often the worker broke off, or did not answer.
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
        self._holder: Any = None  # Dask's future of the actor, which lives as long as that
        self._given_up = threading.Event()
        self._broken: tuple[str, float] | None = None
        self._questions: list[_Future] = []
        self._asked = 0.0

    def give_up(self) -> None:
        """Nobody waits any more for what it is doing, unless that is a unit."""
        self._given_up.set()

    def close(self) -> None:
        """Dask drops the actor when nobody holds it here."""
        self._given_up.set()
        for question in self._questions:
            question.cancel()
        self._actor = self._holder = None

    def leads_to(self, peer: Peer) -> bool:
        """Whether the actor is in this very process."""
        return self._actor is not None and self._peer is not None and self._peer.address == peer.address

    def is_open(self, peer: Peer) -> bool:
        """Whether nothing speaks against calling: this process did not break off, and owes no answer."""
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
        """Have an actor in this worker's process.

        Raises
        ------
        DeviceFailure
            It does not answer.
        RenderError
            It cannot have one.
        """
        if self.leads_to(peer):
            return
        self._questions, self._broken, self._actor, self._peer = [], None, None, peer
        # By itself first: a class that a worker cannot load would end its process, which may not be ours alone
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
        """Dask's future of a function's result on the worker, and nowhere else."""
        assert self._peer is not None
        try:
            return self._client.submit(
                function, *arguments, key=f"clrender-{uuid.uuid4().hex}", workers=[self._peer.address],
                allow_other_workers=False, pure=False, retries=0, actor=actor,
            )  # fmt: skip
        except (
            Exception
        ):  # the client closes itself when it has lost the scheduler, with an error of each version's own
            raise self._lose("cannot be reached any more") from None

    def _await(self, future: Any) -> bool:
        """Wait for one of Dask's futures; gives whether it is done."""
        begun = time.monotonic()
        while not future.done():
            if self._given_up.is_set():
                return False
            if self._moved() or time.monotonic() - begun > ANSWER_SECONDS:
                raise self._lose("did not take the job")
            time.sleep(_WAIT / 8)
        return True

    def _result(self, get: Callable[..., Any]) -> Any:
        """What one of Dask's futures that is done came to."""
        try:
            return get(timeout=ANSWER_SECONDS)
        except (OSError, concurrent.futures.CancelledError, asyncio.CancelledError):
            raise self._lose("broke off") from None
        except Exception as error:  # of whatever Python is there
            raise RenderError(
                f"{self._title} cannot take jobs ({type(error).__name__}: {_first_line(error)})"
            ) from None

    def call(self, method: str, *arguments: Any, should_stop: Callable[[], bool] | None = None) -> Any:
        """What a method of the actor gives; None where nobody waits for that any more.

        With `should_stop` it is waited for until that says yes, and then a moment for what there is, if anything.

        Raises
        ------
        DeviceFailure
            The worker broke off, or does not answer.
        ClrenderError
            As its method raises.
        """
        try:
            return self._call(method, arguments, should_stop)
        except DeviceFailure:
            if should_stop is None or not should_stop():
                raise
            return None

    def _call(self, method: str, arguments: Sequence[Any], should_stop: Callable[[], bool] | None) -> Any:
        if self._actor is None:
            if should_stop is None:  # it was given up while it was to be met
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
        """Whether the worker was started anew."""
        assert self._peer is not None
        now = self._peers().get(self._peer.key)
        return now is not None and now.address != self._peer.address

    def _begin(self, method: str, *arguments: Any) -> _Future:
        try:
            answer = getattr(self._actor, method)(*arguments)
            loop: Any = self._client.loop
            return asyncio.run_coroutine_threadsafe(_awaited(answer), loop.asyncio_loop)
        except RuntimeError:  # Dask knows already that the actor is lost, or has closed the client
            raise self._lose("broke off") from None

    def _hear(self, future: _Future) -> Any:
        """What came of a call."""
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
        """The worker's process is gone, as far as one can see from here."""
        assert self._peer is not None
        self.lost += 1
        self._actor = self._holder = None
        self._broken = self._peer.address, time.monotonic()
        return DeviceFailure(f"{self._title} {how}")


async def _awaited(answer: Any) -> Any:
    return await answer


def _first_line(error: Exception) -> str:
    return str(error).split("\n", maxsplit=1)[0]
