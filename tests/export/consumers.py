"""How the targets read their files, written anew from their sources, and what is said of bad results."""

from __future__ import annotations

import pytest

from sensorbook import InputError


def read_param(text):
    """As AP_Param reads a file: pieces of at most 98 characters, whatever is in them."""
    found = {}
    for line in text.splitlines(keepends=True):
        for start in range(0, len(line), 98):
            piece = line[start : start + 98]
            fields = piece.replace(",", " ").replace("=", " ").split()
            if not piece.startswith("#") and len(fields) > 1:
                assert len(fields) == 2
                assert fields[0] not in found
                found[fields[0]] = float(fields[1])
    return found


def read_params(text):
    """As QGroundControl reads a file: lines of five columns between tabs that do not begin with #."""
    found = {}
    for line in text.split("\n"):
        columns = line.split("\t")
        if not line.startswith("#") and len(columns) == 5:
            vehicle, component, name, value, kind = columns
            assert (vehicle, component, kind) == ("1", "1", "9")
            assert name not in found
            found[name] = float(value)
    return found


def said(exported, name, change):
    """The lines said of changed results, from the key on."""
    with pytest.raises(InputError) as caught:
        exported(name, change)
    return [line.split("results.json: ", 1)[1] for line in str(caught.value).splitlines()]
