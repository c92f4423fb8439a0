"""Rests found in recordings, and what is set aside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sensorbook.calibration import calibrate_positions, find_faces, find_positions
from sensorbook.calibration.find import accelerometers_of, beside, require_gyroscope
from sensorbook.calibration.rests import quiet_spans, rolling_scatter
from sensorbook.errors import InputError, Refusal
from sensorbook.recordings.recording import Recording, Segment
from sensorbook.simulate.phone import NOISE as PHONE_NOISE
from sensorbook.simulate.positions import EDGES, FACES, RATE, hand_moved

G = 9.80665


def moved(seed, directions=(*FACES, *EDGES), levelling=4.0, **more):
    """A hand-moved device: accelerometer, gyroscope, and the truth."""
    made = hand_moved(np.random.default_rng([seed, 0xF1]), directions, levelling, gravity=G, **more)
    a, w = (
        Recording(
            s, "positions", "log.csv", made["t"], made[s], rate=RATE, declaration={"unit": "SI"}
        )
        for s in ("accelerometer", "gyroscope")
    )
    return a, w, made


def check_spans(found, made, least=2.0):
    """Every true rest of some length once, nothing over a motion, no more than 0.3 s lost at an end."""
    rests = [r for r in made["rests"] if r["end"] - r["start"] >= least]
    used = np.zeros(len(rests), dtype=int)
    for start, end in found.positions.spans:
        inside = [
            k for k, r in enumerate(rests) if r["start"] - 0.02 <= start and end <= r["end"] + 0.02
        ]
        assert len(inside) == 1, (start, end)
        used[inside[0]] += 1
        rest = rests[inside[0]]
        # Half a window of half a second at either end, and what a slow start of the motion hides.
        assert start - rest["start"] < 0.5
        assert rest["end"] - end < 0.5
    assert (used == 1).all(), used


@pytest.mark.parametrize("seed", range(4))
def test_rests_of_a_hand_moved_device(seed):
    a, w, made = moved(seed)
    found = find_positions([a], [w], G)
    check_spans(found, made)
    assert found.aside == ()
    assert len(found.gyroscope) == len(found.positions)
    assert found.threshold in (2.0, 3.0, 4.0)
    assert len(found.sweep) == 6


@pytest.mark.parametrize("every", [2, 5])
def test_other_rates(every):
    a, w, made = moved(10)
    a, w = (replace(r._rows(slice(None, None, every)), rate=RATE / every) for r in (a, w))
    check_spans(find_positions([a], [w], G), made)


def test_the_accelerometer_alone():
    a, _, made = moved(11)
    found = find_positions([a], [], G)
    check_spans(found, made)
    assert found.gyroscope is None
    with pytest.raises(Refusal, match="no accelerometer in the same time base"):
        require_gyroscope(found)


def test_a_noisy_phone():
    a, w, made = moved(12, noise=PHONE_NOISE)
    check_spans(find_positions([a], [w], G), made)


def test_a_coarse_converter_is_neither_lost_nor_saturated():
    a, w, _ = moved(13)
    step = 16 * G / 2**11  # 12 bits over ±16 g: eight times the noise
    a = replace(a, values=np.rint(a.values / step) * step)
    found = find_positions([a], [w], G)
    assert len(found.positions) >= 18
    assert not any("saturated" in reason for _, reason in found.aside)


def test_in_motion_from_the_start():
    a, w, made = moved(14, initial=0.0)
    first = made["rests"][0]["end"] - 0.5
    a, w = (r.between(first, 1e9) for r in (a, w))
    found = find_positions([a], [w], G)
    made = made | {"rests": made["rests"][1:]}
    check_spans(found, made)
    assert np.isnan(found.scatters[0][0].initial[0])


def test_a_gyroscope_with_a_clock_of_its_own():
    a, w, made = moved(15)
    w = replace(w._rows(slice(None, None, 2)), file="gyro.csv", rate=RATE / 2)
    # Both files count from their own first sample on one clock: the gyroscope's starts 3 s later.
    late = w.between(3.0, 1e9)
    late = replace(late, time=late.time - late.time[0], start=3.0)
    found = find_positions([a], [late], G)
    check_spans(found, made)
    assert found.gyroscope is not None
    at_rest = np.array([s.std(axis=0).max() for s in found.gyroscope.samples[1:]])
    assert at_rest.max() < 5e-3  # rad/s: cut from rests, not from motions


def test_other_files_clocks_do_not_pair():
    a, w, _ = moved(16)
    assert beside(a, [replace(w, file="gyro.csv", start=1e6)]) is None
    assert beside(a, [replace(w, file="gyro.csv")]) is not None


def test_missing_samples_split_a_rest():
    a, w, made = moved(17)
    rest = made["rests"][5]
    middle = (rest["start"] + rest["end"]) / 2
    keep = (a.time < middle - 1) | (a.time > middle + 1)
    found = find_positions([a._rows(keep)], [w._rows(keep)], G)
    for start, end in found.positions.spans:
        assert not start < middle < end


def test_missing_values_and_repeated_stamps_are_left_out():
    a, w, made = moved(18)
    values, time = a.values.copy(), a.time.copy()
    values[100:110] = np.nan
    time[200] = time[199]
    found = find_positions([replace(a, values=values, time=time)], [w], G)
    check_spans(found, made)
    assert all(np.isfinite(s).all() for s in found.positions.samples)


@pytest.mark.parametrize("samples", [3, 49])
def test_too_short_a_recording(samples):
    a, _, _ = moved(19)
    with pytest.raises(Refusal, match=f"holds {samples} usable samples"):
        find_positions([a._rows(slice(samples))], [], G)


def test_never_at_rest():
    """Shaken throughout, what looks like a rest does not determine anything."""
    a, _, _ = moved(20)
    rng = np.random.default_rng(20)
    restless = replace(a, values=a.values + 3 * rng.standard_normal(a.values.shape))
    with pytest.raises(Refusal, match=r"do not determine 9 parameters|No rest"):
        calibrate_positions(restless._rows(slice(2000)), G)


def test_a_slow_turn_is_no_rest():
    """Half a degree a second for 20 s, smooth: quiet, but not still."""
    time = np.arange(0, 60, 1 / RATE)
    angle = np.radians(np.clip(time - 20, 0, 20) * 0.5)
    rng = np.random.default_rng(21)
    values = G * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    values += 0.01 * rng.standard_normal(values.shape)
    a = Recording("accelerometer", "positions", "log.csv", time, values, rate=RATE)
    found = find_positions([a], [], G)
    assert len(found.positions) == 0
    assert "turned by" in found.aside[0][1]


# --- labelled by hand ---


def labelled(a, made, shrink=0.3):
    return tuple(
        Segment(f"p{k}", r["start"] + shrink, r["end"] - shrink)
        for k, r in enumerate(made["rests"])
    )


def test_labels_are_kept():
    a, w, made = moved(30)
    found = find_positions([replace(a, segments=labelled(a, made))], [w], G)
    assert found.threshold is None
    assert found.sweep == ()
    assert found.positions.labels[3].startswith("p3 (")
    assert len(found.positions) == len(made["rests"])


def test_a_label_over_a_motion_is_set_aside_by_name():
    a, w, made = moved(31)
    segments = list(labelled(a, made))
    segments[6] = Segment("p6", segments[6].start, segments[7].end)
    found = find_positions([replace(a, segments=tuple(segments))], [w], G)
    ((label, reason),) = found.aside
    assert label.startswith("p6 (")
    assert "the device was in motion: its readings scatter" in reason


def test_labels_outside_the_recording_and_empty_ones():
    a, w, made = moved(32)
    more = (Segment("late", 1e5, 1e5 + 9), Segment("empty", 3.001, 3.002))
    found = find_positions([replace(a, segments=labelled(a, made) + more)], [w], G)
    assert not any(label.startswith(("late", "empty")) for label in found.positions.labels)


# --- wrong units, saturation ---


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1 / G, 'that is 1 g: declare unit = "g"'), (G, "gravity was multiplied twice"),
     (1e-3, "check unit and scale")],
)  # fmt: skip
def test_a_wrong_unit(factor, words):
    a, w, _ = moved(40)
    with pytest.raises(InputError) as caught:
        find_positions([replace(a, values=a.values * factor)], [w], G)
    assert "log.csv: unit: at rest the accelerometer reads" in str(caught.value)
    assert words in str(caught.value)


def test_saturation_at_one_g():
    a, w, _ = moved(41)
    found = find_positions([replace(a, values=np.clip(a.values, -9.5, 9.5))], [w], G)
    assert 2 <= len(found.aside) <= 8
    assert all(
        "is saturated" in reason and "choose a wider range" in reason for _, reason in found.aside
    )
    # What is left is not clipped.
    assert all(np.abs(s).max() < 9.5 for s in found.positions.samples)


def test_good_devices_lose_nothing_to_saturation():
    for seed in range(42, 47):
        a, w, _ = moved(seed)
        assert find_positions([a], [w], G).aside == ()


# --- six faces ---


@pytest.mark.parametrize("seed", range(3))
def test_faces_are_named_by_what_they_read(seed):
    order = np.random.default_rng([seed, 5]).permutation(6)
    a, _, _ = moved(50 + seed, [FACES[k] for k in order], 0.3, initial=0.0)
    found, up = find_faces([a], G)
    np.testing.assert_array_equal(up, np.array(FACES, dtype=float)[order])
    names = ["z up", "z down", "y up", "y down", "x up", "x down"]
    assert [label.split(" (")[0] for label in found.positions.labels] == [names[k] for k in order]


def test_a_rest_on_an_edge_is_no_face():
    a, _, _ = moved(60, (*FACES, (1, 1, 0)), 0.3, initial=0.0)
    found, up = find_faces([a], G)
    assert len(up) == 6
    assert "no axis is up or down" in found.aside[0][1]


def test_a_label_that_contradicts():
    a, _, made = moved(61, FACES, 0.3, initial=0.0)
    segments = [replace(s, label="x up") for s in labelled(a, made)]
    with pytest.raises(
        InputError, match=r"is labelled 'x up', but by its readings .* it is 'z up'"
    ):
        find_faces([replace(a, segments=tuple(segments))], G)


# --- parts ---


def test_scatter_is_relative_to_the_initial_rest():
    rng = np.random.default_rng(70)
    time = np.arange(0, 40, 1 / RATE)
    values = (
        rng.standard_normal((len(time), 3)) * np.where((time > 20) & (time < 30), 5.0, 1.0)[:, None]
    )
    scatter = rolling_scatter("accelerometer", time, values, RATE)
    inside = np.abs(time - 10) < 8
    # 51 samples on three axes: 6 % at 1 sd.
    assert np.abs(scatter.ratio[inside] - 1).max() < 0.35
    assert np.median(scatter.ratio[(time > 21) & (time < 29)]) == pytest.approx(5, rel=0.1)
    assert scatter.initial[0] == 0
    assert scatter.initial[1] == pytest.approx(20, abs=0.5)
    spans = quiet_spans([scatter], 2.0)
    assert len(spans) == 2


def test_constant_readings_have_no_infinite_ratio():
    values = np.tile([0.0, 0.0, G], (500, 1))
    scatter = rolling_scatter("accelerometer", np.arange(500) / RATE, values, RATE)
    assert np.isfinite(scatter.ratio).all()


def test_accelerometers_beside_a_gyroscope():
    a, w, _ = moved(80)

    class Device:
        def kinds(self, sensor):
            return ("positions",)

        def runs(self, sensor, kind):
            return (a, replace(a, file="check.csv", declaration={"check": True}))

    assert accelerometers_of(Device(), [w]) == (a,)
    with pytest.raises(Refusal, match="Record both sensors in one file"):
        accelerometers_of(Device(), [replace(w, file="other.csv", start=1e7)])


def test_a_face_clipped_throughout_is_saturated_though_seen_once():
    a, _, made = moved(90, FACES, 0.3, initial=0.0)
    rest = made["rests"][0]
    values = a.values.copy()
    inside = (a.time > rest["start"] - 1) & (a.time < rest["end"] + 0.2)
    values[inside] = np.minimum(values[inside], 9.3)
    found, up = find_faces([replace(a, values=values)], G)
    assert len(up) == 5
    assert any("saturated or frozen" in reason for _, reason in found.aside)


def test_a_stretch_of_zeros_is_no_rest():
    a, w, made = moved(91)
    rest = made["rests"][4]
    values = a.values.copy()
    values[(a.time > rest["start"]) & (a.time < rest["end"])] = 0.0
    found = find_positions([replace(a, values=values)], [w], G)
    assert any("throughout" in r or "is not gravity" in r for _, r in found.aside)


def test_rests_that_are_too_short_are_counted():
    a, w, _ = moved(92, seconds=(1.2, 1.3))
    found = find_positions([a], [w], G)
    # 18 rests and the initial one, most of them too short once their ends are cut.
    assert found.short >= 8
    assert found.short + len(found.positions) >= 18


def test_labels_outside_are_said():
    a, w, made = moved(93)
    more = (Segment("late", 1e5, 1e5 + 9),)
    found = find_positions([replace(a, segments=labelled(a, made) + more)], [w], G)
    assert ("late (100000.0–100009.0 s)", "it holds no sample of the recording") in found.aside
    with pytest.raises(InputError, match="no label lies within the recording"):
        find_positions([replace(a, segments=more)], [w], G)
