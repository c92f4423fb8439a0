"""Devices rendered by the workers of a Dask cluster: the same step as here, `Job` → `Record`.

The devices' folders and the report tree must be where every worker sees them, under the same path. A
worker's own process has threads, from which nothing must be forked: each of its threads has one warm
process beside it, in which `serve` runs.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from sensorbook.errors import InputError, Problem
from sensorbook.reporting.device import Job, Record
from sensorbook.reporting.forks import die_with
from sensorbook.reporting.work import Said, told_of

RETRIES = 3  # of a device whose process died; a lost worker's devices go to others in any case
CONNECT = 10  # s

Done = Callable[[int, Record], None]
_thread = threading.local()


def on_cluster(address: str, given: Sequence[Job], said: Said, done: Done) -> None:
    """Renders devices on the cluster whose scheduler is at `address`; tells of each as it is done.

    A device whose worker is lost goes to another one, where what was finished is not rendered anew.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        mend = "pip install 'sensorbook[cluster]'"
        raise InputError(
            Problem("--cluster", "", "needs Dask's distributed, which is not installed", mend)
        ) from None
    for part in ("", ".client", ".comm", ".core"):  # what they log is told by us, once
        logging.getLogger(f"distributed{part}").setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        line = " ".join(str(error).split())
        raise InputError(
            Problem(
                "--cluster", repr(address), f"no scheduler answers ({line})",
                "give the address that dask scheduler prints, such as tcp://10.0.0.1:8786",
            )
        ) from None  # fmt: skip
    with client:
        workers = len(client.scheduler_info(n_workers=-1)["workers"])
        said.line(f"{address}: {workers} workers" if workers else f"{address}: waiting for workers")
        said.more(len(given))
        numbers = {
            client.submit(_render, _sent(job), pure=False, retries=RETRIES): number
            for number, job in enumerate(given)
        }
        try:
            for future in as_completed(list(numbers), loop=client.loop):
                number = numbers.pop(future)
                done(number, _received(future, given[number], said))
                future.release()
        except BaseException:
            client.cancel(list(numbers))
            raise


def _sent(job: Job) -> dict[str, Any]:
    paths = {"path": os.path.abspath(job.path), "out": os.path.abspath(job.out)}
    return dataclasses.asdict(job) | paths


def _received(future: Any, job: Job, said: Said) -> Record:
    """A device's record, after all that its worker told is told."""
    try:
        told, record = future.result()
    except CancelledError:
        raise InputError(
            Problem("--cluster", "", "the scheduler was lost",
                    "start it again: the same command then goes on where this one ended")
        ) from None  # fmt: skip
    except Exception as error:  # whatever Dask lost it to
        line = f"{job.path}: lost on the cluster ({' '.join(f'{type(error).__name__}: {error}'.split())})"
        said.problem(line)
        said.step(job.path, "lost", None)
        return Record(None, problems=(line,))
    ends: Counter[str] = Counter()
    took = 0.0
    for what, *arguments in told:
        if what == "step":
            ends[arguments[1]] += 1
            took += arguments[2] or 0.0
        elif what != "more":
            # As the user named the tree, which the worker was told in full.
            getattr(said, what)(arguments[0].replace(os.path.abspath(job.out), job.out))
    name = record["found"]["device"]["id"] if record["found"] else job.path
    ended = ", ".join(f"{number} {status}" for status, number in ends.items())
    said.step(name, ended or "nothing to render", took or None)
    seconds = {(sensor, slug): took for sensor, slug, took in record["seconds"]}
    return Record(**record | {"seconds": seconds, "problems": tuple(record["problems"])})


# ---- on the worker ----


def _render(job: dict[str, Any]) -> tuple[list, dict[str, Any]]:
    """On a worker: what is told of a device, and its record."""
    process = getattr(_thread, "process", None)
    if process is None or process.poll() is not None:
        process = _thread.process = subprocess.Popen(
            [sys.executable, "-c", "from sensorbook.reporting.cluster import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
    told: list = []
    try:
        print(json.dumps(job), file=process.stdin, flush=True)
        for line in process.stdout:
            what, *arguments = json.loads(line)
            if what == "record":
                return told, arguments[0]
            told.append([what, *arguments])
    except OSError:  # the pipe broke
        pass
    raise RuntimeError(f"the process that renders {Path(job['path']).name} died")


def serve() -> None:
    """In a worker's warm process: takes a job a line from standard input, and answers in lines."""
    from sensorbook.reporting.run import here

    die_with(os.getppid())
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever else prints does not get between the lines

    class Answering:
        """Stands for `work.Said`."""

        def __getattr__(self, name: str) -> Callable[..., None]:
            return lambda *arguments: print(
                json.dumps([name, *arguments]), file=answers, flush=True
            )

    said = Answering()

    def done(number: int, record: Record) -> None:
        seconds = [[*key, took] for key, took in record.seconds.items()]
        said.record(dataclasses.asdict(record) | {"seconds": seconds})

    for line in sys.stdin:
        given = json.loads(line)
        try:
            here([Job(**given | {"only": tuple(given["only"])})], 1, said, done)
        except OSError as error:  # a full disk, say, which another worker would find full, too
            said.problem(told_of(error))
            done(0, Record(None))
