"""What check warns of beforehand, and that it is silent about what is well recorded."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.cli import main
from sensorbook.recordings.advice import advise, of_trajectory
from sensorbook.recordings.recording import Recording
from sensorbook.simulate import simulate
from sensorbook.simulate.positions import EDGES, FACES, RATE, hand_moved
from sensorbook.units import SENSOR_UNITS

REST = {
    "gyroscope": (1e-3, 2e-3, -1e-3),
    "accelerometer": (0.1, 0.2, 9.8),
    "magnetometer": (2e-5, 0, 4e-5),
}
NOISE = {"gyroscope": 1e-3, "accelerometer": 0.01, "magnetometer": 1e-7}


def recording(
    seconds, rate=100.0, sensor="gyroscope", kind="static", values=None, temperature=None, walk=0.0
):
    """White noise, and a random walk of this step a second, about what the sensor reads at rest."""
    rng = np.random.default_rng(17)
    time = np.arange(round(seconds * rate)) / rate
    if values is None:
        values = np.array(REST[sensor]) + rng.normal(scale=NOISE[sensor], size=(len(time), 3))
        values += np.cumsum(rng.normal(scale=walk / np.sqrt(rate), size=values.shape), axis=0)
    return Recording(sensor, kind, "a.csv", time, values, temperature, rate, SENSOR_UNITS[sensor])


def told(run, thermal=False):
    return {f.kind: (f.message, f.remedy) for f in advise(run, thermal)}


def test_a_rest_too_short_for_slow_noise_says_what_it_could_show():
    message, remedy = told(recording(600))["short"]
    assert message.startswith(
        "of 600 s, its Allan deviation falls to the end as white noise alone does: "
    )
    bias, walk = re.findall(r"no [a-z ]+ below ([\d.]+) ", message)
    white, tau = 1e-3 / np.sqrt(100), 600 / 9  # rad/s/√Hz, s
    # Both to 15 %: the white noise is measured at a ninetieth of the record, where it errs by 5 %.
    assert float(bias) == pytest.approx(np.degrees(white / (0.664 * np.sqrt(tau))) * 3600, rel=0.15)
    assert float(walk) == pytest.approx(np.degrees(np.sqrt(3) * white / tau) * 3600, rel=0.15)
    assert remedy.startswith("rest it longer: four times as long shows half the bias instability")


def test_a_rest_that_shows_its_random_walk_is_long_enough():
    assert told(recording(600, walk=3e-5)) == {}


def test_a_handful_of_samples():
    assert told(recording(5))["short"] == (
        "holds 500 samples, and its noise needs 1000", "rest it for an hour or more"
    )  # fmt: skip


def test_a_slow_rest():
    message, remedy = told(recording(3600, rate=1.0))["rate"]
    assert message == ("sampled at 1 Hz, noise above 0.5 Hz is folded into what is stated as white")
    assert remedy == "record at twice the sensor's bandwidth, and at 10 Hz at least"


def test_temperature_in_a_rest():
    run = recording(600, walk=3e-5, temperature=np.linspace(20, 24, 60_000))
    message, remedy = told(run)["temperature"]
    assert message == "the temperature moves by 3.9 °C during this rest: slow noise may be thermal"
    assert remedy.startswith(
        "let it warm up for an hour in a steady place, or add a sweep as kind thermal"
    )
    assert told(run, thermal=True) == {}
    assert told(replace(run, temperature=np.linspace(20, 20.5, 60_000))) == {}


@pytest.mark.parametrize(("top", "hours", "expected"), [
    (23, 2, "the temperature spans 2.9 °C, too little for a model of it"),
    (60, 0.25, "the temperature runs at 2.7 °C/min, faster than a die follows its housing"),
    (60, 2, None),
])  # fmt: skip
def test_sweeps(top, hours, expected):
    seconds = hours * 3600
    run = recording(
        seconds, 10.0, kind="thermal", temperature=np.linspace(20, top, round(seconds * 10))
    )
    found = told(run, thermal=True)
    assert found.get("temperature", (None,))[0] == expected
    assert found.keys() <= {"temperature"}


def test_what_moves_is_no_rest():
    rng = np.random.default_rng(18)
    turned = Rotation.from_euler("x", np.linspace(0, 20, 60_000)[:, None], degrees=True).apply(
        [0, 0, 9.8]
    )
    run = recording(
        600, sensor="accelerometer", values=turned + rng.normal(scale=0.01, size=turned.shape)
    )
    message, remedy = told(run)["moved"]
    assert message == "changes its direction by 9.5° though it is to rest"
    assert remedy == "fasten it, record again, or declare the kind of recording that it is"
    spun = recording(600).values + np.where(np.arange(60_000) > 40_000, 0.1, 0)[:, None]
    assert "turns at up to 9.9°/s" in told(recording(600, values=spun))["moved"][0]


def test_an_absurd_sample_is_left_out_of_the_numbers():
    """Told as corrupt, it is no measure of the noise."""
    clean = recording(600)
    values = clean.values.copy()
    values[30_000] = 1e20
    number = r"no bias instability below ([\d.e+]+) "
    (there,), (alike,) = (
        re.findall(number, told(run)["short"][0]) for run in (clean, replace(clean, values=values))
    )
    assert float(alike) == pytest.approx(float(there), rel=0.06)  # one step of its two digits


def test_slow_positions():
    assert "sampled at 10 Hz" in told(recording(100, 10.0, kind="positions"))["rate"][0]


# --- a trajectory ---


def moved(seconds=40.0, rate=50.0, size=1.0, periods=(7.0, 5.0, 3.0)):
    """Gyroscope and reference of one motion about all axes; the readings are means over intervals.

    66 °/s rms at a `size` of 1; the three angles swing with these periods (s).
    """
    rng = np.random.default_rng(23)
    time = np.arange(round(seconds * rate)) / rate
    angles = np.array([0.9, 0.4, 0.7]) * np.sin(
        2 * np.pi * time[:, None] / np.array(periods) + [0, 1, 2]
    )
    body = Rotation.from_euler("ZYX", size * angles)
    turned = (body[:-1].inv() * body[1:]).as_rotvec() * rate
    rates = np.concatenate([turned[:1], turned]) + rng.normal(scale=1e-3, size=(len(time), 3))
    error = Rotation.from_rotvec(rng.normal(scale=2e-3, size=(len(time), 3)))
    gyroscope = recording(seconds, rate, kind="trajectory", values=rates)
    reference = replace(
        gyroscope,
        sensor="reference",
        values=(body * error).as_quat(),
        declaration={"quaternion": "body_to_reference"},
    )
    return replace(gyroscope, declaration={"unit": "rad/s"}), reference


def lines(*recordings, calibrated=False, declared=("gyroscope", "camera")):
    """What is told of recordings of a trajectory: problems, and findings."""
    problems, findings = of_trajectory(recordings, set(declared), calibrated)
    return [str(p) for p in problems], [str(f) for f in findings]


def test_a_good_trajectory_raises_no_alarm():
    assert lines(*moved()) == ([], [])


def test_motion_too_fast_for_its_rate():
    spun = np.tile([0, 0, 2.0], (2000, 1))  # rad/s, at 20 Hz: 5.7° a sample
    run = recording(100, 20.0, kind="trajectory", values=spun)
    said = (
        [],
        [
            "a.csv: gyroscope: turns by 5.7° rms from sample to sample: coning makes its integral drift "
            "— record at 57 Hz or more, or move it more slowly"
        ],
    )
    assert lines(run) == said
    assert lines(recording(20, 100.0, kind="trajectory", values=spun)) == ([], [])
    absurd = np.array(spun)
    absurd[500] = 1e25
    assert lines(replace(run, values=absurd)) == said


@pytest.mark.parametrize("size", [1.0, 0.3])
def test_degrees_declared_as_radians(size):
    """Told by their size where it is beyond all gyroscopes, else by the reference; the advice on the
    rate, which would lead away from it, is left out."""
    gyroscope, reference = moved(size=size)
    wrong = replace(gyroscope, values=np.degrees(gyroscope.values))
    (problem,), findings = lines(wrong, reference)
    assert 'write unit = "deg/s"' in problem
    assert findings == []


@pytest.mark.parametrize(("size", "problems", "words"), [
    (1.2, 1, "row 1 has the length 1.2, where a quaternion has 1"),
    (0.0, 0, "only 0 of the reference's 2000 rows can be used. 2000 of the reference's 2000 rows (100 %) "
             "hold no attitude: left out — Record a reference whose attitudes are stamped"),
])  # fmt: skip
def test_a_reference_that_is_none(size, problems, words):
    gyroscope, reference = moved()
    told = lines(gyroscope, replace(reference, values=size * reference.values))
    assert [len(each) for each in told] == [problems, 1 - problems]
    assert words in (told[0] or told[1])[0]


def test_two_that_do_not_tell_of_the_same_motion():
    problems, (finding,) = lines(moved()[0], moved(periods=(2.0, 6.1, 4.3))[1])
    assert problems == []
    assert "do not tell of the same motion" in finding


def test_a_mirrored_axis_and_a_calibration_that_may_turn_it():
    gyroscope, reference = moved()
    mirrored = replace(gyroscope, values=gyroscope.values * [1, 1, -1])
    (problem,), findings = lines(mirrored, reference)
    assert "[[recording]] gyroscope: columns: a mirrored axis" in problem
    assert findings == []
    assert lines(mirrored, reference, calibrated=True) == ([], [])


def test_the_reference_of_the_gyroscope_s_own_file_is_compared():
    """And of several runs the longest, which stands first."""
    gyroscope, reference = moved()
    other = replace(reference, file="b.csv", values=reference.values[::-1])
    assert lines(gyroscope, other, reference) == ([], [])
    assert lines(gyroscope, other) != ([], [])
    short = replace(gyroscope.between(0, 10), file="b.csv")
    assert lines(gyroscope, short, reference, other) == ([], [])


def test_long_trajectories_are_not_compared(monkeypatch):
    gyroscope, reference = moved()
    wrong = replace(reference, values=reference.values[::-1])
    monkeypatch.setattr("sensorbook.recordings.advice.COMPARED", len(gyroscope) - 1)
    assert lines(gyroscope, wrong) == ([], [])


@pytest.mark.parametrize("beside", [(), ("accelerometer",), ("magnetometer",)])
def test_a_gyroscope_that_nothing_checks(beside):
    problems, (finding,) = lines(moved()[0], declared=("gyroscope", *beside))
    assert problems == []
    assert finding.startswith("a.csv: gyroscope: Nothing beside the gyroscope tells the attitude")
    assert ("leaves a turn open" in finding) == bool(beside)


@pytest.mark.parametrize("beside", [("accelerometer", "magnetometer"), ("reference",), ("camera",)])
def test_one_that_something_checks_though_it_may_not_be_readable(beside):
    assert lines(moved()[0], declared=("gyroscope", *beside)) == ([], [])


def test_what_is_not_known_is_not_compared():
    gyroscope, reference = moved()
    unknown = {"unit": "rad/s", "guessed": {"unit": "not known"}}
    wrong = replace(gyroscope, values=gyroscope.values * 100, declaration=unknown)
    assert lines(wrong, reference) == ([], [])


TRAJECTORY = """
[[recording]]
sensor = "{}"
kind = "trajectory"
file = "t.csv"
columns = {{ time = "t", {} }}
{}
"""


@pytest.fixture
def check_trajectory(tmp_path, capsys):
    """Writes a motion with a force as a device, its rates `turn` times as large, and checks it."""

    def check(*sensors, turn=1.0, gravity=9.8):
        gyroscope, reference = moved(size=0.3)
        force = Rotation.from_quat(reference.values).inv().apply([0, 0, -gravity])
        table = [gyroscope.time, gyroscope.values * turn, force, reference.values]
        header = "t,gx,gy,gz,ax,ay,az,qx,qy,qz,qw"
        np.savetxt(
            tmp_path / "t.csv", np.column_stack(table), delimiter=",", header=header, comments=""
        )
        parts = {
            "gyroscope": ('x = "gx", y = "gy", z = "gz"', 'unit = "rad/s"'),
            "accelerometer": ('x = "ax", y = "ay", z = "az"', 'unit = "m/s^2"'),
            "reference": ('x = "qx", y = "qy", z = "qz", w = "qw"',
                          'quaternion = "body_to_reference"'),
        }  # fmt: skip
        text = [TRAJECTORY.format(sensor, *parts[sensor]) for sensor in sensors]
        (tmp_path / "device.toml").write_text('schema = 1\nid = "imu"\n' + "".join(text))
        code = main(["check", str(tmp_path)])
        said = capsys.readouterr()
        return code, said.err.splitlines(), said.out.splitlines()[:-1]

    return check


def test_check_tells_of_a_trajectory(check_trajectory):
    every = "gyroscope", "accelerometer", "reference"
    assert check_trajectory(*every) == (0, [], [])
    code, (problem,), _ = check_trajectory(*every, turn=180 / np.pi)
    assert code == 1
    assert problem.startswith("device.toml: [[recording]] gyroscope: unit: the rates are 57.")
    code, problems, warnings = check_trajectory("accelerometer", "reference")
    assert (code, problems) == (0, [])
    assert warnings == [
        "warning: device.toml: a trajectory needs a gyroscope of kind trajectory, and this one holds "
        "accelerometer and reference alone — add the gyroscope's recording"
    ]


@pytest.mark.parametrize(("gravity", "told"), [(1.0, True), (98.0, True), (9.6, False)])
def test_a_force_far_from_gravity_throughout(check_trajectory, gravity, told):
    code, _, warnings = check_trajectory("gyroscope", "accelerometer", "reference", gravity=gravity)
    assert code == 0
    expected = (
        f"warning: t.csv: accelerometer: reads {gravity:g} m/s^2 typically, but gravity is 9.8 m/s²: "
        "check the unit 'm/s^2' and the scale"
    )
    assert warnings == ([expected] if told else [])


def turned(directions, hard_iron=(2e-5, -1e-5, 3e-5), **more):
    """A rotation of a magnetometer whose field, 48 µT, points along these; 0.2 µT of noise."""
    rng = np.random.default_rng(20)
    values = 4.8e-5 * directions + hard_iron + rng.normal(scale=2e-7, size=directions.shape)
    run = recording(len(values) / 100, sensor="magnetometer", kind="rotation", values=values)
    return replace(run, **more)


def sphere(count=3000):
    v = np.random.default_rng(19).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def test_directions_that_determine_a_magnetometer_and_such_that_do_not():
    every = sphere()
    assert told(turned(every)) == {}
    assert told(turned(every[:60])) == {}  # short, but all round
    flat = every * [1, 1, 0.05]
    flat /= np.linalg.norm(flat, axis=1)[:, None]
    message, remedy = told(turned(flat))["coverage"]
    assert re.match(
        r"The directions are too few for the full ellipsoid .* one plane or cone", message
    )
    assert re.match(r"Tip it by 90° and over, until its [+−]z points", remedy)
    message, remedy = told(turned(every[every[:, 2] > 0.7]))["coverage"]
    assert "across the device's +z" in message
    assert remedy.startswith("Tip it by 90° and over")
    assert told(turned(flat, declaration={"check": True})) == {}  # judges, and determines nothing


def test_directions_that_determine_less_than_an_ellipsoid():
    every = sphere()
    belt = every[np.abs(every[:, 2]) < np.sin(np.radians(20))]
    message, remedy = told(turned(belt))["coverage"]
    assert re.match(
        r"determines hard iron (alone|and three scale factors), no more: the field stays", message
    )
    assert "until its" in remedy


def test_readings_too_few_or_on_no_ellipsoid():
    message, remedy = told(turned(sphere(20)))["coverage"]
    assert message == "20 different readings are too few; 50 are needed"
    assert remedy == "Turn the device slowly through all attitudes for a minute"
    # A field that changes by a quarter from place to place.
    uneven = sphere() * np.random.default_rng(21).normal(1, 0.25, (3000, 1))
    message, remedy = told(turned(uneven))["coverage"]
    assert message.startswith("The readings lie on no ellipsoid")
    assert "a metre from iron" in remedy


def test_an_accelerometer_beside_needs_no_coverage():
    run = turned(sphere()[:500] * [1, 1, 0.01])
    assert advise(replace(run, sensor="accelerometer", values=run.values * 2e5), False) == ()


def test_the_demo_is_well_recorded(tmp_path, capsys):
    simulate(tmp_path / "demo", preset="ahrs", seed=1)
    assert main(["check", str(tmp_path / "demo")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'demo'}: nothing to mend\n"


@pytest.mark.parametrize(
    "name", ["adis16405-2", "adis16405-3", "cats-tag", "xsens-mti", "ck-mag-acc"]
)
def test_good_real_recordings_raise_no_alarm(real_data, name, capsys):
    assert main(["check", str(real_data / name)]) == 0
    assert capsys.readouterr().out == f"{real_data / name}: nothing to mend\n"


def test_findings_come_with_a_remedy(folder, samples, capsys):
    path = folder()
    text = (path / "static.csv").read_text().splitlines()
    text[5] = ",,"
    (path / "static.csv").write_text("\n".join(text) + "\n")
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert (
        "warning: static.csv: gyroscope, column 'gx': 1 of 500 values missing (0.2 %) — record again "
        "where the logger leaves cells empty"
    ) in said
    assert (
        "warning: static.csv: gyroscope: holds 499 samples, and its noise needs 1000 — rest it for an "
        "hour or more"
    ) in said


# --- positions ---


@pytest.mark.parametrize(
    ("directions", "words"),
    [
        (FACES, "6 rests in 6 distinct directions do not determine 9 parameters"),
        ((*FACES, *EDGES), None),
    ],
)
def test_positions_that_determine_a_calibration_and_such_that_do_not(directions, words):
    made = hand_moved(np.random.default_rng([81, len(directions)]), directions, 2.0, initial=0.0)
    recording = Recording(
        "accelerometer", "positions", "a.csv", made["t"], made["accelerometer"], rate=RATE
    )
    found = advise(recording, False)
    assert [f.kind for f in found] == ([] if words is None else ["coverage"])
    assert all(words in f.message and "positions added" in f.remedy for f in found)


def test_a_missing_face_is_told():
    made = hand_moved(np.random.default_rng(82), FACES[:5], 0.3, initial=0.0)
    recording = Recording(
        "accelerometer", "six_position", "a.csv", made["t"], made["accelerometer"], rate=RATE
    )
    (found,) = advise(recording, False)
    assert "x down is missing" in found.message
    assert "Record a rest with x down" in found.remedy


def test_a_noisy_gyroscope_at_rest_has_not_moved():
    """Means of its blocks scatter by a degree a second; a rest is no motion for all that."""
    rng = np.random.default_rng(3)
    noisy = recording(1200.0, 28.6, values=0.17 * rng.normal(size=(34_320, 3)))
    assert "moved" not in told(noisy)
    turned = np.array(noisy.values)
    turned[10_000:20_000, 0] += 0.5
    assert "turns at up to" in told(recording(1200.0, 28.6, values=turned))["moved"][0]
