"""Results for other systems: one module a target format, one row of `FORMATS` each."""

from __future__ import annotations

from pathlib import Path

from sensorbook.errors import InputError, Problem
from sensorbook.export import allan_csv, ardupilot, c_header, calibration_yaml, kalibr, px4
from sensorbook.export.source import read_results
from sensorbook.reporting.tree import Tree

FORMATS = {  # name: makes the file's text from the results
    "kalibr": kalibr.render,
    "allan-csv": allan_csv.render,
    "yaml": calibration_yaml.render,
    "c-header": c_header.render,
    "ardupilot": ardupilot.render,
    "px4": px4.render,
}


def export(results: str | Path, name: str) -> str:
    """The text of a target format, from a results.json.

    Parameters
    ----------
    results : path of the results.json
    name : of a format, a key of `FORMATS`

    Raises
    ------
    InputError : with everything that the format needs and the results do not give
    """
    return FORMATS[name](read_results(results))


def write(path: str | Path, text: str, source: str | Path) -> None:
    """Writes an export aside, then moves it to its place; `source`, what it is made of, is kept."""
    target = Path(path).resolve()  # through a link, which then stays one

    def wrong(message: str, mend: str) -> InputError:
        return InputError(Problem(str(path), "", message, mend))

    try:
        if target == Path(source).resolve():
            raise wrong("is the results.json itself", "name another file")
        if target.exists() and not target.is_file():
            raise wrong("is not a file", "name one, or leave -o out for standard output")
        with Tree(target.parent) as tree:
            tree.write(target, text)
    except OSError as error:
        raise wrong(
            f"cannot be written: {error.strerror}", "name a file in a folder you may write to"
        ) from None
