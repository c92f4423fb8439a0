"""Results for other systems: one module a target format, one row of `FORMATS` each."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from sensorbook.errors import InputError, Problem


@dataclass(frozen=True)
class Format:
    """A target.

    Attributes
    ----------
    name : as the command names it
    module : of this package; its `render` makes the file's content from the results, text or bytes. It
        is imported only when called for: the command's help needs the table alone
    what : what the file is, and for whom
    needs : which results of which sensors it is made of
    suffix : of the file's name, as its readers expect it
    binary : whether the content is bytes
    """

    name: str
    module: str
    what: str
    needs: str
    suffix: str
    binary: bool = False


CALIBRATION = "a calibration or thermal model of any sensor"
NOISE = "noise of accelerometer and gyroscope"

FORMATS = {
    one.name: one
    for one in (
        Format("kalibr", "kalibr", "imu.yaml of Kalibr", NOISE, ".yaml"),
        Format("allan-ros", "allan_ros", "imu.yaml as of allan_variance_ros", NOISE, ".yaml"),
        Format(
            "imu-utils", "imu_utils", "parameters as of imu_utils", f"{NOISE}, Allan curves", ".yaml"
        ),
        Format("yaml", "calibration_yaml", "calibrations and thermal models", CALIBRATION, ".yaml"),
        Format("c-header", "c_header", "the same for C and C++", CALIBRATION, ".h"),
        Format(
            "ardupilot", "ardupilot", "calibrations as ArduPilot's parameters",
            "calibration of any sensor", ".param",
        ),
        Format(
            "px4", "px4", "the same of PX4, for QGroundControl", "calibration of any sensor", ".params"
        ),
        Format("ros-params", "ros_params", "ROS 2 parameters of nodes and drivers",
               "calibration or noise of any sensor", ".yaml"),
        Format("imu-calib", "imu_calib", "calibration for ROS' imu_calib",
               "calibration of the accelerometer", ".yaml"),
        Format("csv", "csv_table", "every number with its interval", "any result", ".csv"),
        Format("allan-csv", "allan_csv", "Allan curves as a table", "Allan curve of any sensor", ".csv"),
        Format("mat", "mat", "every result for MATLAB and Octave", "any result", ".mat", binary=True),
    )
}  # fmt: skip


def export(results: str | Path, name: str) -> str | bytes:
    """The content of a target format, text or bytes, from a results.json.

    Parameters
    ----------
    results : path of the results.json
    name : of a format, a key of `FORMATS`

    Raises
    ------
    InputError : with everything that the format needs and the results do not give
    """
    from sensorbook.export.source import read_results

    return _render(FORMATS[name])(read_results(results))


def listed(results: str | Path | None = None) -> Iterator[str]:
    """Lines of a table of the formats; with a results.json, whether it suffices for each."""
    head = Format("format", "", "what it is", "what it needs", "file")
    if results is not None:
        from sensorbook.export.source import read_results

        source, width = read_results(results), max(map(len, FORMATS))
        for one in FORMATS.values():
            try:
                _render(one)(source)
                state = "ready"
            except InputError as error:
                state = str(error.problems[0]).removeprefix(f"{results}: ")
                if len(error.problems) > 1:  # any of which may be what to mend
                    state = f"needs {one.needs}; {state}"
            yield f"{one.name:{width}}  {state}"
        return
    rows = [(f.name, f.suffix, f.what, f.needs) for f in (head, *FORMATS.values())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def _render(one: Format):
    return import_module(f"{__name__}.{one.module}").render


def write(path: str | Path, content: str | bytes, source: str | Path) -> None:
    """Writes an export aside, then moves it to its place; `source`, what it is made of, is kept."""
    from sensorbook.reporting.tree import Tree

    target = Path(path).resolve()  # through a link, which then stays one

    def wrong(message: str, mend: str) -> InputError:
        return InputError(Problem(str(path), "", message, mend))

    try:
        if target == Path(source).resolve():
            raise wrong("is the results.json itself", "name another file")
        if target.exists() and not target.is_file():
            raise wrong("is not a file", "name one, or leave -o out for standard output")
        with Tree(target.parent) as tree:
            if isinstance(content, str):
                tree.write(target, content)
            else:
                aside = tree.aside / "export"
                aside.write_bytes(content)
                os.replace(aside, target)
    except OSError as error:
        raise wrong(
            f"cannot be written: {error.strerror}", "name a file in a folder you may write to"
        ) from None
