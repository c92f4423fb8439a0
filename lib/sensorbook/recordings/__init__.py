"""Device folders and their files → immutable `Recording` arrays in SI units.

Only this package reads inputs. `load(folder).gyroscope.static` is a recording; `check(folder)` gives
every problem and finding.
"""

from sensorbook.recordings.device import Device, check, check_device, from_declaration, load
from sensorbook.recordings.images import Images
from sensorbook.recordings.recording import Finding, Recording, Segment
from sensorbook.recordings.tables import Table, open_table

__all__ = [
    "Device",
    "Finding",
    "Images",
    "Recording",
    "Segment",
    "Table",
    "check",
    "check_device",
    "from_declaration",
    "load",
    "open_table",
]
