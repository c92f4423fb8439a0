"""The chapters, in reading order: one row each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"
INERTIAL_AND_MAGNETIC = ("accelerometer", "gyroscope", "magnetometer")
ATTITUDE = "attitude"  # stands in a sensor's place for a chapter over several of them


@dataclass(frozen=True)
class Chapter:
    """One notebook that is run for every sensor with recordings of its kind, or for itself alone.

    Parameters
    ----------
    slug : names its page and record, and `--only`
    notebook : its file
    title : as the reports show it
    kind : kind of recording it reads; "" for a chapter that needs no device
    sensors : sensors it is for; none for a chapter that needs no device, `ATTITUDE` for one over several
    needs : chapters whose records it reads, as the parameters `<slug>_record`: "<slug>" of its own
        sensor, "<sensor>/<slug>" of another
    result : key of its main result under `sensors.<sensor>` in results.json, or under `attitude`; ""
        for none there
    reads : sensor whose recordings of that kind it reads; "" for those of its own
    """

    slug: str
    notebook: Path
    title: str
    kind: str
    sensors: tuple[str, ...]
    needs: tuple[str, ...]
    result: str
    reads: str = ""

    @property
    def needs_device(self) -> bool:
        """False where it has no recording to read: such a chapter stands in the book alone."""
        return bool(self.kind)

    def needed(self, sensor: str) -> Iterator[tuple[str, str]]:
        """Sensor and slug of each chapter whose record it reads where it is run for `sensor`."""
        for need in self.needs:
            other, _, slug = need.rpartition("/")
            yield other or sensor, slug


CHAPTERS = (
    Chapter(
        slug="thermal",
        notebook=NOTEBOOKS / "01_thermal_calibration.ipynb",
        title="Thermal calibration",
        kind="thermal",
        sensors=INERTIAL_AND_MAGNETIC,
        needs=(),
        result="thermal",
    ),
    Chapter(
        slug="psd",
        notebook=NOTEBOOKS / "02_power_spectral_density.ipynb",
        title="Power spectral density",
        kind="static",
        sensors=INERTIAL_AND_MAGNETIC,
        needs=("thermal",),
        result="psd",
    ),
    Chapter(
        slug="allan",
        notebook=NOTEBOOKS / "03_allan_deviation.ipynb",
        title="Allan deviation",
        kind="static",
        sensors=INERTIAL_AND_MAGNETIC,
        needs=("thermal",),
        result="allan",
    ),
    Chapter(
        slug="noise",
        notebook=NOTEBOOKS / "04_noise_identification.ipynb",
        title="Noise identification",
        kind="static",
        sensors=INERTIAL_AND_MAGNETIC,
        needs=("thermal",),
        result="noise",
    ),
    Chapter(
        slug="curve_fits",
        notebook=NOTEBOOKS / "05_curve_fits.ipynb",
        title="Curve fits and slopes",
        kind="static",
        sensors=INERTIAL_AND_MAGNETIC,
        needs=("thermal",),
        result="curve_fits",
    ),
    Chapter(
        slug="six_position",
        notebook=NOTEBOOKS / "06_six_position.ipynb",
        title="Six-position calibration",
        kind="six_position",
        sensors=("accelerometer",),
        needs=("thermal",),
        result="calibration",
    ),
    Chapter(
        slug="multi_position",
        notebook=NOTEBOOKS / "07_multi_position.ipynb",
        title="Multi-position calibration",
        kind="positions",
        sensors=("accelerometer",),
        needs=("thermal",),
        result="calibration",
    ),
    Chapter(
        slug="gyroscope_calibration",
        notebook=NOTEBOOKS / "08_gyroscope_calibration.ipynb",
        title="Gyroscope calibration without a rate table",
        kind="positions",
        sensors=("gyroscope",),
        needs=("thermal",),
        result="calibration",
    ),
    Chapter(
        slug="magnetometer",
        notebook=NOTEBOOKS / "09_magnetometer.ipynb",
        title="Magnetometer calibration",
        kind="rotation",
        sensors=("magnetometer",),
        needs=("thermal",),
        result="calibration",
    ),
    Chapter(
        slug="sensor_principles",
        notebook=NOTEBOOKS / "10_sensor_principles.ipynb",
        title="Sensor principles and error sources",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="representations",
        notebook=NOTEBOOKS / "11_representations_and_frames.ipynb",
        title="Representations and frames",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="attitude_sensors",
        notebook=NOTEBOOKS / "12_attitude_sensors.ipynb",
        title="Attitude sensors",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="attitude_from_vectors",
        notebook=NOTEBOOKS / "13_attitude_from_vectors.ipynb",
        title="Attitude from vectors",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="horizon_sun_camera",
        notebook=NOTEBOOKS / "14_horizon_and_sun_camera.ipynb",
        title="Horizon and Sun camera",
        kind="images",
        sensors=("camera",),
        needs=(),
        result="images",
    ),
    Chapter(
        slug="camera_accuracy",
        notebook=NOTEBOOKS / "15_camera_accuracy.ipynb",
        title="Camera attitude by orbit and angle",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="camera_scene",
        notebook=NOTEBOOKS / "16_camera_scene.ipynb",
        title="Camera scene",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="star_camera",
        notebook=NOTEBOOKS / "17_star_camera.ipynb",
        title="Star camera",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="propagation",
        notebook=NOTEBOOKS / "18_propagation.ipynb",
        title="Propagation",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="aided_attitude",
        notebook=NOTEBOOKS / "19_aided_attitude.ipynb",
        title="Gyroscope aided by a reference",
        kind="",
        sensors=(),
        needs=(),
        result="",
    ),
    Chapter(
        slug="integrated_attitude",
        notebook=NOTEBOOKS / "20_integrated_attitude.ipynb",
        title="Integrated attitude",
        kind="trajectory",
        sensors=(ATTITUDE,),
        needs=(
            "gyroscope/noise",
            "gyroscope/thermal",
            "gyroscope/gyroscope_calibration",
            "accelerometer/multi_position",
            "accelerometer/six_position",
            "magnetometer/magnetometer",
            "camera/horizon_sun_camera",
        ),
        result="methods",
        reads="gyroscope",
    ),
)
