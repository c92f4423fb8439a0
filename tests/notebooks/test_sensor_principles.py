"""The chapter on sensor principles: its numbers against others' ways to them, and its sentences."""

from __future__ import annotations

import contextlib
import io
import math
import re
from types import SimpleNamespace

import nbformat
import numpy as np
import pytest
from devices import executed, read_chapter
from scipy import integrate

from sensorbook.reporting.chapters import NOTEBOOKS

G0 = 9.80665


@pytest.fixture(scope="module")
def chapter(tmp_path_factory):
    record, page = read_chapter("sensor_principles", tmp_path_factory.mktemp("chapter"))
    return record["results"]["sensor_principles"], page


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """Another way: a place in the south, a stiffer spring, shorter light, other noise, other skies."""
    record, page = read_chapter(
        "sensor_principles",
        tmp_path_factory.mktemp("other"),
        place=[-33.87, 151.21, 0.0],
        accelerometer=[8000.0, 4.0, 10.0, 5.0],
        light=[500.0, 0.05, 1310.0, 0.24, 632.8],
        stochastic=[10.0, 0.1, 0.0],
        biases=[0.1, 10.0],
        horizon=[35786.0, 45.0, 90.0],
        kelvin=[240.0, 250.0, 200.0, 260.0],
    )
    return record["results"]["sensor_principles"], page


def value(results, name, unit):
    assert results[name]["unit"] == unit
    return results[name]["value"]


def test_accelerometer(chapter):
    results, page = chapter
    # A spring that holds 1 µg against g: k = m ω₀².
    stiffness = 1e-9 * (2 * math.pi * 4000) ** 2
    assert value(results, "accelerometer_displacement_1g", "m") == pytest.approx(
        1e-9 * G0 / stiffness
    )
    # The dashpot's force noise 4kTc, c = mω₀/Q, over the mass.
    damping = 1e-9 * 2 * math.pi * 4000 / 5
    noise = math.sqrt(4 * 1.380649e-23 * 298.15 * damping) / 1e-9
    assert value(results, "accelerometer_noise_density", "m/s^2/sqrt(Hz)") == pytest.approx(noise)
    assert "the mass moves by **15.5 nm** for one g, 0.78 % of the gap" in page
    assert "1 mg of bias is a tilt of 0.057°" in page


def test_rotor_and_light(chapter):
    results, page = chapter
    mass, radius, spin = 0.3, 0.02, 24000 * 2 * math.pi / 60
    drift = mass * G0 * 1e-9 / (mass * radius**2 / 2 * spin)  # M/H, whatever the mass
    assert value(results, "rotor_drift", "rad/s") == pytest.approx(drift)
    turns, area = 1000 / (math.pi * 0.1), math.pi * 0.05**2
    phase = 8 * math.pi * turns * area * 7.292115e-5 / (1550e-9 * 299792458)
    assert value(results, "sagnac_phase_at_earth_rate", "rad") == pytest.approx(phase)
    area = 0.12**2 * math.sqrt(3) / 4
    beat = 4 * area * 7.292115e-5 / (632.8e-9 * 0.36)
    assert value(results, "ring_laser_beat_at_earth_rate", "Hz") == pytest.approx(beat)
    assert "the phases by **98.6 µrad**" in page
    assert "beats at **7.98 Hz** at Earth rate" in page


def test_vibrating_gyroscope_against_its_equation_of_motion(chapter):
    results, page = chapter
    assert value(results, "coriolis_force_at_earth_rate", "N") == pytest.approx(
        -2 * 1e-9 * 7.292115e-5 * 5e-6 * 2 * math.pi * 20000
    )
    drive, sense, rate, quality = 2 * math.pi * 20000, 2 * math.pi * 20500, 7.292115e-5, 1000

    def motion(t, state):
        y, speed = state
        push = -2 * rate * 5e-6 * drive * math.cos(drive * t)
        return speed, push * 1e12 - sense / quality * speed - sense**2 * y  # y in pm

    # The start dies out as e^{−ω t/2Q}: by e^{−9.7} after 0.15 s; 1 ms then holds 20 swings.
    step = np.linspace(0.15, 0.151, 2001)
    found = integrate.solve_ivp(
        motion, (0, 0.151), (0, 0), "DOP853", step, rtol=1e-7, atol=1e-9, max_step=1e-5
    )
    amplitude = 1e-12 * np.abs(found.y[0]).max()
    # The transient left is e^{−9.7} = 6e-5 of an amplitude, sampling costs (π/100)²/2 = 5e-4.
    assert value(results, "coriolis_displacement_at_earth_rate", "m") == pytest.approx(
        amplitude, rel=1e-3
    )
    assert "it moves by **115 fm**" in page


def test_magnetometers_and_field(chapter):
    results, page = chapter
    strength = value(results, "field_strength", "T")
    # Of the IGRF's map at Ankara: 48 µT, 6° east, 58° down.
    assert strength == pytest.approx(48.1e-6, abs=0.2e-6)
    assert math.degrees(value(results, "declination", "rad")) == pytest.approx(6.1, abs=0.3)
    assert math.degrees(value(results, "dip", "rad")) == pytest.approx(58.2, abs=0.3)
    assert value(results, "hall_voltage", "V") == pytest.approx(
        1e-3 * strength / (1e22 * 1.602176634e-19 * 1e-6)
    )
    # 42.576 MHz/T, water in a sphere.
    assert value(results, "proton_frequency", "Hz") == pytest.approx(42.5764e6 * strength, rel=1e-5)
    assert "declination **6.1° east**, dip **58.2° down**" in page


def test_errors_of_a_known_rate(chapter):
    results, page = chapter
    assert np.degrees(value(results, "reading_all_errors", "rad/s")) == pytest.approx(
        [
            100 * 1.01 + 0.5,
            100 * 5e-3 + 0.5,
            100 * 5e-3 + 0.5 + 0.1 * value(results, "gravity", "m/s^2") / G0,
        ]
    )
    assert (
        "errs by 1.50, 1.00 and 1.10 °/s; with its calibration by **nothing but rounding**" in page
    )
    assert value(results, "scale_factor_warmed", "1") == pytest.approx(0.0024)
    # 0.245 °/√h, 7.56 °/h over √(2 ln 2/π), 1.8 °/h/√s by √(t³/3): after an hour 0.245, 5.0, 62.4°.
    assert "the random walk's, after an hour the **rate random walk**'s: 62°" in page


def test_bias_integrated_step_by_step(chapter):
    results, page = chapter
    gravity, radius, hour = value(results, "gravity", "m/s^2"), 6371e3, 3600.0

    def level(bias, rate):
        """Position error of a levelled system: tilt, velocity, position; gravity pulls it back."""

        def motion(t, state):
            tilt, speed, _ = state
            return rate - speed / radius, bias + gravity * tilt, speed

        return integrate.solve_ivp(motion, (0, hour), (0, 0, 0), rtol=1e-10, atol=1e-12).y[2, -1]

    named = "{}_bias_position_1h_schuler"
    assert value(results, named.format("accelerometer"), "m") == pytest.approx(
        level(1e-3 * G0, 0.0)
    )
    drift = math.radians(1) / 3600
    assert value(results, named.format("gyroscope"), "m") == pytest.approx(level(0.0, drift))
    assert value(results, "accelerometer_bias_position_1h", "m") == pytest.approx(
        1e-3 * G0 * hour**2 / 2
    )
    assert "1 mg is **17.7 m** after a minute and, by ½bt², **63.5 km** after an hour" in page
    assert "The Schuler period is 84.4 min" in page


def test_horizon(chapter):
    results, page = chapter
    # Wien's form, e^{c₂/λT}, which is short by e^{−c₂/λT}: 0.01 at 300 K and 11 µm, 0.02 at 245 K and 15 µm.
    second = 1.438777e-2
    for name, length, low, high in (("11um", 11e-6, 210, 300), ("15um", 15e-6, 215, 245)):
        wien = math.exp(second / length * (1 / low - 1 / high))
        assert value(results, f"radiance_ratio_{name}", "1") == pytest.approx(wien, rel=0.02)
    assert value(results, "earth_angular_radius", "rad") == pytest.approx(math.asin(6411 / 6871))
    assert (
        "From 500 km the Earth fills **138°** of the sky, from the geostationary orbit 17.5°"
        in page
    )
    assert "How long the beam stays on the Earth tells one angle" in page
    assert "The smaller contrast lets one threshold find the limb everywhere" in page


def test_sentences_follow_the_parameters(other):
    results, page = other
    assert "the mass moves by **3.88 nm** for one g, 0.097 % of the gap" in page
    assert "500 m of fibre on a coil of 0.05 m" in page
    # A quarter of length times diameter, at 1310 instead of 1550 nm: 98.6 · 1550/1310/4.
    assert "the phases by **29.2 µrad**" in page
    assert "beats at **16 Hz**" in page
    assert "33.87° S, 151.2° E" in page
    assert "declination **12.8° east**, dip **64." in page
    assert "° up**" in page
    assert math.degrees(results["dip"]["value"]) == pytest.approx(-64.3, abs=0.5)
    assert "about the vertical of the place that is -8.38 °/h" in page
    assert "the random walk's, after an hour the **random walk**'s: 10°" in page
    assert "0.1 mg is **1.77 m** after a minute" in page
    assert (
        "A gyroscope that is off by 10 °/h has drifted by a horizon sensor's accuracy after **0.6 min**"
        in page
    )
    assert "At these temperatures the band has no advantage" in page
    assert "This cone never crosses the limb: it tells nothing" in page
    assert (
        "From 35786 km, the geostationary orbit, the Earth fills **17.5°** of the sky: it is no point"
        in page
    )
    # Flicker's row is named for what it is.
    assert "bias instability: a bias of 0.66 B that stays" in page
    assert "The row of bias instability is a bias of 0.66 B, no standard deviation." in page


def test_a_date_outside_the_model_is_said(tmp_path):
    record, page = read_chapter("sensor_principles", tmp_path, date="1850-01-01")
    assert "the IGRF holds from 1900 to 2030, not in 1850" in page
    assert "stands for it, typical of middle latitudes" in page
    assert "declination **" not in page
    assert "A Hall plate with the whole of the assumed field through it." in page
    assert "The assumed field of **48.33 µT** makes" in page  # √(20² + 44²)
    assert "field at the place, from above" not in page
    assert "on 1850-01-01 there is neither declination nor dip to state" in page
    found = record["results"]["sensor_principles"]
    for name in ("field_strength", "declination", "dip", "proton_frequency", "hall_voltage"):
        assert found[name]["value"] is None
    assert found["sagnac_phase_at_earth_rate"]["value"] is not None


def test_the_teaching_cell_says_igrf_only_where_it_holds():
    book = nbformat.read(NOTEBOOKS / "10_sensor_principles.ipynb", as_version=4)
    source = next(c.source for c in book.cells if "dip of a dipole" in c.source)
    for known, said in ((True, "IGRF: 58.2°"), (False, "the field is not known")):
        printed = io.StringIO()
        names = {"np": np, "latitude": 39.93, "dip": 58.2, "known": known}
        names["earth"] = SimpleNamespace(source="not known")
        with contextlib.redirect_stdout(printed):
            exec(source, names)
        assert said in printed.getvalue()
        assert ("IGRF" in printed.getvalue()) == known


def test_none_of_an_error_works_and_is_said(tmp_path):
    record, page = read_chapter(
        "sensor_principles",
        tmp_path,
        stochastic=[0.0, 0.0, 0.0],
        biases=[0.0, 0.0],
        rotor=[24000.0, 20.0, 0.0],
        deterministic=[0.0, 0.0, 0.0, 0.0, 0.0],
    )
    assert "**This gyroscope has no noise** (N, B and K are 0)" in page
    assert "**An accelerometer without bias** moves the position by nothing." in page
    assert "**A gyroscope without bias** turns the attitude by nothing." in page
    assert "**A gyroscope without bias drifts by its noise alone**" in page
    assert "never" in page
    assert not re.search(r"\b(nan|inf)\b", page)
    assert "Position error of" not in page, "nothing to draw"
    found = record["results"]["sensor_principles"]
    for name in (
        "accelerometer_bias_position_1h",
        "gyroscope_bias_position_1h_schuler",
        "rotor_drift",
    ):
        assert found[name]["value"] == 0


def test_one_bias_alone(tmp_path):
    page = read_chapter("sensor_principles", tmp_path, biases=[0.0, 1.0])[1]
    assert "**An accelerometer without bias** moves the position by nothing." in page
    assert "1 °/h turns the attitude by 0.017° in a minute and 1° in an hour" in page
    assert "Position error of 0 mg and of 1 °/h." in page


def test_a_spring_too_soft_for_gravity(tmp_path):
    record, page = read_chapter("sensor_principles", tmp_path, accelerometer=[50.0, 2.0, 1.0, 5.0])
    # g/ω² = 9.80665/(2π·50)² = 99.4 µm.
    assert "the mass would have to move by 99.4 µm for one g, but the plate is 2 µm away" in page
    assert "**it lies against its stop and reads nothing**" in page
    assert "the mass lies against its stop: no reading." in page
    assert "% of the gap" not in page
    assert "it reads +g" not in page
    assert "stop" in page
    found = record["results"]["sensor_principles"]
    assert found["accelerometer_displacement_1g"]["value"] is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"magnetic": [1.0, 1.0, 1e22, 0.0]}, "magnetic: area of the SQUID is 0 mm²"),
        ({"magnetic": [1.0, 0.0, 1e22, 1.0]}, "magnetic: thickness of the Hall plate is 0 µm"),
        ({"rotor": [0.0, 20.0, 1.0]}, "rotor: speed is 0 rev/min"),
        ({"accelerometer": [0.0, 2.0, 1.0, 5.0]}, "accelerometer: resonance is 0 Hz"),
        ({"horizon": [-100.0, 45.0, 60.0]}, "horizon: height of the orbit is -100 km"),
        ({"stochastic": [-1.0, 0.0, 0.0]}, "stochastic: N is -1 °/√h"),
        ({"kelvin": [1.0, 300.0, 215.0, 245.0]}, "kelvin: cold cloud is 1 K — give 100 to 1000 K"),
        ({"place": [95.0, 0.0, 0.0]}, "place: latitude is 95°"),
        ({"place": [40.0, 30.0]}, "give a list of 3: latitude [°], longitude [°], height [m]"),
        ({"date": "tomorrow"}, "date: 'tomorrow' is no day"),
    ],
)
def test_nonsense_is_named(given, said, tmp_path):
    notebook = NOTEBOOKS / "10_sensor_principles.ipynb"
    outcome = executed(notebook, given, tmp_path)
    assert outcome.status == "failed"
    assert said in outcome.reason
    assert outcome.reason.count("parameters: ") == 1
    assert len(outcome.problems) == 1


def test_no_emphasis_is_shown_as_asterisks(tmp_path):
    notebook = NOTEBOOKS / "10_sensor_principles.ipynb"
    outcome = executed(notebook, {}, tmp_path)
    assert outcome.status == "complete"
    assert "&#42;&#42;" not in "".join(str(c.get("outputs", "")) for c in outcome.notebook.cells)
