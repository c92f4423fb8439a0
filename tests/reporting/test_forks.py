"""Forks: what they give, tell and raise, how many there are, and that none is left."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import threadpoolctl

from sensorbook.reporting.forks import Ended, Forks, Slots, apart


@pytest.fixture
def slots():
    made = Slots(2)
    yield made
    made.close()


def test_what_calls_give_and_tell_arrives_and_order_counts(slots):
    slots.take()  # one at a time
    forks, given, heard = Forks(slots), [], []
    for number in (3, 1, 2):
        forks.add(number, lambda tell, n=number: (tell(-n), n * 10)[1], given.append, heard.append)
    forks.run()
    assert given == [10, 20, 30]
    assert heard == [-1, -2, -3]


def test_a_large_answer_arrives_whole():
    assert apart(lambda: np.arange(3_000_000)).sum() == 3_000_000 * 2_999_999 // 2


def test_an_interrupt_meanwhile_ends_a_fork_whose_large_answer_waits(slots, tmp_path):
    def call(tell):
        (tmp_path / "began").write_text(str(os.getpid()))
        return np.arange(3_000_000)  # more than a pipe holds: nobody reads it

    def meanwhile():
        while not (tmp_path / "began").is_file():
            time.sleep(0.01)
        raise KeyboardInterrupt

    forks = Forks(slots)
    forks.add(0, call, lambda given: None)
    with pytest.raises(KeyboardInterrupt):
        forks.run(meanwhile)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "began").read_text()), 0)


def test_no_more_at_once_than_there_are_slots(slots, tmp_path):
    def call(tell):
        mine = tmp_path / str(os.getpid())
        mine.touch()
        time.sleep(0.1)
        at_once = len(list(tmp_path.iterdir()))
        mine.unlink()
        return at_once

    forks, given = Forks(slots), []
    for _ in range(6):
        forks.add(0, call, given.append)
    forks.run()
    assert len(given) == 6
    assert max(given) == 2


def test_a_call_may_add_others_and_slots_come_back(slots):
    forks, given = Forks(slots), []

    def then(value):
        given.append(value)
        if value < 5:
            forks.add(0, lambda tell: value + 1, then)

    forks.add(0, lambda tell: 0, then)
    forks.run()
    assert given == list(range(6))
    assert [slots.take() for _ in range(3)] == [True, True, False]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGALRM])
def test_a_process_that_is_ended_is_told_by_its_signal(slots, number):
    given = []
    forks = Forks(slots)
    forks.add(0, lambda tell: os.kill(os.getpid(), number), given.append)
    forks.add(1, lambda tell: "the other", given.append)
    forks.run()
    assert {type(item) for item in given} == {Ended, str}
    assert next(item for item in given if isinstance(item, Ended)).signal == number


def test_what_a_call_raises_is_raised_here_and_ends_the_others(slots, tmp_path):
    def sleeps(tell):
        (tmp_path / "pid").write_text(str(os.getpid()))
        time.sleep(60)

    def raises(tell):
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
            time.sleep(0.01)
        raise OSError(28, "No space left on device", "file")

    forks = Forks(slots)
    forks.add(0, sleeps, lambda given: None)
    forks.add(1, raises, lambda given: None)
    with pytest.raises(OSError, match="No space left") as caught:
        forks.run()
    assert (caught.value.errno, caught.value.filename) == (28, "file")
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_an_exception_that_cannot_be_sent_is_told_in_words(slots):
    class Local(Exception):
        pass

    def raises(tell):
        raise Local("odd")

    forks = Forks(slots)
    forks.add(0, raises, lambda given: None)
    with pytest.raises(RuntimeError, match=r"Local.*odd"):
        forks.run()


def test_nothing_of_a_fork_reaches_this_process(tmp_path):
    import matplotlib

    def changes():
        matplotlib.rcParams["lines.linewidth"] = 77
        os.chdir(tmp_path)
        random.seed(0)
        os.environ["CHANGED"] = "1"

    def state():
        return matplotlib.rcParams["lines.linewidth"], os.getcwd(), random.getstate()

    before = state()
    apart(changes)
    assert state() == before
    assert "CHANGED" not in os.environ


def test_blas_has_one_thread_in_a_fork():
    found = apart(threadpoolctl.threadpool_info)
    assert found
    assert {library["num_threads"] for library in found} == {1}


NESTED = """
import os, sys, time
from functools import partial
from sensorbook.reporting.forks import Forks, Slots
slots = Slots(2)
def inner(tell):
    open({pids!r}, "a").write(f"{{os.getpid()}}\\n")
    time.sleep(60)
def outer(tell):
    open({pids!r}, "a").write(f"{{os.getpid()}}\\n")
    forks = Forks(slots, own=1)
    for _ in range(2):
        forks.add(0, inner, lambda given: None)
    forks.run()
forks = Forks(slots, nested=True)
forks.add(0, outer, lambda given: None)
forks.run()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends the forks of what is killed")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_forks_of_forks_end_with_the_first_process(tmp_path, number):
    pids = tmp_path / "pids"
    first = subprocess.Popen(
        [sys.executable, "-c", NESTED.format(pids=str(pids))], stderr=subprocess.DEVNULL
    )
    _wait(lambda: pids.exists() and pids.read_text().count("\n") == 3)
    first.send_signal(number)
    first.wait(20)
    for pid in map(int, pids.read_text().split()):
        _wait(partial(_is_gone, pid))


def _is_gone(pid: int) -> bool:
    """Ended: no longer there, or only as an entry that its parent has yet to read."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def _wait(until) -> None:
    deadline = time.monotonic() + 30
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.02)
