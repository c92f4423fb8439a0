"""What several chapters of one run compute of the same readings: the first leaves it for the others."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Of the run whose chapters are forked from this process, and written by nothing else; None for none.
folder: Path | None = None


def shared(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorates a function that gives the same for the same arguments, and takes long to.

    Nothing is kept of what it raises, nor outside of a run.
    """

    @functools.wraps(function)
    def looked_up(*arguments: Any, **named: Any) -> Any:
        if folder is None:
            return function(*arguments, **named)
        asked = pickle.dumps((function.__qualname__, arguments, sorted(named.items())))
        place = folder / hashlib.sha256(asked).hexdigest()
        with contextlib.suppress(OSError):
            return pickle.loads(place.read_bytes())
        found = function(*arguments, **named)
        aside = place.with_suffix(f".{os.getpid()}")
        with contextlib.suppress(OSError):  # full: the others compute it, too
            aside.write_bytes(pickle.dumps(found, protocol=pickle.HIGHEST_PROTOCOL))
            os.replace(aside, place)
        return found

    return looked_up
