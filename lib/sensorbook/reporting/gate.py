"""The gate of a production line: what keeps a device from passing, in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sensorbook.reporting.cameras import cameras_alone
from sensorbook.reporting.words import check_words


def gate(found: dict[str, Any]) -> Iterator[str]:
    """A line for each limit of a results.json that is failed or cannot be decided; none to pass.

    A device without limits does not pass: a gate that checks nothing would let everything through.
    """
    name = found["device"]["id"]
    if not found["checks"] and cameras_alone(found):
        yield f"{name}: cannot be decided: it is a camera, on which no limits can be set"
    elif not found["checks"]:
        yield f"{name}: cannot be decided: no limits given — add a [spec] table to its device.toml"
    for check in found["checks"]:
        if check["verdict"] != "pass":
            yield f"{name}: {check_words(check, found)}"
