"""What will weaken a result though the recording is readable, and the better recording to make.

For `sensorbook check`: the chapters measure such things themselves and say what followed from them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import replace

import numpy as np

from sensorbook.errors import InputError, Problem, Refusal
from sensorbook.recordings.clock import shuffled
from sensorbook.recordings.corruption import implausible
from sensorbook.recordings.motion import Blocks, of_field
from sensorbook.recordings.recording import Finding, Recording
from sensorbook.units import SENSOR_UNITS, field_unit

FEWEST = 1000  # samples that the noise chapters need
SLOW_STATIC = 10.0  # Hz; below, white noise and quantization fall into one slope
SLOW_POSITIONS = 20.0  # Hz; a motion between rests lasts some tenths of a second
COARSE_TURN = np.radians(2.0)  # rms from sample to sample; coning errors grow with its square
DRIFT = 1.0  # °C in a rest: at a usual 0.01 deg/s/°C more than a good MEMS' bias instability
SWEEP = 5.0  # °C: less does not determine a thermal model
SWIFT = 1.0  # °C/min: the die lags the housing, and heating and cooling part
MOST = 20_000  # readings of a rotation that are looked at
COMPARED = 200_000  # readings of a trajectory, at most, that are compared with its reference
VECTORS = {"accelerometer", "magnetometer"}  # which tell an attitude together
MOVED = np.radians(1.0)  # rad/s, far beyond any bias that wanders at rest


def advise(recording: Recording, calibrates_temperature: bool) -> tuple[Finding, ...]:
    """Findings on what could have been recorded better.

    Parameters
    ----------
    recording : as read
    calibrates_temperature : True where the device has a thermal recording of this sensor
    """
    found: list[Finding] = []

    def say(kind: str, message: str, remedy: str) -> None:
        found.append(Finding(recording.file, recording.sensor, kind, message, remedy))

    if recording.sensor not in SENSOR_UNITS or (
        recording.rate is None and recording.kind != "rotation"
    ):
        return ()
    rows = np.isfinite(recording.values).all(axis=1)
    rows[implausible(recording.values, recording.sensor)] = False  # told among the findings
    values = recording.values[rows]
    guessed = recording.declaration.get("guessed", {})
    if "not known" in guessed.values() or shuffled(recording.time):
        return ()  # nothing is computed before that is mended
    if recording.kind == "static" and len(values) < FEWEST:
        say("short", f"holds {len(values)} samples, and its noise needs {FEWEST}",
            "rest it for an hour or more")  # fmt: skip
        return tuple(found)
    if recording.kind == "rotation" and recording.sensor == "magnetometer":
        if not recording.declaration.get("check"):
            _directions(values, say)
        return tuple(found)
    if len(values) < 200:
        return ()
    if recording.kind in ("static", "thermal"):
        _moved(recording.sensor, values, say)
        if found:
            return tuple(found)
    if recording.kind == "static":
        _rest(recording, values, calibrates_temperature, say)
    elif recording.kind == "thermal":
        _sweep(recording, say)
    elif recording.kind == "positions" and recording.rate < SLOW_POSITIONS:
        say("rate", f"sampled at {recording.rate:.3g} Hz, its motions between rests are hardly seen",
            f"record positions at {SLOW_POSITIONS:g} Hz or more")  # fmt: skip
    elif recording.sensor == "accelerometer" and recording.kind in ("positions", "six_position"):
        _attitudes(recording, say)
    return tuple(found)


def lacks_gyroscope(recorded: Iterable[tuple[str | None, str | None]]) -> str:
    """Words for a trajectory that no gyroscope recorded; "" where one did, or where there is none.

    Parameters
    ----------
    recorded : sensor and kind of each recording of a device
    """
    sensors = sorted({sensor for sensor, kind in recorded if sensor and kind == "trajectory"})
    if not sensors or "gyroscope" in sensors:
        return ""
    *first, last = sensors
    held = f"{', '.join(first)} and {last}" if first else last
    return f"a trajectory needs a gyroscope of kind trajectory, and this one holds {held} alone"


def of_trajectory(
    recorded: Sequence[Recording], declared: Set[str], calibrated: bool
) -> tuple[list[Problem], list[Finding]]:
    """What the chapter on integrated attitude would reject, refuse or warn of, in its words.

    Parameters
    ----------
    recorded : a device's readable recordings of kind trajectory, longest first
    declared : sensors of all that are declared, readable or not, "camera" among them where there is one
    calibrated : True where the chapter takes out a calibration of the gyroscope's scale and axes,
        so that readings as they are say nothing of them
    """
    # Only here: reading a recording does not need the attitude.
    from sensorbook.attitude.agreement import agreement
    from sensorbook.attitude.preparation import motion, on_stamps, readings, reference_track
    from sensorbook.attitude.sources import sources
    from sensorbook.attitude.verdicts import judge

    problems: list[Problem] = []
    findings: list[Finding] = []

    def attempt(recording: Recording, method: Callable, *arguments):
        try:
            return method(*arguments)
        except InputError as error:
            problems.extend(error.problems)
        except Refusal as refusal:
            reason = refusal.reason.removeprefix(f"{recording.file}: ").rstrip(".")
            remedy = refusal.remedy.rstrip(".")
            findings.append(Finding(recording.file, recording.sensor, "coverage", reason, remedy))
        return None

    sure = [r for r in recorded if "not known" not in r.declaration.get("guessed", {}).values()]
    gyroscopes = [(r, attempt(r, readings, r)) for r in sure if r.sensor == "gyroscope"]
    references = [(r, attempt(r, reference_track, r)) for r in sure if r.sensor == "reference"]
    if gyroscopes and references and not calibrated:
        gyroscope, read = gyroscopes[0]
        same_file = [pair for pair in references if pair[0].file == gyroscope.file]
        reference, track = (same_file or references)[0]

        def compare() -> tuple[str, ...]:
            at, quaternion = on_stamps(read, track, motion(read))
            found = agreement(read.time, read.rate, at, quaternion, read.lost)
            return judge(found, read.time, read.rate, at, quaternion, read.lost)

        if read is not None and track is not None and len(read.time) <= COMPARED:
            for note in attempt(reference, compare) or ():
                findings.append(Finding(reference.file, "reference", "coverage", note.rstrip(".")))
    alone = not declared & {"reference", "camera"} and not declared >= VECTORS
    if alone and gyroscopes and gyroscopes[0][1] is not None:
        attempt(gyroscopes[0][0], sources, gyroscopes[0][1], dict.fromkeys(declared & VECTORS))
    if not problems:  # a wrong unit would ask for a rate that nothing needs
        known = [(recording, read.rate) for recording, read in gyroscopes if read is not None]
        findings += [found for each in known if (found := _coning(*each))]
    return problems, findings


def _coning(recording: Recording, rate: np.ndarray) -> Finding | None:
    turn = float(np.sqrt((rate**2).sum(axis=1).mean())) / recording.rate
    if turn <= COARSE_TURN:
        return None
    needed = recording.rate * turn / COARSE_TURN
    return Finding(
        recording.file,
        "gyroscope",
        "rate",
        f"turns by {np.degrees(turn):.1f}° rms from sample to sample: coning makes its integral drift",
        f"record at {needed:.0f} Hz or more, or move it more slowly",
    )


Say = Callable[[str, str, str], None]


def _attitudes(recording: Recording, say: Callable[[str, str, str], None]) -> None:
    """Rests that are lost, and directions that do not determine a calibration.

    A recording by itself: several runs of a device may be enough together.
    """
    # Only here: reading a recording does not need the calibrations.
    from sensorbook.calibration import find_faces, find_positions
    from sensorbook.calibration.known_directions import require_faces
    from sensorbook.calibration.model import FREE
    from sensorbook.calibration.multi_position import require_coverage
    from sensorbook.earth import STANDARD_GRAVITY

    try:
        if recording.kind == "positions":
            found = find_positions([recording], (), STANDARD_GRAVITY)
            require_coverage(found.positions, STANDARD_GRAVITY, FREE[9])
        else:
            found, up = find_faces([recording], STANDARD_GRAVITY)
            require_faces(up)
    except Refusal as refusal:
        say("coverage", refusal.reason.rstrip("."), refusal.remedy.rstrip("."))
        return
    except InputError as error:
        for problem in error.problems:
            say("unit", problem.message, problem.mend)
        return
    for label, reason in found.aside:
        say("moved", f"rest {label} does not serve: {reason}", "repeat it")


def _moved(sensor: str, values: np.ndarray, say: Say) -> None:
    remedy = "fasten it, record again, or declare the kind of recording that it is"
    if sensor == "gyroscope":
        blocks = Blocks.of(values)
        means = blocks.means
        away = np.quantile(np.linalg.norm(means - np.median(means, axis=0), axis=1), 0.98)
        noise = np.median(blocks.scatter) / np.sqrt(blocks.length)  # of a mean, all axes together
        if away > max(MOVED, 4 * noise):
            say("moved", f"turns at up to {np.degrees(away):.2g}°/s though it is to rest", remedy)
        return
    motion = of_field(values)
    if not motion.still:
        say("moved", f"changes its direction by {motion.turn:.2g}° though it is to rest", remedy)


def _rest(recording: Recording, values: np.ndarray, calibrates_temperature: bool, say: Say) -> None:
    if recording.rate < SLOW_STATIC:
        say("rate", f"sampled at {recording.rate:.3g} Hz, noise above {recording.rate / 2:.3g} Hz is "
                    "folded into what is stated as white",
            "record at twice the sensor's bandwidth, and at 10 Hz at least")  # fmt: skip
    elif limits := _unseen(recording, values):
        say("short", limits, "rest it longer: four times as long shows half the bias instability, "
            "twice as long half the random walk; 2 h and more are usual")  # fmt: skip
    drift = _span(recording.temperature)
    if drift > DRIFT and not calibrates_temperature:
        say("temperature", f"the temperature moves by {drift:.1f} °C during this rest: slow noise may be "
                           "thermal", "let it warm up for an hour in a steady place, or add a sweep as "
                                      "kind thermal, which takes it out")  # fmt: skip


def _unseen(recording: Recording, values: np.ndarray) -> str:
    """Which slow noise this rest is too short to show; "" where it shows its own.

    The Allan deviation of a rest that is long enough leaves the slope of white noise, N/√τ, before τ
    reaches a ninth of its length. Where it does not, B shows only beyond N/(0.664 √τ) and K only
    beyond √3 N/τ there (0.664: √(2 ln 2/π), IEEE Std 952-2020, annex C).
    """
    from sensorbook.noise import allan_deviation

    clusters = np.array([len(values) // 90, len(values) // 9])
    early, late = allan_deviation(values, recording.rate, clusters=clusters).deviation
    if not (early > 0).all():
        return ""
    # 1 for white noise, √10 for a floor; the median of three axes errs by a sixth.
    if np.median(late / early) * np.sqrt(10) > 1.5:
        return ""
    tau = clusters[1] / recording.rate
    white = float(np.median(early)) * np.sqrt(clusters[0] / recording.rate)
    smallest = {"bias_instability": white / (0.664 * np.sqrt(tau)),
                "rate_random_walk": np.sqrt(3) * white / tau}  # fmt: skip
    words = []
    for quantity, value in smallest.items():
        unit, scale = field_unit(recording.sensor, quantity)
        words.append(f"no {quantity.replace('_', ' ')} below {value / scale:.2g} {unit}")
    return (
        f"of {recording.duration:.4g} s, its Allan deviation falls to the end as white noise alone "
        f"does: {' and '.join(words)} would show"
    )


def _sweep(recording: Recording, say: Say) -> None:
    span = _span(recording.temperature)
    if span < SWEEP:
        say("temperature", f"the temperature spans {span:.1f} °C, too little for a model of it",
            "sweep over the range of use, 20 °C or more")  # fmt: skip
        return
    window = max(1, round(60 * recording.rate))
    known = recording.temperature[np.isfinite(recording.temperature)]
    minutes = known[: len(known) // window * window].reshape(-1, window).mean(axis=1)
    pace = float(np.quantile(np.abs(np.diff(minutes)), 0.9)) if len(minutes) > 3 else 0.0
    if pace > SWIFT:
        say("temperature", f"the temperature runs at {pace:.1f} °C/min, faster than a die follows its "
                           "housing", f"sweep at {SWIFT:g} °C/min or less, up and down")  # fmt: skip


def _directions(values: np.ndarray, say: Say) -> None:
    """Directions of the field that determine no calibration, or less than a full one."""
    from sensorbook.magnetometer import calibrate
    from sensorbook.magnetometer.coverage import motion_in_words
    from sensorbook.magnetometer.fit import NAMES

    try:
        # Thinned: a hand turns no faster, and a million readings would take half a minute.
        found = calibrate(values[:: max(1, len(values) // MOST)])
    except Refusal as refusal:
        say("coverage", refusal.reason.rstrip("."), refusal.remedy.rstrip("."))
        return
    if found.reduced:
        what, remedy = motion_in_words(found.coverage)
        say("coverage", f"determines {NAMES[found.method]}, no more: {what or found.reduced[0]}",
            remedy.rstrip(".") or "turn it more slowly and longer, through all attitudes")  # fmt: skip


def _span(temperature: np.ndarray | None) -> float:
    if temperature is None or not np.isfinite(temperature).any():
        return 0.0
    return float(np.nanquantile(temperature, 0.99) - np.nanquantile(temperature, 0.01))


REMEDIES = {
    "merged": "save each sensor at its own rate: its own table, or the recorder's database, not its CSV",
    "corrupt": "cut it out, or record again: a phone with its screen on and the recorder in front",
    "gap": "record without losses: fewer channels, a faster card or link, a phone with its screen on",
    "duplicate": "stamp each sample when it is taken, by one clock",
    "backward": "stamp each sample when it is taken, by one clock",
    "nan": "record again where the logger leaves cells empty",
    "saturated": "choose a wider range, or move it more gently",
    "spike": "rest it on a heavy table away from people and machines",
    "resolution": "record at a finer range, or with more digits",
    "rate": "mend the rate in device.toml, or leave it out",
}


def with_remedies(findings: tuple[Finding, ...]) -> Iterator[Finding]:
    """Findings with what to record instead, where they do not say it themselves."""
    for finding in findings:
        known = finding.kind in REMEDIES and not finding.where.startswith("reference")
        if finding.remedy or not known:
            yield finding
        else:
            yield replace(finding, remedy=REMEDIES[finding.kind])
