"""PX4's magnetometer calibration, as a file of parameters that QGroundControl loads (.params).

Sources: PX4-Autopilot, src/lib/sensor_calibration/Magnetometer.hpp (`Correct`) and Magnetometer.cpp
(`set_offset`, `set_scale`, `set_offdiagonal`), src/modules/sensors/module.yaml (units and ranges);
QGroundControl, src/FactSystem/ParameterManager.cc (`readParametersFromStream`).
"""

from __future__ import annotations

from sensorbook.export.magnetometer import Group, comments, parameters, read_iron
from sensorbook.export.source import Entry

TARGET = "PX4"
GAUSS = 1e-4  # T
SCALE = (0.1, 3.0)
REAL32 = 9  # MAV_PARAM_TYPE_REAL32

HEAD = (
    "Onboard parameters for Vehicle 1",
    "",
    "Calibration of PX4's magnetometer 0, CAL_MAG0. It is that sensor's whose device ID stands in"
    " CAL_MAG0_ID, which PX4 sets when it first calibrates it; this file leaves it alone. Write"
    " CAL_MAG1 and so on where the ID is that of another. QGroundControl wants the vehicle's own ID"
    " in the first column.",
    "",
)
FORMULA = (
    "",
    "PX4 computes (calibration::Magnetometer::Correct), in gauss, 1 G = 1e-4 T:",
    "field = rotation * (M * (raw - OFF)), OFF = [XOFF, YOFF, ZOFF]",
    "M = [[XSCALE, XODIAG, YODIAG], [XODIAG, YSCALE, ZODIAG], [YODIAG, ZODIAG, ZSCALE]]",
    "Hence OFF = hard_iron in gauss, as PX4 subtracts it; M = soft_iron. raw is the reading with"
    " its compensation of power where CAL_MAG_COMP_TYP is not 0.",
    "Restart PX4 once the file is loaded: it takes up OFF (in gauss), the three SCALE and the three"
    " ODIAG each only where the vector is more than 0.01 away from what it has, which is 0, 1 and 0"
    " after a start. Smaller corrections may have no effect.",
    "",
    "Axes are those of the recording, in the order x, y, z, and must be those of PX4's topic"
    " sensor_mag. PX4 corrects first and rotates then, so that CAL_MAG0_ROT and SENS_BOARD_ROT"
    " stay. A recording made in other axes, such as the vehicle's, must be rotated back: with R from its"
    " axes to those of sensor_mag, OFF = R * hard_iron and M = R * soft_iron * transpose(R).",
    "",
    "Vehicle-Id Component-Id Name Value Type",
)


def render(results: Entry) -> str:
    """The file; raises `InputError` as `read_iron` does, and for what PX4 does not accept."""
    iron = read_iron(results, TARGET)
    values = parameters(
        TARGET,
        (
            Group("CAL_MAG0_{}OFF", iron.hard_iron, GAUSS),
            Group("CAL_MAG0_{}SCALE", iron.diagonal, 1.0, *SCALE),
            Group("CAL_MAG0_{}ODIAG", iron.off_diagonal),
        ),
    )
    rows = [f"1\t1\t{name}\t{value!r}\t{REAL32}" for name, value in values.items()]
    return "\n".join([*comments((*HEAD, *iron.head, *FORMULA)), *rows]) + "\n"
