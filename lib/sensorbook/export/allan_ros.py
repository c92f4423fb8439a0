"""imu.yaml as allan_variance_ros writes it, for Kalibr and what reads its files.

Source: ori-drs/allan_variance_ros, scripts/analysis.py (`get_intercept` and what it writes to
imu.yaml). Keys, units and convention are Kalibr's.
"""

from __future__ import annotations

from sensorbook.export.kalibr import imu_yaml
from sensorbook.export.source import Entry

TOPIC = "'/sensors/imu'"  # the tool's own default
ABOUT = """\
#
# allan_variance_ros has the same two numbers in the same units, also the largest of three axes, but reads
# them off the Allan deviation: noise_density where a line of slope -1/2 through all cluster times below
# 10 s passes 1 s, random_walk where one of slope +1/2 through all cluster times passes 3 s. Whatever
# other noise there is goes into these lines: its random_walk is a number even where the curve does not
# rise, where this file has an upper bound and says so.
"""


def render(results: Entry) -> str:
    """imu.yaml; raises `InputError` with everything it needs and the results do not give."""
    return imu_yaml(results, "allan_variance_ros", TOPIC, ABOUT)
