"""Files damaged at random in every format, what the readers make of them, and whether that is right.

A mutant is right where it is refused with `InputError`, or gives what was written. Where a format has
no checksum, bytes that were overwritten may show as other values: `Format.tells` says which changes
can be told. A mutant is never right where the readers raise anything else, take more than
`LONGEST`, end their process, or give fewer or more rows than were written. Workers are processes of
their own, since a C library may hang or crash on damage.
"""

from __future__ import annotations

import contextlib
import gzip
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from recordings.test_formats import WRITERS

LONGEST = 10.0  # s
ROWS = 2000  # of text, more than the 64 KiB that find its layout
OPERATIONS = ("flip", "remove", "cut", "insert", "repeat", "zero")
NAMES = ("t", "gx", "gy", "gz", "temp")
_DIGITS = (2, 5, 5, 5, 3)


def columns() -> dict[str, np.ndarray]:
    """A rest at 100 Hz: s, deg/s, °C."""
    rng = np.random.default_rng(11)
    gyroscope = rng.normal(size=(3, ROWS)).round(5)
    temperature = (25 + 0.1 * rng.normal(size=ROWS)).round(3)
    return dict(zip(NAMES, (np.arange(ROWS) / 100, *gyroscope, temperature), strict=True))


# ---- formats ----


def csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    rows = zip(*columns.values(), strict=True)
    body = [",".join(f"{v:.{d}f}" for v, d in zip(r, _DIGITS, strict=True)) for r in rows]
    path.write_text("\n".join([",".join(columns), *body]) + "\n")


def csv_gz(path: Path, columns: dict[str, np.ndarray]) -> None:
    csv(path, columns)
    path.write_bytes(gzip.compress(path.read_bytes(), mtime=0))


def fixed_width(path: Path, columns: dict[str, np.ndarray]) -> None:
    widths = (5, 8, 8, 8, 8)  # negative angular rates touch the cell before them
    rows = zip(*columns.values(), strict=True)
    lines = ["".join(f"{v:{w}.{d}f}" for v, w, d in zip(r, widths, _DIGITS, strict=True))
             for r in rows]  # fmt: skip
    path.write_text("\n".join(lines) + "\n")


def npz(path: Path, columns: dict[str, np.ndarray]) -> None:
    with path.open("wb") as stream:
        np.savez(stream, **columns)


def npz_compressed(path: Path, columns: dict[str, np.ndarray]) -> None:
    with path.open("wb") as stream:
        np.savez_compressed(stream, **columns)


def hdf5_plain(path: Path, columns: dict[str, np.ndarray]) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values


def matlab73(path: Path, columns: dict[str, np.ndarray]) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[name] = values[None]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as stream:
        stream.write(head)


@dataclass(frozen=True)
class Format:
    """A format, and which damage it lets a reader tell.

    Attributes
    ----------
    write : writes columns to a path
    tells : "all" where a checksum covers every value; "length" where a value overwritten is but
        another value, while bytes lost or added are told; "lines" for text, where a line
        more, less or other is but another line, while lines that were not touched stay as they are
    spread : most values that one byte can change: a row of a database, more by compression
    """

    write: Callable[[Path, dict[str, np.ndarray]], None]
    tells: str
    spread: float = 1.0


FORMATS = {
    "csv": Format(csv, "lines"),
    "csv.gz": Format(csv_gz, "all"),
    "fixed-width": Format(fixed_width, "lines"),
    "npz": Format(npz, "all"),
    "npz-compressed": Format(npz_compressed, "all"),
    "parquet": Format(WRITERS["parquet"], "length", np.inf),
    "feather": Format(WRITERS["feather"], "length", np.inf),
    "hdf5": Format(hdf5_plain, "length"),
    "hdf5-gzip": Format(WRITERS["hdf5"], "length"),
    "matlab5": Format(WRITERS["matlab5"], "length"),
    "matlab5-compressed": Format(WRITERS["matlab5-compressed"], "all"),
    "matlab7.3": Format(matlab73, "length"),
    "netcdf3": Format(WRITERS["netcdf3"], "length"),
    "netcdf4": Format(WRITERS["netcdf4"], "length"),
    "sqlite": Format(WRITERS["sqlite"], "length", len(NAMES)),
}


# ---- damage ----


@dataclass(frozen=True)
class Mutant:
    """A damaged file: bytes [start, stop) of the original were changed, lost, or followed by others."""

    content: bytes
    operation: str
    start: int
    stop: int


def mutant(whole: bytes, operation: str, rng: np.random.Generator) -> Mutant:
    """A file damaged somewhere: at its ends, where most formats keep what matters, more often."""
    size = len(whole)
    end = rng.choice(["anywhere", "anywhere", "head", "tail"])
    near = int(rng.integers(min(size, 512)))
    at = {"anywhere": int(rng.integers(size)), "head": near, "tail": size - 1 - near}[end]
    longest = min(size - at, max(size // 4, 1))
    run = int(min(np.exp(rng.uniform(0, np.log(longest + 1))), longest))
    before, after = whole[:at], whole[at + run :]
    if operation == "flip":
        content, places = (
            bytearray(whole),
            at + rng.integers(min(size - at, 64), size=rng.integers(1, 5)),
        )
        for place in places:
            content[place] ^= int(rng.integers(1, 256))
        return Mutant(bytes(content), operation, int(min(places)), int(max(places)) + 1)
    if operation == "remove":
        return Mutant(before + after, operation, at, at + run)
    if operation == "cut":
        return Mutant(before, operation, at, size)
    if operation == "insert":
        more = rng.integers(256, size=rng.integers(1, 64), dtype=np.uint8).tobytes()
        return Mutant(before + more + whole[at:], operation, at, at)
    if operation == "repeat":
        return Mutant(whole[: at + run] + whole[at:], operation, at, at + run)
    return Mutant(before + bytes(run) + after, "zero", at, at + run)


# ---- what the readers make of it ----


def outcome(path: Path) -> tuple[str, object]:
    """("refused", message), ("read", columns by name) or ("traceback", its text) of a file."""
    import sensorbook
    from sensorbook import InputError
    from sensorbook.recordings import check, open_table
    from sensorbook.recordings.tables import table_names

    kind, told = "refused", ""
    try:
        try:
            table_names(path)
            table = open_table(path)
            table.parse(range(len(table.names)))
            told = [(name, table.column(k)) for k, name in enumerate(table.names)]
            kind = "read"
        except InputError as error:
            told = str(error)
        with contextlib.suppress(InputError):
            sensorbook.load(path)
        check(path)
    except Exception:
        return "traceback", traceback.format_exc()
    return kind, told


def fault(form: Format, whole: bytes, written: list, made: Mutant, got: list) -> str:
    """What is silently wrong in the columns read from a mutant, or ""."""
    # Fewer than five lines without names do not tell how wide the columns are.
    few = made.content.count(b"\n") < 5 and not whole.startswith(b"t,")
    if form.tells == "lines" and made.operation == "cut" and few:
        return ""
    if len(got) != len(written):
        return f"{len(got)} columns of {len(written)}"
    if form.tells != "lines":
        counts = {len(values) for _, values in got}
        if counts != {ROWS}:
            return f"{sorted(counts)} rows of {ROWS}"
    differing = _differing(written, got, form)
    if form.tells == "lines":
        return _fault_of_text(whole, made, written, got)
    if not differing:
        return ""
    if form.tells == "all" or made.operation not in ("flip", "zero"):
        return f"{differing} values differ"
    most = form.spread * (made.stop - made.start + 1)
    return "" if differing <= most else f"{differing} values differ, of {most:g} touched"


def _differing(written: list, got: list, form: Format) -> int:
    """Number of values that differ; columns renamed are taken in their order, and count as one value."""
    there = dict(got)
    spare = [values for name, values in got if name not in dict(written)]
    count = 0
    for name, values in written:
        other = there.get(name)
        if other is None:
            other, count = (spare.pop(0) if spare else np.array([])), count + 1
        count += (
            int((_numbers(other) != values).sum()) if len(other) == len(values) else len(values)
        )
    return count


def _fault_of_text(whole: bytes, made: Mutant, written: list, got: list) -> str:
    """Lines that were not touched must stand as they were, before and after those that were."""
    first = whole[: made.start].count(b"\n") - whole.startswith(b"t,")
    last = whole[: made.stop].count(b"\n") - whole.startswith(b"t,")
    rows = np.stack([_numbers(values) for _, values in got], axis=1)
    original = np.stack([values for _, values in written], axis=1)
    # pandas' parser is exact to 1 ulp.
    before, after = original[: max(first, 0)], original[last + 1 :]
    if made.operation == "cut":
        line = whole[: made.start].rpartition(b"\n")[2]
        rest = whole[made.start :].partition(b"\n")[0]
        at_end = not line.strip() or not rest
        # A few lines do not tell whether digits are fixed.
        if first <= 21 and whole.startswith(b"t,") and b"," not in rest:
            return ""
        if not at_end:
            return f"cut within a line, {len(rows)} rows"
        return "" if np.array_equal(rows, original[: len(rows)]) else "other rows"
    if len(rows) < len(before) + len(after):
        return f"{len(rows)} rows, {len(before) + len(after)} were not touched"
    same = np.allclose(rows[: len(before)], before, rtol=3e-16, atol=0)
    same &= np.allclose(rows[len(rows) - len(after) :], after, rtol=3e-16, atol=0)
    return "" if same else "rows that were not touched differ"


def _numbers(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind in "iuf":
        return values.astype(float)

    def number(value) -> float:
        try:
            return float(value)
        except (TypeError, ValueError):
            return np.nan

    return np.array([number(value) for value in values], dtype=float)


# ---- many of them ----


@dataclass(frozen=True)
class Told:
    """What became of a mutant: "refused", "same", "other" (values that no reader can tell), or a fault."""

    form: str
    number: int
    operation: str
    kind: str
    text: str = ""

    @property
    def is_fault(self) -> bool:
        return self.kind in ("traceback", "hang", "crash", "silent")


def run(
    seed: int, count: int, workers: int = 2, only: tuple[str, ...] = tuple(FORMATS)
) -> list[Told]:
    """Tells of `count` mutants, the formats and operations in turn; each depends on its number alone."""
    names = list(only)
    jobs = [(names[k % len(names)], k // len(names)) for k in range(count)]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        shares = [
            pool.submit(lambda k: list(_share(Path(folder), k, seed, jobs[k::workers])), k)
            for k in range(workers)
        ]
        return sorted((t for s in shares for t in s.result()), key=lambda t: (t.form, t.number))


def _share(folder: Path, worker: int, seed: int, jobs: list[tuple[str, int]]) -> Iterator[Told]:
    """Runs jobs in a process, and in a new one after each that ends or hangs it."""
    done = 0
    while done < len(jobs):
        here, there = get_context("spawn").Pipe()
        place = folder / f"{worker}-{done}"
        place.mkdir()
        process = get_context("spawn").Process(
            target=_work, args=(there, place, seed, jobs[done:]), daemon=True
        )
        process.start()
        there.close()
        if not here.poll(120) or not here.recv():  # s, for imports and the originals
            process.kill()
            raise RuntimeError("the worker could not begin: the files before damage must be read")
        try:
            while done < len(jobs):
                form, number = jobs[done]
                operation = OPERATIONS[number % len(OPERATIONS)]
                if not here.poll(LONGEST):
                    process.kill()
                    yield Told(form, number, operation, "hang")
                    done += 1
                    break
                told = here.recv()
                done += 1
                yield told
        except EOFError:
            process.join()
            yield Told(form, number, operation, "crash", f"exit code {process.exitcode}")
            done += 1
        process.kill()
        process.join()


def content(form: str, number: int, seed: int, whole: bytes) -> Mutant:
    """The mutant of this number."""
    rng = np.random.default_rng([seed, list(FORMATS).index(form), number])
    return mutant(whole, OPERATIONS[number % len(OPERATIONS)], rng)


def _work(pipe, folder: Path, seed: int, jobs: list[tuple[str, int]]) -> None:
    warnings.simplefilter("ignore")  # sums of damaged values overflow
    originals = {}
    for form in {form for form, _ in jobs}:
        path = folder / f"{form}-original"
        FORMATS[form].write(path, columns())
        kind, got = outcome(path)
        if kind != "read":
            pipe.send(False)
            raise AssertionError(f"{form}: {got}")
        originals[form] = path.read_bytes(), got
    pipe.send(True)
    path = folder / "log.dat"
    for form, number in jobs:
        whole, written = originals[form]
        made = content(form, number, seed, whole)
        path.write_bytes(made.content)
        start = time.monotonic()
        kind, got = outcome(path)
        text = got if isinstance(got, str) else ""
        if kind == "read":
            text = fault(FORMATS[form], whole, written, made, got)
            same = _differing(written, got, FORMATS[form]) == 0 if len(got) == len(NAMES) else False
            kind = "silent" if text else "same" if same else "other"
        if time.monotonic() - start > LONGEST:
            kind = "hang"
        pipe.send(Told(form, number, made.operation, kind, text))
