"""Calls side by side, each in a process of its own that is forked from this one.

A fork takes milliseconds and has every import already; what it changes or leaks ends with it. A crash
or a call that hangs ends its fork alone.
"""

from __future__ import annotations

import ctypes
import heapq
import os
import signal
import sys
from collections.abc import Callable
from itertools import count
from multiprocessing import connection, get_context
from typing import Any

import threadpoolctl

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


class Ended:
    """What a call gives whose process ended before it could answer.

    Attributes
    ----------
    signal : number of the signal that ended it; None where it ended by itself
    """

    def __init__(self, exitcode: int | None):
        self.signal = -exitcode if exitcode is not None and exitcode < 0 else None


class Forks:
    """Calls to make, at most `jobs` at a time; what they give goes on to a function here.

    An exception of a call is raised again here, which ends all others.
    """

    def __init__(self, jobs: int):
        self.jobs = jobs
        self._context = get_context("fork")
        self._waiting: list[tuple[Any, int, Callable, Callable]] = []
        self._running: dict[connection.Connection, tuple[Any, Callable]] = {}
        self._number = count()

    def add(self, order: Any, call: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Adds a call; of those that wait the one of the lowest `order` is made first."""
        heapq.heappush(self._waiting, (order, next(self._number), call, then))

    def run(self) -> None:
        """Makes all calls, and those that are added on the way."""
        try:
            while self._waiting or self._running:
                while self._waiting and len(self._running) < self.jobs:
                    self._start()
                for ready in connection.wait(list(self._running)):
                    self._end(ready)
        finally:
            for process, _ in self._running.values():
                process.kill()
            for process, _ in self._running.values():
                process.join()
            self._running.clear()

    def _start(self) -> None:
        _, _, call, then = heapq.heappop(self._waiting)
        reader, writer = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_answer, args=(call, writer, os.getpid()))
        process.start()
        writer.close()
        self._running[reader] = process, then

    def _end(self, reader: connection.Connection) -> None:
        process, then = self._running[reader]
        try:
            raised, given = reader.recv()
        except EOFError:
            process.join()
            raised, given = False, Ended(process.exitcode)
        process.join()
        del self._running[reader]
        reader.close()
        if raised:
            raise given
        then(given)


def _answer(call: Callable[[], Any], writer: connection.Connection, parent: int) -> None:
    """In the fork: makes the call and sends what it gives or raises."""
    # An interrupt from the keyboard reaches all processes at once; the first ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _die_with(parent)
    # Threads of BLAS on small arrays cost ten times what they gain, and calls run side by side.
    threadpoolctl.threadpool_limits(1)
    try:
        answer = False, call()
    except Exception as error:
        answer = True, error
    writer.send(answer)


def _die_with(parent: int) -> None:
    """Ends this process when its parent does, however that ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


def apart(call: Callable[[], Any]) -> Any:
    """What a call gives when it is made in a fork of its own."""
    given: list[Any] = []
    forks = Forks(1)
    forks.add(0, call, given.append)
    forks.run()
    return given[0]
