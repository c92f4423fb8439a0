"""The chapter on propagation: its numbers, and sentences that follow its parameters."""

import re

import numpy as np
import pytest
from devices import ended, read_chapter
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    return read_chapter("propagation", tmp_path_factory.mktemp("chapter"), steps=2000)


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """Few readings of a fast pass, near the lock, and of a wide cone."""
    return read_chapter(
        "propagation",
        tmp_path_factory.mktemp("other"),
        rate_hz=10.0,
        seconds=20.0,
        pass_rate=90.0,
        closest_approach=0.5,
        cone_half_angle=20.0,
        cone_frequency=3.0,
        steps=1000,
    )


def test_numbers(read):
    found = read[0]["results"]["propagation"]
    assert np.degrees(found["tour"]["rates_closed"]) == pytest.approx(120)
    assert found["tour"]["turn_of_1_deg"] == pytest.approx(np.radians(1) ** 2, rel=1e-3)
    assert np.degrees(found["lock"]["yaw_rate"]["value"]) == pytest.approx(45 / np.sin(np.pi / 180))
    assert found["lock"]["quaternion"]["value"] < 1e-14
    assert 0.1 < np.degrees(found["lock"]["one_degree_at"]["value"]) < 0.9  # a step turns by 0.9°
    # In closed form, Ω = 2π 5 /s, x = Ω/50 and θ = 3°; the next power of θ is 0.3 %.
    half, circular = np.radians(3), 10 * np.pi
    x = circular / 50
    coning = found["coning"]["measured"]
    assert coning["sum of each axis"] == pytest.approx(-circular * (1 - np.cos(half)))
    left = circular * np.sin(half) ** 2 / 2 * (1 - np.sin(x) / x)
    assert coning["no correction"] == pytest.approx(-left, rel=0.004)
    assert -coning["coning correction"] == pytest.approx(
        circular * half**2 * x**4 / 60, rel=0.2
    )  # leading term; the next is of x²/4
    assert found["by_rate"]["power"] == pytest.approx(
        {
            "samples, held for the next step": 1,
            "samples, interpolated": 2,
            "means": 2,
            "means, coning correction": 4,
            "means, matrix of first order": 2,
        },
        abs=0.05,
    )
    delay, here = found["delay"], found["by_rate"]["here"]
    # One number for one loss, wherever the chapter has it.
    assert delay["held_samples"] == here["samples, held for the next step"]
    assert delay["errors"]["sample, taken for sample"] == here["samples, interpolated"]
    assert delay["errors"]["mean before, taken for mean before"] == here["means"]
    assert found["errors"]["quaternion"] == pytest.approx(here["means"], rel=1e-6)
    assert delay["held_samples"] == pytest.approx(delay["half_interval_times_rate"], rel=0.01)
    assert delay["errors"]["mean after, taken for mean before"] == pytest.approx(
        2 * delay["held_samples"], rel=0.01
    )
    errors = found["errors"]
    assert errors["matrix (5.2)"] == pytest.approx(errors["quaternion"], rel=1e-6)
    assert errors["quaternion, coning correction"] < 1e-3 * errors["quaternion"]
    assert found["rounding"]["32 bit, SVD each step"]["orthogonality"] < 1e-6
    assert found["rounding"]["64 bit, never orthogonalised"]["orthogonality"] < 1e-12
    assert set(found["seconds_a_step"]) == set(errors) - {"unit"}


def test_sentences(read):
    text = read[1]
    assert "leaves the body turned by **120°**, with integrals of zero" in text
    assert "The second leaves it turned by 0°, with integrals of 0°, 90° and −90°." in text
    assert "its yaw rate reaches **2,578 °/s**, 57.3 times as much" in text
    assert "above half of that for 0.044 s" in text  # 2 · 1° / 45 °/s
    assert "a peak of roll and yaw, one line on the other; pitch" in text
    assert "which is little; the quaternion never errs by more than" in text
    assert "A degree or more is lost from a closest approach of" in text
    assert "to the power 1.00 for held samples, 2.00 for interpolated ones" in text
    assert "at 10 readings a round the correction takes away 92.3 %" in text
    assert "half an interval, 10 ms, times the largest rate, 35.4 °/s, is 0.354°" in text
    assert "know what the stamp means" in text
    assert "sum of each axis −2.467 −2.467" in text
    assert "drifts by −2.47 °/s, or −148° in 60 s" in text
    assert "formulas as lines; dashed, this chapter's. Look for" in text
    assert "half-angle of" not in text.split("hardly")[0].split("Coning drift, over")[1]
    assert "Warning" not in text


def test_sentences_change_with_the_facts(other):
    record, text = other
    assert "which is lost for good" in text
    assert "at 3.33 readings a round the correction takes away 44" in text
    assert "Only more readings a round help further" in text
    assert [w["message"][:31] for w in record["warnings"]] == ["With 3.3 readings a round the c"]
    found = record["results"]["propagation"]
    assert found["lock"]["error"]["value"] > np.radians(1)
    yaw = 90 / np.sin(np.radians(0.5))
    assert np.degrees(found["lock"]["yaw_rate"]["value"]) == pytest.approx(yaw)
    drift = found["coning"]["measured"]["sum of each axis"]
    assert drift == pytest.approx(-6 * np.pi * (1 - np.cos(np.radians(20))))
    # The drift without correction, exactly: a step's turn and the cone's own are one turn, less the cone's.
    half, phase = np.radians(20), 2 * np.pi * 3 / 10
    step = [2 * np.sin(half) * np.sin(phase / 2), 0, -(1 - np.cos(half)) * phase]
    whole = Rotation.from_rotvec(step) * Rotation.from_rotvec([0, 0, phase])
    exact = 10 * (whole.magnitude() - phase)
    off = 100 * abs(found["coning"]["formula"]["no correction"] / exact - 1)
    wide = re.search(r"half-angle of 20° the formula .* is ([\d.]+) % off", text)
    assert float(wide[1]) == pytest.approx(off, abs=0.01)  # it is shown to two digits


def test_a_step_of_matrix_and_quaternion_are_compared_as_measured(read):
    """The machine decides, so that either outcome is right; the words must be those of the times."""
    cost, text = read[0]["results"]["propagation"]["seconds_a_step"], read[1]
    ratio = cost["matrix (5.2)"] / cost["quaternion"]
    said = [
        "about as long: in both" in text,
        "less: its multiplications are fewer" in text,
        "more, though its multiplications are fewer" in text,
    ]
    assert said == [2 / 3 < ratio < 1.5, ratio >= 1.5, ratio <= 2 / 3]


def test_far_from_the_lock_on_a_wide_and_slow_cone(tmp_path):
    _, text = read_chapter(
        "propagation",
        tmp_path,
        rate_hz=50.0,
        seconds=30.0,
        pass_rate=1.0,
        closest_approach=45.0,
        cone_half_angle=30.0,
        cone_frequency=0.05,
        steps=1000,
    )
    assert "its yaw rate reaches **1.414 °/s**, 1.41 times as much" in text
    assert "above half of that for 180 s" in text
    assert "a peak of roll and yaw, roll's 71 % as high as yaw's; pitch" in text
    assert "formulas as lines; this chapter has 1,000 readings a round, outside the figure." in text


def test_where_nothing_is_lost(tmp_path):
    record, text = read_chapter(
        "propagation",
        tmp_path,
        rate_hz=200.0,
        seconds=10.0,
        pass_rate=5.0,
        closest_approach=20.0,
        cone_half_angle=0.01,
        cone_frequency=0.2,
        steps=1000,
    )
    assert "which is nothing; the quaternion" in text
    assert "no pass costs a degree: at worst it is" in text
    assert "both are rounding, as the steps miss nothing" in text
    assert "The sensor's rate is high enough for this vibration." in text
    assert record["results"]["propagation"]["lock"]["one_degree_at"]["value"] is None


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"rate_hz": 0.0}, "rate_hz: rate of the readings is 0 Hz — give 5 to 200 Hz"),
        ({"seconds": 1e6}, "seconds: duration is 1e+06 s — give 10 to 120 s"),
        ({"closest_approach": 0.0}, "closest_approach: closest approach is 0° — give 0.001 to 45°"),
        ({"cone_half_angle": 90.0}, "cone_half_angle: half-angle of the cone is 90°"),
        (
            {"cone_frequency": 25.0},
            "cone_frequency: frequency of the cone is 25 Hz — give more than 0.0166667 and less than 25 Hz",
        ),
        (
            {"rate_hz": 5.0, "cone_frequency": 1.0, "pass_rate": 60.0},
            "pass_rate: rate of the pass is 60 °/s",
        ),
        ({"steps": 10}, "steps: number of steps is 10 — give a whole number, 1000 to 100000"),
    ],
)
def test_nonsense_is_named(tmp_path, parameters, reason):
    status, found = ended("propagation", tmp_path, **parameters)
    assert status == "failed"
    assert reason in found
