"""What a chapter needs from its notebook: load, say, show, warn, record.

The only module that knows notebooks. Everything shown goes out as a display with a MIME bundle, so
that Jupyter and the report show the same; what a report must know besides travels in the same
outputs as `application/vnd.sensorbook+json`, and nothing is written to disk.
"""

from __future__ import annotations

import base64
import dataclasses
import html
import json
import math
import numbers
import re
import string
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from IPython.display import display

import sensorbook
from sensorbook.errors import InputError, Problem
from sensorbook.recordings.clock import duration_words
from sensorbook.recordings.recording import html_table

MIME = "application/vnd.sensorbook+json"
DPI = 192  # pixels an inch; shown at 96, so that figures stay crisp on dense screens


def load(folder: str, sensor: str, kind: str) -> tuple[sensorbook.Device, tuple]:
    """The device and its recordings of one kind, longest first; shows a table of them.

    The table's display also holds the device, the recordings' provenance and what was found in
    them, from which a report fills its record.
    """
    device = sensorbook.load(folder)
    runs = tuple(device.runs(sensor, kind))
    if not runs:
        raise InputError(
            Problem(
                "device.toml",
                "[[recording]]",
                f"no {sensor} recording of kind {kind!r}",
                f'add one with sensor = "{sensor}" and kind = "{kind}"',
            )
        )
    inputs = [run.provenance() for run in runs]
    found = [
        {
            "file": f.file,
            "message": f"{f.where}: {f.message}" + (f": {f.remedy}" if f.remedy else ""),
        }
        for run in runs
        for f in run.findings
    ]
    about = {
        "device": {
            "id": device.id,
            "name": device.name,
            "model": device.model,
            "serial": device.serial,
            "spec": device.spec.get(sensor, {}),
        },
        "inputs": inputs,
        "warnings": found,
    }
    header, rows = _images_table(inputs) if kind == "images" else _series_table(inputs)
    table = html_table(rows, header=header)
    plain = "\n".join(", ".join(row) for row in rows)
    _publish({"text/html": table + "".join(map(_warning_html, found)), "text/plain": plain}, about)
    _refuse_unknown(runs)
    return device, runs


def _series_table(inputs: Iterable[Mapping]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    rows = [
        (
            i["file"],
            "unknown" if i["duration_s"] is None else duration_words(i["duration_s"]),
            "unknown" if i["rate_hz"] is None else f"{i['rate_hz']:.6g} Hz",
            f"{i['samples']:,}".replace(",", "\u202f"),
        )
        for i in inputs
    ]
    return ("Recording", "Duration", "Rate", "Samples"), rows


def _images_table(inputs: Iterable[Mapping]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    sees = {"earth": "Earth", "sun": "Sun", "both": "Earth and Sun"}
    rows = [
        (
            i["file"],
            f"{i['samples']}",
            f"{i['camera']['width']} × {i['camera']['height']} px",
            f"{i['camera']['focal_px']:.6g} px",
            sees[i["camera"].get("sees", "both")],
        )
        for i in inputs
    ]
    return ("Recording", "Images", "Size", "Focal length", "Looks for"), rows


def _refuse_unknown(runs: Iterable[sensorbook.Recording]) -> None:
    """Raises `Refusal` where a declaration says that it does not know what every result hangs on."""
    for run in runs:
        guessed = run.declaration.get("guessed", {})
        unknown = [key.replace("_", " ") for key, sure in guessed.items() if sure == "not known"]
        if unknown:
            what = " and ".join(unknown)
            raise sensorbook.Refusal(
                f"{run.file}: the {what} of the {run.sensor} cannot be told from the file, and every "
                "result hangs on it.",
                f"Write a device.toml (sensorbook new DIR --from {Path(run.file).name}), give the "
                f"{what} there, and delete it from its `guessed`.",
            )


def load_rests(folder: str, sensor: str, thermal_record: str) -> tuple[sensorbook.Device, tuple]:
    """The device and its rests made ready for an analysis of their noise, longest first.

    Each is on an even time base and less the bias's change with temperature, where the record of the
    thermal chapter (a path, or "") has a model. What was done is said, what is odd is warned of.
    """
    source, runs = load(folder, sensor, "static")
    rests = []
    for run in runs:
        even, done = run.evenly_sampled()
        for sentence in done:
            warn(sentence, run.file)
        rests.append(even)
    ready = _without_thermal(rests, thermal_record)
    for rest in ready:
        moves = 0.0 if rest.temperature is None else rest.temperature.std()
        if moves > 0.5 and not _thermal(thermal_record):
            warn(
                f"The temperature moves by {moves:.1f} °C rms in this rest: slow noise may be thermal.",
                rest.file,
            )
    return source, ready


def _thermal(thermal_record: str) -> dict | None:
    """`thermal` of the thermal chapter's record; with a reason where it was refused."""
    found = read_record(thermal_record) or {}
    if found.get("status") == "refused":
        return {"reason": found["reason"]}
    return found.get("results", {}).get("thermal")


def _without_thermal(runs: Iterable[sensorbook.Recording], thermal_record: str) -> tuple:
    """The recordings less their bias's change with temperature; says what was done, and warns."""
    from sensorbook.apply import remove_thermal

    ready = []
    for run in runs:
        done, sentence, warning = remove_thermal(run, _thermal(thermal_record))
        if not ready:
            say("{text}", text=sentence)
        if warning:
            warn(warning, run.file)
        ready.append(done)
    return tuple(ready)


def load_runs(
    folder: str, sensor: str, kind: str, thermal_record: str
) -> tuple[sensorbook.Device, tuple, tuple]:
    """The device, its recordings to calibrate with, and those kept for checking (`check = true`).

    Each is less the bias's change with temperature, where the record of the thermal chapter has a
    model. What was done is said.
    """
    source, runs = load(folder, sensor, kind)
    once: dict[tuple, Any] = {}
    for run in runs:
        first = once.setdefault((run.sha256, run.declaration.get("table")), run)
        if first is not run:
            warn(f"It is the same as {first.file} and counts once.", run.file)
    ready = _without_thermal(once.values(), thermal_record)
    kept = tuple(r for r in ready if not r.declaration.get("check"))
    if not kept:
        raise sensorbook.Refusal(
            f"Every {kind} recording of the {sensor} is kept for checking (check = true): none is left "
            "to calibrate with.",
            "Take check = true out of one of them.",
        )
    return source, kept, tuple(r for r in ready if r.declaration.get("check"))


def calibrated(recording: sensorbook.Recording, *records: str) -> sensorbook.Recording:
    """The recording corrected with the first of some chapters' calibrations; says what was done.

    `records` are paths, "" for a chapter that there is none of; a chapter that was refused is none.
    """
    from sensorbook.apply import correct

    for found in filter(None, map(read_record, records)):
        result = found.get("results", {}).get("calibration") or {}
        if found["status"] != "complete" or not result.get("method"):
            continue
        corrected, steps, notes, _ = correct(recording, {"calibration": result})
        say("The {sensor} is corrected with the {steps} of this device.",
            sensor=recording.sensor, steps=" and the ".join(steps))  # fmt: skip
        for note in notes:
            warn(note[0].upper() + note[1:] + ".", recording.file)
        return corrected
    say("No calibration of the {sensor} is at hand: it stays as it is.", sensor=recording.sensor)
    return recording


def also_read(runs: Iterable[sensorbook.Recording]) -> None:
    """Says which recordings were read beside the chapter's own, and records them as inputs."""
    inputs = [run.provenance() for run in runs]
    named = ", ".join(f"{i['file']} ({i['sensor']})" for i in inputs)
    if inputs:
        _publish(
            {
                "text/markdown": f"Read beside it: {escape(named)}.",
                "text/plain": f"Read beside it: {named}.",
            },
            {"inputs": inputs},
        )


def at_reference(calibration: Any, thermal_record: str, temperature: Any) -> Any:
    """The calibration with the temperature that its bias holds at.

    That of the thermal model whose change was taken out of the recordings, else the mean of the rests'
    own (P,) `temperature`; None where neither is known.
    """
    if calibration.temperature or temperature is None:
        return calibration
    thermal = _thermal(thermal_record) or {}
    own = round(float(np.mean(temperature)), 1)
    reference = thermal.get("x", {}).get("reference_temperature", own)
    return dataclasses.replace(calibration, reference_temperature=reference)


def say(template: str, **values: Any) -> None:
    """Shows a sentence in Markdown.

    `template` is our own text; with `values`, its `{fields}` are filled: numbers by their format,
    everything else as inert text, whatever Markdown or HTML it holds. Without values the text is
    shown as it is, so that a sentence from the data always belongs into a value.
    """
    text = _Inert().vformat(template, (), values) if values else template
    _publish({"text/markdown": text, "text/plain": html.unescape(text)})


def show(item: Any, caption: str = "", alt: str | None = None, thumbnail: bool = False) -> None:
    """Shows a figure (matplotlib Figure or Axes) or a table (anything with an HTML form).

    A figure needs a caption or an alternative text; `thumbnail` puts it on the device's index.
    """
    figure = item if hasattr(item, "savefig") else getattr(item, "figure", None)
    if figure is not None:
        _show_figure(figure, caption, caption if alt is None else alt, thumbnail)
        return
    table = item.to_html(border=0, na_rep="–") if hasattr(item, "to_html") else item._repr_html_()
    if caption:
        note = f"<caption>{html.escape(caption)}</caption>"
        table, done = re.subn(r"<table\b[^>]*>", lambda m: m[0] + note, table, count=1)
        if not done:
            table += f"<p>{html.escape(caption)}</p>"
    _publish({"text/html": table, "text/plain": str(item)})


def warn(message: str, file: str = "") -> None:
    """Shows a warning and records it; `file` names the recording it is about."""
    warning = {"file": file, "message": message}
    plain = f"Warning: {file + ': ' if file else ''}{message}"
    _publish({"text/html": _warning_html(warning), "text/plain": plain}, {"warnings": [warning]})


def record(results: Mapping[str, Any], warnings: Iterable[Mapping[str, str]] = ()) -> None:
    """Records the chapter's results, in the names and units of results.json.

    NumPy scalars and arrays become plain numbers and lists; NaN and infinity are refused with
    the key that holds them.
    """
    listed = [{"file": w.get("file", ""), "message": w["message"]} for w in warnings]
    _publish(
        {"text/plain": "Results recorded: " + ", ".join(results)},
        {"results": _plain(results, "results"), "warnings": listed},
    )


def read_record(path: str) -> dict[str, Any] | None:
    """The record of a chapter that this one needs; None where the path is empty."""
    if not path:
        return None
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            Problem(
                path,
                "",
                f"this record cannot be read ({error})",
                "render its chapter first, or give an empty path to go on without it",
            )
        ) from None


def signed(value: float, half: float) -> str:
    """A number with the half of its interval, to two digits of that: "−0.59 ± 0.31"."""
    if not (math.isfinite(half) and half > 0):
        return f"{value:.4g}".replace("-", "−")
    places = max(0, 1 - math.floor(math.log10(half)))
    rounded = round(value, places) + 0.0  # no minus zero
    return f"{rounded:.{places}f} ± {half:.{places}f}".replace("-", "−")


def escape(text: str) -> str:
    """Text that stays inert in Markdown and in HTML: punctuation becomes character references."""
    line = "".join(c if c.isprintable() else " " for c in str(text)).strip()
    return "".join(f"&#{ord(c)};" if c in string.punctuation else c for c in line)


class _Inert(string.Formatter):
    """Formats numbers by their spec and makes everything else inert text."""

    def format_field(self, value: Any, format_spec: str) -> str:
        text = format(value, format_spec)
        return text if isinstance(value, numbers.Number) else escape(text)


def _show_figure(figure: Any, caption: str, alt: str, thumbnail: bool) -> None:
    import matplotlib.pyplot as plt

    from sensorbook.plots.drawing import drawn, encoded

    if not alt:
        raise ValueError("a figure needs a caption or an alternative text")
    image = drawn(figure, DPI)
    plt.close(figure)  # or the inline backend shows it a second time
    width, height = (round(pixels * 96 / DPI) for pixels in image.size)
    about = {"alt": alt, "caption": caption, "width": width, "height": height}
    if thumbnail:
        about["thumbnail"] = True
    coded = base64.b64encode(encoded(figure, image)).decode("ascii")
    _publish({"image/png": coded, "text/plain": alt}, metadata={"image/png": about})
    if caption:
        # Jupyter shows no caption of its own; a report has it below the figure and skips this.
        _publish(
            {"text/markdown": f"*{escape(caption)}*", "text/plain": caption},
            metadata={"sensorbook": "caption"},
        )


def _publish(
    bundle: dict[str, Any],
    record_: dict[str, Any] | None = None,
    metadata: dict[str, Any] | None = None,
) -> None:
    if record_ is not None:
        bundle = {**bundle, MIME: record_}
    display(bundle, raw=True, metadata=metadata or {})


def _warning_html(warning: Mapping[str, str]) -> str:
    place = f"<strong>{html.escape(warning['file'])}</strong>: " if warning["file"] else ""
    return f'<p class="warning">{place}{html.escape(warning["message"])}</p>'


def _plain(value: Any, key: str) -> Any:
    """`value` in JSON's own types; `key` is the path to it, for the error's sake."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v, f"{key}.{k}") for k, v in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple):
        return [_plain(v, f"{key}[{i}]") for i, v in enumerate(value)]
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{key} is {value}: record null and say why instead")
        return value
    raise TypeError(f"{key} is a {type(value).__name__}: only numbers, text, lists and tables")
