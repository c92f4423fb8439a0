"""From bare recordings to a declaration: sensors, columns, units, rate and kind, each with a reason.

`guess_files` says what files hold; `new_device` writes it as a commented `device.toml`.
"""

from sensorbook.guessing.certainty import Guess
from sensorbook.guessing.declaration import device_toml, guess_rows, new_device, told
from sensorbook.guessing.guess import Guessed, GuessedRecording, device_id, guess_files

__all__ = [
    "Guess",
    "Guessed",
    "GuessedRecording",
    "device_id",
    "device_toml",
    "guess_files",
    "guess_rows",
    "new_device",
    "told",
]
