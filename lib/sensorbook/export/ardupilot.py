"""ArduPilot's compass parameters, as a file of NAME,VALUE lines (.param, .parm).

Sources: ArduPilot, libraries/AP_Compass: AP_Compass_Backend.cpp (`rotate_field`, `correct_field`),
AP_Compass.cpp (parameters, `configured`, `have_scale_factor`), CompassCalibrator.cpp
(`fit_acceptable`); libraries/AP_Arming/AP_Arming.cpp (compass checks); libraries/AP_Param/AP_Param.cpp
(`parse_param_line`, `read_param_defaults_file`).
"""

from __future__ import annotations

import math

from sensorbook.errors import Problem
from sensorbook.export.magnetometer import Group, Iron, comments, parameters, read_iron
from sensorbook.export.source import Entry

TARGET = "ArduPilot"
MILLIGAUSS = 1e-7  # T
OFFSETS_MAX = 1800.0  # mG: COMPASS_OFFS_MAX as it is by default; longer offsets do not arm
OFFSETS_MIN = 2.0**-23  # mG: what is shorter is zero to its `is_zero`, and does not arm
DIAGONAL = (0.2, 5.0)  # outside of these, ArduPilot's own calibration is refused
OFF_DIAGONAL = 1.0

HEAD = (
    "Parameters of ArduPilot's first compass: of the second they are COMPASS_OFS2_X, COMPASS_DIA2_X,"
    " COMPASS_ODI2_X, COMPASS_SCALE2 and so on, of the third COMPASS_OFS3_X and so on.",
    "",
)
FORMULA = (
    "",
    "ArduPilot computes (AP_Compass_Backend::correct_field), in milligauss, 1 mG = 1e-7 T:",
    "field = M * (COMPASS_SCALE * (raw + COMPASS_OFS))",
    "M = [[DIA_X, ODI_X, ODI_Y], [ODI_X, DIA_Y, ODI_Z], [ODI_Y, ODI_Z, DIA_Z]]",
    "Hence COMPASS_OFS = -hard_iron in milligauss, as ArduPilot adds it; M = soft_iron;"
    " COMPASS_SCALE scales nothing, as soft_iron holds the scale: it is 1, with which ArduPilot may"
    " compare the field with the world magnetic model, or 0 where the field's strength is not known.",
    "",
    "Axes are those of the recording, in the order x, y, z. ArduPilot rotates a reading before it"
    " corrects it: COMPASS_ORIENT (external compass) or AHRS_ORIENTATION (internal) must be 0, none,"
    " unless the recording was made in the vehicle's axes. Otherwise rotate: with R from the axes of"
    " the recording to the vehicle's, COMPASS_OFS = -R * hard_iron and M = R * soft_iron * transpose(R).",
)


def render(results: Entry) -> str:
    """The file; raises `InputError` as `read_iron` does, and for what ArduPilot does not accept."""
    iron = read_iron(results, TARGET)
    values = parameters(
        TARGET,
        (
            Group("COMPASS_OFS_{}", iron.hard_iron, -MILLIGAUSS),
            Group("COMPASS_DIA_{}", iron.diagonal, 1.0, *DIAGONAL),
            Group("COMPASS_ODI_{}", iron.off_diagonal, 1.0, -OFF_DIAGONAL, OFF_DIAGONAL),
        ),
        _unarmed(iron),
    )
    values["COMPASS_SCALE"] = 0.0 if iron.entry.get("field_known").value is False else 1.0
    lines = comments((*HEAD, *iron.head, *FORMULA))
    return "\n".join([*lines, *(f"{name},{value!r}" for name, value in values.items())]) + "\n"


def _unarmed(iron: Iron) -> list[Problem]:
    """Why ArduPilot would not arm with these offsets, if it would not."""
    entry = iron.entry.at("hard_iron")
    length = math.hypot(*(entry.number() for entry in iron.hard_iron)) / MILLIGAUSS
    if length > OFFSETS_MAX:
        return entry.wrong(
            f"is {length:.6g} mG long, and ArduPilot does not arm above {OFFSETS_MAX:g} mG "
            "(COMPASS_OFFS_MAX)",
            "move the magnetometer away from magnets and iron, and record it again",
        ).problems
    if length < OFFSETS_MIN:
        return entry.wrong(
            f"is {length:.6g} mG long, which ArduPilot takes for a compass that is not calibrated"
        ).problems
    return []
