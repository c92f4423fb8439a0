"""Calls side by side, each in a process of its own that is forked from this one.

A fork takes milliseconds and has every import already; what it changes or leaks ends with it. A crash
or a call that hangs ends its fork alone.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import heapq
import os
import pickle
import signal
import sys
from collections.abc import Callable
from itertools import count
from multiprocessing import connection, get_context, parent_process
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple

import threadpoolctl

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_MOST = 1024  # slots: bytes that every pipe holds
_PATIENCE = 5.0  # s, for a process to end its own forks

Tell = Callable[[Any], None]


class Slots:
    """How many calls may be at work at once, over all processes forked from here.

    A pipe that holds a byte for each, as GNU make's job server.
    """

    def __init__(self, number: int):
        self._out, self._into = os.pipe()
        os.set_blocking(self._out, False)
        os.write(self._into, b"." * min(number, _MOST))

    def fileno(self) -> int:
        return self._out

    def take(self) -> bool:
        """Takes a slot; False where none is free."""
        with contextlib.suppress(BlockingIOError):
            return bool(os.read(self._out, 1))
        return False

    def give(self) -> None:
        os.write(self._into, b".")

    def close(self) -> None:
        os.close(self._out)
        os.close(self._into)


class Ended:
    """What a call gives whose process ended before it could answer.

    Attributes
    ----------
    signal : number of the signal that ended it; None where it ended by itself
    """

    def __init__(self, exitcode: int | None):
        self.signal = -exitcode if exitcode is not None and exitcode < 0 else None


class _Running(NamedTuple):
    process: BaseProcess
    then: Callable[[Any], None]
    heard: Callable[[Any], None]
    took: bool  # a slot, which is to be given back


class Forks:
    """Calls to make; what they give goes on to functions here.

    Parameters
    ----------
    slots : which each needs one of
    own : calls at a time that need none: 1 in a process that took a slot itself, and waits
    nested : whether the calls have forks of their own, which they are then asked to end
    """

    def __init__(self, slots: Slots, own: int = 0, nested: bool = False):
        self._slots, self._own, self._nested = slots, own, nested
        self._context = get_context("fork")
        self._waiting: list[tuple[Any, int, tuple]] = []
        self._running: dict[connection.Connection, _Running] = {}
        self._number = count()

    def add(
        self,
        order: Any,
        call: Callable[[Tell], Any],
        then: Callable[[Any], None],
        heard: Callable[[Any], None] = lambda told: None,
    ) -> None:
        """Adds a call; of those that wait, the one of the lowest `order` is made first.

        Parameters
        ----------
        call : made in the fork; takes a function that tells something before the end
        then : gets what the call gives, or `Ended`; an exception of the call is raised by `run`
        heard : gets what it tells on the way
        """
        heapq.heappush(self._waiting, (order, next(self._number), (call, then, heard)))

    def run(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Makes all calls, and those that are added on the way; when one raises, the others end.

        `meanwhile` is called in this process once the first have been started.
        """
        if parent_process() is not None:
            signal.signal(signal.SIGTERM, _stop)
        try:
            self._start_waiting()
            meanwhile()
            while self._waiting or self._running:
                self._start_waiting()
                listened = [*self._running, *([self._slots] if self._waiting else [])]
                for ready in connection.wait(listened):
                    if ready is not self._slots:
                        self._hear(ready)
        finally:
            self._waiting.clear()
            begun = {
                r: running.process for r, running in self._running.items() if running.process.pid
            }
            for process in begun.values():
                process.terminate() if self._nested else process.kill()
            for reader, process in begun.items():
                process.join(_PATIENCE)
                process.kill()
                self._reap(reader)

    def _start_waiting(self) -> None:
        """Starts what waits, as far as there are slots."""
        while self._waiting and (slot := self._slot()) is not None:
            self._start(slot)

    def _slot(self) -> bool | None:
        """Whether a slot was taken for the next call; None where it must wait."""
        if sum(not running.took for running in self._running.values()) < self._own:
            return False
        return True if self._slots.take() else None

    def _start(self, took: bool) -> None:
        _, _, (call, then, heard) = heapq.heappop(self._waiting)
        reader, writer = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_answer, args=(call, writer, os.getpid()))
        # Known before it is there: an interrupt that comes as it starts would leave it running.
        self._running[reader] = _Running(process, then, heard, took)
        process.start()
        writer.close()

    def _hear(self, reader: connection.Connection) -> None:
        running = self._running[reader]
        try:
            what, given = reader.recv()
        except (EOFError, ConnectionError):
            running.process.join()
            what, given = "gave", Ended(running.process.exitcode)
        if what == "told":
            running.heard(given)
            return
        self._reap(reader)
        if what == "raised":
            raise given
        running.then(given)

    def _reap(self, reader: connection.Connection) -> None:
        running = self._running.pop(reader)
        running.process.join()
        running.process.close()
        reader.close()
        if running.took:
            self._slots.give()


def _answer(call: Callable[[Tell], Any], writer: connection.Connection, parent: int) -> None:
    """In the fork: makes the call and sends what it tells, and what it gives or raises."""
    os.setpgid(
        0, 0
    )  # an interrupt from the keyboard is for the first process, which ends the others
    die_with(parent)
    # Threads of BLAS on small arrays cost ten times what they gain, and calls run side by side.
    threadpoolctl.threadpool_limits(1)
    gc.set_threshold(20_000, 20, 20)  # it ends before most garbage matters
    try:
        answer = "gave", call(lambda told: writer.send(("told", told)))
    except Exception as error:
        answer = "raised", error
    try:
        writer.send(answer)
    except (pickle.PicklingError, TypeError, AttributeError):
        writer.send(("raised", RuntimeError(repr(answer[1]))))


def _stop(*_: Any) -> None:
    raise SystemExit(1)  # so that forks of this fork are ended, too


def die_with(parent: int) -> None:
    """Ends this process when its parent does, however that ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


def apart(call: Callable[[], Any]) -> Any:
    """What a call gives when it is made in a fork of its own."""
    given: list[Any] = []
    slots = Slots(1)
    try:
        forks = Forks(slots)
        forks.add(0, lambda tell: call(), given.append)
        forks.run()
    finally:
        slots.close()
    return given[0]
