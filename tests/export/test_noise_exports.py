"""Noise for ROS' tools: what each tool's own formula makes of the file, or of noise made with it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
import yaml
from consumers import said
from scipy.optimize import curve_fit
from test_export import RANDOM_WALK, WALK
from test_export import results as results  # of which `exported` writes

AGAIN = "render it again with: sensorbook report"
PARTS = {"gyroscope": ("Gyr", "gyr"), "accelerometer": ("Acc", "acc")}


# ---- Kalibr's numbers, as allan_variance_ros has them ----


def allan_deviation(signal, clusters):
    """Of clusters of so many samples, classical: the definition."""
    means = signal[: len(signal) // clusters * clusters].reshape(-1, clusters).mean(axis=1)
    return math.sqrt(np.mean(np.diff(means) ** 2) / 2)


def get_intercept(x, y, m, b):
    """scripts/analysis.py: a line of slope m through the logarithms, read at b."""
    bounds = ([m, -np.inf], [m + 0.001, np.inf])
    (slope, offset), _ = curve_fit(lambda x, m, b: m * x + b, np.log(x), np.log(y), bounds=bounds)
    return math.exp(slope * math.log(b) + offset)


@pytest.mark.parametrize("name", ["kalibr", "allan-ros"])
@pytest.mark.parametrize("sensor", PARTS)
def test_noise_made_of_the_numbers_reads_back_with_the_tools_rule(name, sensor, exported):
    found = yaml.safe_load(exported(name))
    rate, n = found["update_rate"], 400_000
    rng = np.random.default_rng(20240501)
    # Kalibr's model: sigma_d = sigma/sqrt(dt), and steps sigma_bd = sigma_b sqrt(dt) of the bias.
    white = found[f"{sensor}_noise_density"] * math.sqrt(rate) * rng.standard_normal(n)
    walk = np.cumsum(found[f"{sensor}_random_walk"] / math.sqrt(rate) * rng.standard_normal(n))
    period = np.array([0.1, 0.2, 0.5, 1, 2, 3])
    for signal, slope, at, key in (
        (white, -0.5, 1.0, "noise_density"), (walk, 0.5, 3.0, "random_walk")
    ):  # fmt: skip
        curve = [allan_deviation(signal, round(tau * rate)) for tau in period]
        read = get_intercept(period, curve, slope, at)
        # 1300 to 40 000 clusters a point.
        assert read == pytest.approx(found[f"{sensor}_{key}"], rel=0.04)


def test_allan_ros_has_kalibrs_numbers_and_its_own_topic(exported):
    text = exported("allan-ros")
    found, kalibr = (yaml.safe_load(exported(name)) for name in ("allan-ros", "kalibr"))
    assert found == kalibr | {"rostopic": "/sensors/imu"}
    assert found["accelerometer_noise_density"] == max(RANDOM_WALK["accelerometer"])
    assert found["accelerometer_random_walk"] == max(filter(None, WALK["accelerometer"]))
    for line in (
        "# imu.yaml of allan_variance_ros, written by sensorbook. Device: 'imu-7' ('An IMU')\n",
        "# Results of 2024-05-01T12:00:00+00:00; sensorbook 0.1.0, python 3.11, numpy 2.0, scipy 1.13.\n",
        f"# Made of static.csv, sha256 {'0' * 64}.\n",
        "reads\n# them off the Allan deviation: noise_density where a line of slope -1/2",
    ):
        assert text.count(line) == 1
    assert text.isascii()


@pytest.mark.parametrize("name", ["allan_variance_ros", "imu_utils"])
def test_a_missing_and_a_refused_sensor_are_a_line_each(name, exported):
    def change(r):
        del r["sensors"]["accelerometer"]
        r["sensors"]["gyroscope"]["noise"] = {"reason": "The record has\n17 samples."}

    both = f"{name} needs both sensors: record a rest of the {{0}} and render its report"
    lines = [
        f"sensors.accelerometer: is missing — {both.format('accelerometer')}",
        "sensors.gyroscope.noise: was refused: The record has 17 samples. — "
        + both.format("gyroscope"),
    ]
    target = {"allan_variance_ros": "allan-ros", "imu_utils": "imu-utils"}[name]
    assert sorted(said(exported, target, change)) == lines


# ---- imu_utils ----


def opencv(text, folder):
    """The file as OpenCV's FileStorage reads it: {(part, axis): (n, w)}, type, name and units."""
    (folder / "imu_param.yaml").write_text(text)
    storage = cv2.FileStorage(str(folder / "imu_param.yaml"), cv2.FILE_STORAGE_READ)
    assert storage.isOpened()
    numbers, units = {}, {}
    for title, key in PARTS.values():
        part = storage.getNode(title)
        units[title] = part.getNode("unit").string()
        for axis in ("avg", "x", "y", "z"):
            node = part.getNode(f"{axis}-axis")
            numbers[title, axis] = tuple(node.getNode(f"{key}_{a}").real() for a in "nw")
    return numbers, (storage.getNode("type").string(), storage.getNode("name").string()), units


def imu_utils(terms, tau, rate):
    """getWhiteNoise and getBiasInstability of the curve that the tool fits to an Allan variance.

    `terms` Q, N, B, K, R; the fit is of the sum of five powers of tau, which holds this variance exactly.
    """
    q, n, b, k, r = terms
    tau = np.asarray(tau)

    def variance(tau):  # IEEE Std 952, table of Allan variances
        flat = 2 * math.log(2) / math.pi * b**2
        return 3 * q**2 / tau**2 + n**2 / tau + flat + k**2 * tau / 3 + r**2 * tau**2 / 2

    powers = np.stack([tau**p for p in (-2.0, -1.0, 0.0, 1.0, 2.0)], axis=1)
    weight = 1 / variance(tau)
    fit = np.linalg.lstsq(powers * weight[:, None], variance(tau) * weight, rcond=None)[0]
    deviation = np.sqrt(powers @ fit)
    return math.sqrt(rate) * math.sqrt(fit.sum()), deviation.min()  # all powers of 1 s are 1


LONG = np.geomspace(0.01, 1000, 30)  # s


def with_times(r):
    for sensor in PARTS:
        r["sensors"][sensor]["allan"]["tau"] = LONG.tolist()


def test_imu_utils_numbers_are_those_of_its_own_formulas(exported, tmp_path):
    def change(r):
        with_times(r)
        for sensor in PARTS:
            for axis in r["sensors"][sensor]["noise"].values():  # which do not show at 1 s
                axis["bias_instability"]["value"] = 1e-6

    numbers, (kind, name), units = opencv(exported("imu-utils", change), tmp_path)
    assert (kind, name) == ("IMU", "imu-7")
    assert units == {"Gyr": " rad/s", "Acc": " m/s^2"}
    for sensor, (title, _) in PARTS.items():
        pairs = []
        for i, axis in enumerate("xyz"):
            terms = (0, RANDOM_WALK[sensor][i], 1e-6, WALK[sensor][i] or 0, 0)
            n, w = imu_utils(terms, LONG, 100.0)
            pairs.append(numbers[title, axis])
            assert pairs[-1][0] == pytest.approx(n, rel=6e-3)  # the other terms at 1 s
            assert pairs[-1][1] == pytest.approx(w, rel=1e-6)
        assert numbers[title, "avg"] == pytest.approx(tuple(np.mean(pairs, axis=0)), rel=1e-12)


def test_white_noise_of_a_sample_is_the_scatter_of_samples(exported, tmp_path):
    """The white noise averaged over a second, 100 samples, is N."""
    numbers, *_ = opencv(exported("imu-utils"), tmp_path)
    noise = numbers["Gyr", "x"][0] * np.random.default_rng(3).standard_normal((40_000, 100))
    n = noise.mean(axis=1).std()
    assert n == pytest.approx(RANDOM_WALK["gyroscope"][0], rel=0.02)  # 5 standard errors


def test_what_other_noise_adds_at_one_second_is_not_white(exported, tmp_path):
    def change(r):
        with_times(r)
        r["sensors"]["gyroscope"]["noise"]["x"]["bias_instability"]["value"] = 2e-4

    numbers, *_ = opencv(exported("imu-utils", change), tmp_path)
    n = RANDOM_WALK["gyroscope"][0]
    tool, _ = imu_utils((0, n, 2e-4, 0, 0), LONG, 100.0)
    assert numbers["Gyr", "x"][0] == pytest.approx(10 * n, rel=1e-12)
    assert tool > 2 * 10 * n  # sqrt(7.1e-5² + 0.44·4e-8) is 2.1 times 7.1e-5


def test_imu_utils_comments(exported):
    text = exported("imu-utils", with_times)
    assert text.startswith("%YAML:1.0\n---\n")
    for line in (
        f"# Made of static.csv, sha256 {'0' * 64}.\n",
        "# gyr_n, acc_n: standard deviation of the white noise of one sample, N sqrt(rate), in rad/s and"
        " m/s^2,\n",
        "They are\n#   not per sqrt(Hz), whatever imu_utils' own README says",
        "      # N 0.00124 m/s^2/sqrt(Hz), B 4e-05 m/s^2; smallest at 1000 s, the longest: the level itself"
        " may be lower\n",
    ):
        assert text.count(line) == 1
    # 1.25e-3²/τ + 4e-5²·0.44 + 5e-5²·τ/3 is smallest at √3·25 s = 43 s.
    assert "B 4e-05 m/s^2, K 5e-05 m/s^3/sqrt(Hz); smallest at " in text
    at = float(text.split("K 5e-05 m/s^3/sqrt(Hz); smallest at ")[1].split(" s\n")[0])
    assert at == pytest.approx(43.3, rel=0.25)
    assert text.isascii()


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            lambda r: r["sensors"]["gyroscope"]["noise"]["y"].update(random_walk=None),
            "sensors.gyroscope.noise.y: random_walk is not visible, and imu_utils needs a number above 0"
            " — record a longer rest of the gyroscope and render its report",
        ),
        (
            lambda r: r["sensors"]["gyroscope"].pop("allan"),
            "sensors.gyroscope.allan: is missing — imu_utils needs both sensors: record a rest of the"
            " gyroscope and render its report",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["allan"].update(tau=[0, 1]),
            f"sensors.gyroscope.allan.tau: holds no cluster times above 0 — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["accelerometer"]["noise"]["x"]["random_walk"].update(unit="g"),
            "sensors.accelerometer.noise.x.random_walk.unit: 'g' is not 'm/s^2/sqrt(Hz)'"
            f" — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["accelerometer"]["noise"]["x"].pop("rate_ramp"),
            f"sensors.accelerometer.noise.x.rate_ramp: is missing — {AGAIN}",
        ),
    ],
)
def test_what_imu_utils_cannot_be_given(change, line, exported):
    assert said(exported, "imu-utils", change) == [line]


@pytest.mark.parametrize("name", ["allan-ros", "imu-utils"])
@pytest.mark.parametrize(
    "nasty", ["a\nGyr: 1", "\x85b: 1", "\u2028b: 1", '"', "{device}", "\\", "*/"]
)
def test_no_text_becomes_a_number(name, nasty, exported, tmp_path):
    def change(r):
        r["device"].update(name=nasty, id=nasty, serial=nasty)
        r["inputs"][0]["file"] = nasty

    if name == "allan-ros":
        assert yaml.safe_load(exported(name, change)) == yaml.safe_load(exported(name))
    else:
        plain = opencv(exported(name), tmp_path)[0]
        assert opencv(exported(name, change), tmp_path)[0] == plain
