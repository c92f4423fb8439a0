"""From device files of a trajectory to the methods' arrays: what is wrong is told, the rest is used."""

import re
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sensorbook
from sensorbook import InputError, Recording, Refusal
from sensorbook.attitude.aiding import GyroscopeNoise, References
from sensorbook.attitude.kalman import mekf
from sensorbook.attitude.preparation import (
    Readings,
    ReferenceTrack,
    motion,
    on_stamps,
    readings,
    reference_track,
    vectors_on_stamps,
)
from sensorbook.attitude.propagation import propagate
from sensorbook.attitude.rotations import quaternion_from_matrix
from sensorbook.recordings.clock import measured_rate
from sensorbook.simulate import simulate, trajectory

RATE, ROWS = 50.0, 1000
TURN = np.array([0.3, -0.2, 0.5])  # rad/s, constant: the attitude at t is exp(TURN t)
ROUNDING = 1e-9  # the files hold ten digits and more

TOML = """
schema = 1
id = "imu"

[[recording]]
sensor = "gyroscope"
kind = "trajectory"
file = "gyroscope.csv"
unit = "{unit}"
columns = {{ time = "t", x = "gx", y = "gy", z = "gz" }}

[[recording]]
sensor = "accelerometer"
kind = "trajectory"
file = "accelerometer.csv"
unit = "m/s^2"
columns = {{ time = "t", x = "ax", y = "ay", z = "az" }}

[[recording]]
sensor = "reference"
kind = "trajectory"
file = "reference.csv"
columns = {{ time = "t", w = "qw", x = "qx", y = "qy", z = "qz" }}
quaternion = "{sense}"
"""


def true(time):
    """(N, 4), reference → body."""
    return Rotation.from_rotvec(np.outer(time, TURN)).as_quat()


def rates(time, rng=None):
    """(N, 4) rows t, gx, gy, gz of the constant turn, with some noise: a constant column is refused."""
    rng = rng or np.random.default_rng(1)
    return np.column_stack([time, TURN + rng.normal(0, 1e-6, (len(time), 3))])


def attitudes(time):
    """(N, 5) rows t, qx, qy, qz, qw."""
    return np.column_stack([time, true(time)])


def forces(time):
    """(N, 4) rows t, ax, ay, az, linear in time."""
    return np.column_stack([time, time, 2 * time, 9.8 - time])


@pytest.fixture
def device(tmp_path):
    """Writes a device folder and loads it; tables that are not given are without faults."""
    time = np.arange(ROWS) / RATE

    def write(
        gyroscope=None,
        reference=None,
        accelerometer=None,
        unit="rad/s",
        sense="body_to_reference",
    ):
        tables = {
            "gyroscope": ("t,gx,gy,gz", rates(time) if gyroscope is None else gyroscope),
            "accelerometer": (
                "t,ax,ay,az",
                forces(time) if accelerometer is None else accelerometer,
            ),
            "reference": ("t,qx,qy,qz,qw", attitudes(time) if reference is None else reference),
        }
        for name, (header, table) in tables.items():
            lines = [
                ",".join("" if np.isnan(v) else f"{v:.12g}" for v in row) for row in table.tolist()
            ]
            (tmp_path / f"{name}.csv").write_text("\n".join([header, *lines]) + "\n")
        (tmp_path / "device.toml").write_text(TOML.format(unit=unit, sense=sense))
        return sensorbook.load(tmp_path)

    return write


@pytest.fixture
def time():
    return np.arange(ROWS) / RATE


def gyroscope_of(device):
    return readings(device.gyroscope.trajectory)


def track_of(device):
    return reference_track(device.reference.trajectory)


# ---- the gyroscope's readings ----


def test_a_faultless_record_is_taken_as_it_is(device, time):
    found = gyroscope_of(device())
    assert found.notes == ()
    assert found.time == pytest.approx(time, abs=ROUNDING)
    assert found.rate == pytest.approx(rates(time)[:, 1:], abs=ROUNDING)
    assert found.lost.shape == (ROWS - 1,)
    assert not found.lost.any()


def test_time_is_on_the_file_s_own_clock(device, time):
    """Readings and references of two files whose first rows are not at one time."""
    made = device(gyroscope=rates(time + 1000), reference=attitudes(time[100:] + 1000))
    assert gyroscope_of(made).time[0] == pytest.approx(1000, abs=ROUNDING)
    assert track_of(made).time[0] == pytest.approx(1002, abs=ROUNDING)


def test_repeated_stamps_are_set_aside(device, time):
    found = gyroscope_of(device(np.repeat(rates(time), 1 + (np.arange(ROWS) % 10 == 0), axis=0)))
    assert found.time == pytest.approx(time, abs=ROUNDING)
    assert found.notes == (
        "100 rows of the gyroscope whose time stamp does not advance: set aside.",
    )


def test_a_block_out_of_order_is_set_aside(device, time):
    """The second to third second stand at the end of the file."""
    order = np.r_[0:50, 100:ROWS, 50:100]
    found = gyroscope_of(device(rates(time)[order]))
    assert len(found.time) == ROWS - 50
    assert (np.diff(found.time) > 0).all()
    assert found.lost.sum() == 1
    assert found.notes[0] == (
        "50 rows of the gyroscope whose time stamp does not advance: set aside."
    )
    assert found.notes[1].startswith("A gap in the gyroscope's readings, of 1.02 s at 0.98 s")


def test_unsorted_stamps_are_refused(device, time):
    order = np.random.default_rng(2).permutation(ROWS)
    with pytest.raises(Refusal) as caught:
        gyroscope_of(device(rates(time)[order]))
    assert re.fullmatch(
        r"gyroscope.csv: only \d+ of the gyroscope's 1000 rows can be used. "
        r"\d+ rows of the gyroscope whose time stamp does not advance: set aside, as the file's rows are "
        "not sorted by time.",
        caught.value.reason,
    )
    assert caught.value.remedy == "Sort the file's rows by time."


def test_many_repeated_stamps_are_no_want_of_order(device, time):
    """Twice as many rows as stamps and one: a clock that ticks too seldom, and that nothing sorts."""
    table = np.repeat(rates(time[:300]), 3, axis=0)
    with pytest.raises(Refusal, match=r"does not advance: set aside\.") as caught:
        gyroscope_of(device(table))
    assert caught.value.remedy.startswith("Record again without losses")


def test_rows_without_a_stamp_are_told_as_such(device, time):
    table = rates(time)
    table[[100, 300], 0] = np.nan
    table[500, 0] = table[499, 0]
    found = gyroscope_of(device(table))
    assert len(found.time) == ROWS - 3
    assert found.notes[:2] == (
        "2 rows of the gyroscope without a time stamp: left out.",
        "1 row of the gyroscope whose time stamp does not advance: set aside.",
    )


def test_a_gap_of_5_s_loses_one_step(device, time):
    found = gyroscope_of(device(rates(np.delete(time, np.s_[301:550]))))
    assert np.flatnonzero(found.lost).tolist() == [300]
    assert found.notes == (
        "A gap in the gyroscope's readings, of 5 s at 6 s, cannot be bridged: the attitude is not "
        "known across it; each method goes on from the next reference.",
    )


def test_the_longest_of_several_gaps_is_named(device, time):
    kept = np.delete(time, np.r_[101:121, 301:340, 700:710])
    found = gyroscope_of(device(rates(kept)))
    assert found.lost.sum() == 3
    assert "3 gaps in the gyroscope's readings, the longest of 0.8 s at 6 s" in found.notes[0]
    assert "not known across them" in found.notes[0]


def test_an_hour_s_gap_is_told_in_minutes(device, time):
    late = np.where(np.arange(ROWS) < 500, time, time + 3600)
    assert "of 60 min at 9.98 s" in gyroscope_of(device(rates(late))).notes[0]


def test_short_gaps_are_bridged(device, time):
    """5 intervals are bridged, 6 are not: at 50 Hz 0.1 s are 5 as well."""
    found = gyroscope_of(device(rates(np.delete(time, np.r_[101:105, 201:206]))))
    assert np.flatnonzero(found.lost).tolist() == [196]
    assert "4 readings of the gyroscope missing in 1 short gap: bridged linearly." in found.notes
    assert motion(found).increments[100] == pytest.approx(TURN * 5 / RATE, abs=1e-6)


def test_readings_without_a_rate_are_left_out(device, time):
    table = rates(time)
    table[[10, 11], 1] = np.nan
    table[500:520, 1:] = np.nan
    found = gyroscope_of(device(table))
    assert len(found.time) == ROWS - 22
    assert np.isfinite(found.rate).all()
    assert np.flatnonzero(found.lost).tolist() == [497]
    assert found.notes[0] == "22 of the gyroscope's 1000 rows (2.2 %) hold no rate: left out."
    assert found.notes[1].startswith("2 readings of the gyroscope missing in 1 short gap")
    assert found.notes[2].startswith("A gap in the gyroscope's readings, of 0.42 s at 9.98 s")


def test_a_value_that_stands_twice_is_used_where_its_first_is_empty(device, time):
    table = np.repeat(rates(time), 2, axis=0)
    table[::2, 1] = np.nan
    found = gyroscope_of(device(table))
    assert found.time == pytest.approx(time, abs=ROUNDING)


def test_more_than_half_without_a_rate_is_refused(device, time):
    table = rates(time)
    table[:501, 3] = np.nan
    with pytest.raises(Refusal, match="only 499 of the gyroscope's 1000 rows can be used"):
        gyroscope_of(device(table))


def test_fewer_than_100_readings_are_refused(device, time):
    table = rates(time[:110])
    table[:11, 1] = np.nan
    with pytest.raises(Refusal, match="only 99 of the gyroscope's 110 rows"):
        gyroscope_of(device(table))


def test_without_a_time_base_it_is_refused(time):
    recording = Recording("gyroscope", "trajectory", "a.csv", time, rates(time)[:, 1:])
    with pytest.raises(Refusal, match=r"a.csv: the gyroscope has no time base") as caught:
        readings(recording)
    assert "columns.time" in caught.value.remedy


@pytest.mark.parametrize("speed", [40.0, 1900.0])
def test_degrees_declared_as_radians(device, time, speed):
    """40 °/s are within a gyroscope's range as rad/s no more than 1900 °/s are."""
    table = rates(time)
    table[:, 1:] += np.array([speed, 0, 0]) * np.sign(np.sin(time))[:, None]
    with pytest.raises(InputError) as caught:
        gyroscope_of(device(table))
    (problem,) = caught.value.problems
    assert (problem.file, problem.where) == ("gyroscope.csv", "gyroscope: unit")
    assert problem.message == (
        f"in 'rad/s' it reads {np.sqrt((table[:, 1:] ** 2).sum(axis=1).mean()):.3g} rad/s rms, more than "
        "2000 °/s, the range of common gyroscopes"
    )
    assert problem.mend == 'write unit = "deg/s" if the file holds degrees a second'
    assert gyroscope_of(device(table, unit="deg/s")).notes == ()


def test_a_turn_that_cannot_be_followed():
    """30 rad/s at 20 Hz: 1.5 rad from sample to sample."""
    time = np.arange(200) / 20
    rate = np.column_stack([np.full(200, 30.0), np.sin(time), np.cos(time)])
    recording = Recording(
        "gyroscope", "trajectory", "a.csv", time, rate, rate=20.0, declaration={"unit": "rad/s"}
    )
    with pytest.raises(InputError, match=r"a turn of 1.5 rad from sample to sample") as caught:
        readings(recording)
    assert caught.value.problems[0].mend.endswith("otherwise record at a higher rate")


def test_counts_are_told_by_their_scale():
    time = np.arange(200) / RATE
    rate = np.column_stack([np.full(200, 80.0), np.sin(time), np.cos(time)])
    scale = {"factor": 1.0, "unit": "rad/s"}

    def problem(**declaration):
        recording = Recording(
            "gyroscope", "trajectory", "a", time, rate, rate=RATE, declaration=declaration
        )
        with pytest.raises(InputError) as caught:
            readings(recording)
        return caught.value.problems[0]

    assert problem(unit="counts", scale=scale).where == "gyroscope: scale.unit"
    assert 'scale.unit = "deg/s"' in problem(unit="counts", scale=scale).mend
    assert problem(unit="counts", scale=scale | {"unit": "rpm"}).mend == "check scale"
    assert problem(unit="rpm").mend == "check unit"


def test_single_readings_that_no_gyroscope_gives_are_left_out(device, time):
    """One of 1e5 rad/s would be an rms of 3000 rad/s, and no unit's fault."""
    table = rates(time)
    table[[200, 201], 1] = [1e5, -1e5]
    found = gyroscope_of(device(table))
    assert "2 rows of the gyroscope beyond 105 rad/s: left out." in found.notes
    assert np.abs(found.rate).max() < 1


# ---- the motion ----


def test_increments_of_a_constant_turn(device):
    found = motion(gyroscope_of(device()))
    # 1e-6 rad/s of noise over an interval of 0.02 s
    assert found.increments == pytest.approx(np.tile(TURN / RATE, (ROWS - 1, 1)), abs=1e-7)
    assert not found.lost.any()


def test_the_delay_reaches_the_increments(time):
    """ω = a t read late by d: the rotation over a step is a (middle + d) h, but for the last, held."""
    rate = np.column_stack([0.01 * time, 0 * time, 0 * time])
    taken = Readings(time, rate, np.zeros(ROWS - 1, dtype=bool))
    middle = (time[1:] + time[:-1]) / 2
    found = motion(taken, delay=0.01).increments[:-1, 0]
    assert found == pytest.approx(0.01 * (middle[:-1] + 0.01) / RATE, abs=1e-12)


@pytest.mark.parametrize(("gap", "unknown"), [(0.5, False), (60.0, True)])
def test_variance_of_a_lost_step(gap, unknown):
    time = np.r_[np.arange(200) / RATE, 199 / RATE + gap + np.arange(200) / RATE]
    lost = np.zeros(399, dtype=bool)
    lost[199] = True
    found = motion(Readings(time, np.tile(TURN, (400, 1)), lost))
    expected = np.pi**2 / 3 if unknown else (gap * np.linalg.norm(TURN)) ** 2
    assert found.lost[199] == pytest.approx(expected, rel=1e-9)
    assert np.count_nonzero(found.lost) == 1
    assert found.increments[199] == pytest.approx(TURN * gap, abs=1e-9)


def test_a_filter_goes_on_from_the_next_reference_after_a_gap(device, time):
    """The body turns otherwise during 5 s without readings: the covariance says so until it is seen."""
    rng = np.random.default_rng(3)
    kept = np.delete(np.arange(ROWS), np.s_[301:550])
    table = rates(time, rng)[kept]
    turned = Rotation.from_rotvec([0.4, -0.5, 0.3])
    path = true(time)
    path[550:] = (turned * Rotation.from_quat(path[550:])).as_quat()
    errors = Rotation.from_rotvec(rng.normal(0, 1e-3, (ROWS, 3)))
    reference = np.column_stack([time, (Rotation.from_quat(path) * errors).as_quat()])
    made = device(table, reference)
    taken, track = gyroscope_of(made), track_of(made)
    moved = motion(taken)
    at, quaternion = on_stamps(taken, track, moved)
    references = References(at, quaternion, np.tile(1e-6 * np.eye(3), (len(at), 1, 1)))
    references = references.where(kept[at] % 100 == 0)  # one in 2 s
    found = mekf(moved, references, GyroscopeNoise(1e-4, bias_std=1e-3))
    error = np.linalg.norm(found.errors(path[kept]), axis=1)
    after = np.searchsorted(kept, 600)  # the first reference beyond the gap
    assert error[after - 1] > 0.3
    assert np.nanmax(found.nees(path[kept])) < 25  # χ² of 3: beyond with a chance of 2e-5
    assert error[after:].max() < 5e-3


# ---- the reference ----


def test_a_faultless_reference_is_taken_as_it_is(device, time):
    found = track_of(device())
    assert found.notes == ()
    assert found.time == pytest.approx(time, abs=ROUNDING)
    assert found.quaternion == pytest.approx(true(time), abs=ROUNDING)


def test_sense_of_the_file(device, time):
    """A file's reference_to_body holds the inverse: q v_ref q* = v_body."""
    reference = attitudes(time) * [1, -1, -1, -1, 1]
    found = track_of(device(reference=reference, sense="reference_to_body"))
    assert found.quaternion == pytest.approx(true(time), abs=ROUNDING)


def test_missing_attitudes_are_left_out(device, time):
    """Empty cells, and zeros, as a tracker writes that has lost its target."""
    reference = attitudes(time)
    reference[10:20, 1] = np.nan
    reference[40:60, 1:] = 0
    found = track_of(device(reference=reference))
    assert len(found.time) == ROWS - 30
    assert found.notes == ("30 of the reference's 1000 rows (3 %) hold no attitude: left out.",)


def test_a_reference_out_of_order(device, time):
    reference = np.concatenate([attitudes(time), attitudes(time[300:310]), attitudes(time[-1:])])
    found = track_of(device(reference=reference))
    assert found.time == pytest.approx(time, abs=ROUNDING)
    assert found.notes == (
        "11 rows of the reference whose time stamp does not advance: set aside.",
    )


def test_lengths_a_little_off_are_made_unit(device, time):
    reference = attitudes(time)
    reference[:, 1:] *= 1.0005  # as four digits leave it: nothing to say
    reference[:3, 1:] *= 1.02
    found = track_of(device(reference=reference))
    assert found.quaternion == pytest.approx(true(time), abs=ROUNDING)
    assert found.notes == (
        "3 quaternions of the reference not of unit length (one has 1.021): made so.",
    )


def test_one_wild_row_is_set_aside(device, time):
    reference = attitudes(time)
    reference[400, 1:] = [3, 4, 0, 0]
    found = track_of(device(reference=reference))
    assert len(found.time) == ROWS - 1
    assert found.notes == (
        "1 row of the reference no unit quaternion (row 401 has the length 5): set aside.",
    )


@pytest.mark.parametrize("factor", [0.5, 2.0, 57.3])
def test_a_reference_that_is_not_unit(device, time, factor):
    reference = attitudes(time)
    reference[20:, 1:] *= factor
    with pytest.raises(InputError) as caught:
        track_of(device(reference=reference))
    (problem,) = caught.value.problems
    assert str(problem) == (
        f"reference.csv: reference: columns qw qx qy qz: row 21 has the length {factor:g}, where a "
        "quaternion has 1; off by more than 5 %: 980 of 1000 rows — name the columns that hold w, x, "
        "y and z of unit quaternions"
    )


def test_more_than_1_percent_of_wild_rows_are_no_accident(device, time):
    reference = attitudes(time)
    reference[:10, 1:] *= 3
    assert (
        "10 rows of the reference no unit quaternion"
        in track_of(device(reference=reference)).notes[0]
    )
    reference[10, 1:] *= 3
    with pytest.raises(InputError, match="off by more than 5 %: 11 of 1000 rows"):
        track_of(device(reference=reference))


def test_a_constant_reference_is_one(device, time):
    reference = np.column_stack([time, np.tile([0.5, -0.5, 0.5, 0.5], (ROWS, 1))])
    found = track_of(device(reference=reference))
    assert len(found.time) == ROWS
    assert found.notes == ()


def test_fewer_than_two_attitudes_are_refused(device, time):
    reference = attitudes(time)
    reference[1:, 1] = np.nan
    with pytest.raises(Refusal, match="only 1 of the reference's 1000 rows") as caught:
        track_of(device(reference=reference))
    assert "leave it out" in caught.value.remedy


def test_a_reference_by_hand_states_its_sense(time):
    recording = Recording("reference", "trajectory", "a", time, true(time), rate=RATE)
    with pytest.raises(InputError, match=r'reference: quaternion: .*"body_to_ref'):
        reference_track(recording)


def test_matrices_that_are_no_rotation():
    """A library user's reference as direction-cosine matrices."""
    matrix = np.tile(np.eye(3), (5, 1, 1))
    matrix[3, 0, 1] = 0.01
    with pytest.raises(ValueError, match=r"differs from the identity by 0\.01; it is no rotation"):
        quaternion_from_matrix(matrix)
    with pytest.raises(ValueError, match="determinant is −1"):
        quaternion_from_matrix(np.diag([1.0, 1.0, -1.0]))


# ---- onto the readings' stamps ----


def test_references_between_stamps_are_turned_to_the_nearest(time):
    """Exact for a constant rate; 0.3 of an interval late, and 0.7, which is nearer to the next."""
    taken = Readings(time, np.tile(TURN, (ROWS, 1)), np.zeros(ROWS - 1, dtype=bool))
    own = np.array([10.3, 20.7, 30.0, 998.7]) / RATE
    at, quaternion = on_stamps(taken, ReferenceTrack(own, true(own)), motion(taken))
    assert at.tolist() == [10, 21, 30, 999]
    apart = Rotation.from_quat(true(time[at])).inv() * Rotation.from_quat(quaternion)
    assert apart.magnitude().max() < 1e-12


def test_references_just_beyond_the_ends_are_used_and_farther_ones_are_not(time):
    taken = Readings(time, np.tile(TURN, (ROWS, 1)), np.zeros(ROWS - 1, dtype=bool))
    own = np.array([-0.6, -0.4, 999.4, 999.6]) / RATE
    at, quaternion = on_stamps(taken, ReferenceTrack(own, true(own)), motion(taken))
    assert at.tolist() == [0, 999]
    apart = Rotation.from_quat(true(time[at])).inv() * Rotation.from_quat(quaternion)
    assert apart.magnitude().max() < 1e-12
    own = np.array([-0.6, 500, 999.6]) / RATE
    at, _ = on_stamps(taken, ReferenceTrack(own, true(own)), motion(taken))
    assert at.tolist() == [500]


def test_of_two_references_at_one_stamp_the_nearer_is_taken(time):
    taken = Readings(time, np.zeros((ROWS, 3)), np.zeros(ROWS - 1, dtype=bool))
    own = np.array([9.6, 9.9, 10.2, 20.0]) / RATE
    marked = Rotation.from_rotvec(np.outer([1, 2, 3, 4], [0.1, 0, 0])).as_quat()
    at, quaternion = on_stamps(taken, ReferenceTrack(own, marked), motion(taken))
    assert at.tolist() == [10, 20]
    assert quaternion == pytest.approx(marked[[1, 3]], abs=1e-12)


@pytest.mark.parametrize(("late", "used"), [(0.0, True), (1e-7, True), (0.006, False)])
def test_no_reference_is_moved_within_a_lost_step(device, time, late, used):
    """One as good as at the gap's first stamp is there; 0.3 of an interval into the gap is lost."""
    made = device(rates(np.delete(time, np.s_[301:551])), attitudes(time[::5] + late))
    taken = gyroscope_of(made)
    at, _ = on_stamps(taken, track_of(made), motion(taken))
    there = time[::5][(time[::5] < 6) | ((time[::5] == 6) & used) | (time[::5] > 11.01)]
    assert taken.time[at] == pytest.approx(there, abs=1e-9)


def test_no_overlap_is_refused_with_both_spans(device, time):
    made = device(reference=attitudes(time + 1.7e9))
    taken = gyroscope_of(made)
    with pytest.raises(Refusal) as caught:
        on_stamps(taken, track_of(made), motion(taken))
    assert "gyroscope's stamps go from 0 s to 19.98 s" in caught.value.reason
    assert "the reference's from 1700000000 s to 1700000019.98 s" in caught.value.reason
    assert caught.value.remedy == "Stamp both by one clock."


def test_vectors_at_the_readings_stamps(device, time):
    """Linear in time, so that interpolation is exact; taken at other stamps, 0.1 to 19.93 s."""
    own = np.arange(0.1, 19.94, 1 / 30)
    made = device(accelerometer=forces(own))
    taken = gyroscope_of(made)
    found = vectors_on_stamps(taken, made.accelerometer.trajectory)
    inside = (time >= 0.1) & (time <= own[-1])
    assert np.isnan(found[~inside]).all()
    assert found[inside] == pytest.approx(forces(time)[inside, 1:], abs=1e-8)


def test_vectors_across_a_long_gap_are_not_known(device, time):
    """A gap of 1 s, one of 0.08 s, one row empty, and one as no accelerometer reads."""
    table = forces(time)
    table[500, 1] = np.nan
    table[600, 1] = 1e6
    made = device(accelerometer=np.delete(table, np.r_[101:150, 301:304], axis=0))
    taken = gyroscope_of(made)
    found = vectors_on_stamps(taken, made.accelerometer.trajectory)
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == list(range(101, 150))
    known = np.isfinite(found)
    assert found[known] == pytest.approx(forces(time)[:, 1:][known], abs=1e-8)


def test_vectors_at_another_time_are_not_known(device, time):
    made = device(accelerometer=forces(time + 500))
    assert np.isnan(vectors_on_stamps(gyroscope_of(made), made.accelerometer.trajectory)).all()


# ---- work C's experiment, as a device ----


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("devices") / "poor", "trajectory", seed=4)


def test_the_simulated_reference_is_the_truth_but_for_its_error(simulated):
    """The file holds reference_to_body; none from 12 to 20 s, and 3 % missing elsewhere."""
    device = sensorbook.load(simulated)
    taken, track = gyroscope_of(device), track_of(device)
    moved = motion(taken, delay=0.0175)
    at, quaternion = on_stamps(taken, track, moved)
    assert taken.notes == ()
    assert re.fullmatch(
        r"\d+ of the reference's \d+ rows \(\d.\d %\) hold no attitude: left out.", track.notes[0]
    )
    assert not ((taken.time[at] >= 12) & (taken.time[at] < 20)).any()
    truth = trajectory.motion()
    error = Rotation.from_quat(truth.true[at]).inv() * Rotation.from_quat(quaternion)
    # 15 000 white errors: their rms within 4 standard errors, 4/√(2 · 15 000)
    rms = np.sqrt((error.as_rotvec() ** 2).mean())
    assert rms == pytest.approx(trajectory.REFERENCE_ERROR, rel=0.024)


def test_its_rates_declared_as_radians(simulated, tmp_path):
    shutil.copytree(simulated, tmp_path / "poor")
    toml = tmp_path / "poor" / "device.toml"
    text = toml.read_text()
    assert text.count('unit = "deg/s"') == 1
    toml.write_text(text.replace('unit = "deg/s"', 'unit = "rad/s"'))
    with pytest.raises(InputError, match=r'gyroscope: unit: .*write unit = "deg/s"'):
        gyroscope_of(sensorbook.load(tmp_path / "poor"))


# ---- whatever is in the files ----

ROW = st.integers(0, 199)
SOME = st.lists(ROW, max_size=120)


@settings(max_examples=150, deadline=None)
@given(
    swapped=st.lists(st.tuples(ROW, ROW), max_size=150),
    repeated=SOME,
    empty=SOME,
    unstamped=SOME,
    wild=SOME,
    size=st.sampled_from([0.0, 1.03, 7.0, 1e4]),
)
def test_whatever_is_wrong_what_comes_out_ascends_and_is_finite(
    swapped, repeated, empty, unstamped, wild, size
):
    order = np.arange(200)
    for one, other in swapped:
        order[[one, other]] = order[[other, one]]
    times = np.ones(200, dtype=int)
    times[repeated] = 2
    order = np.repeat(order, times)
    stamps = np.arange(200) / RATE
    rate, quaternion = rates(stamps)[:, 1:], true(stamps)
    rate[empty], quaternion[empty] = np.nan, np.nan
    rate[wild] *= size
    quaternion[wild] *= size
    stamps[unstamped] = np.nan
    stamps, rate, quaternion = stamps[order], rate[order], quaternion[order]
    clock = measured_rate(stamps)
    gyroscope = Recording(
        "gyroscope", "trajectory", "a", stamps, rate, rate=clock, declaration={"unit": "rad/s"}
    )
    reference = Recording(
        "reference", "trajectory", "a", stamps, quaternion, rate=clock,
        declaration={"quaternion": "body_to_reference"},
    )  # fmt: skip
    taken, track = outcome(readings, gyroscope), outcome(reference_track, reference)
    if taken:
        assert (np.diff(taken.time) > 0).all()
        assert np.isfinite(taken.rate).all()
        moved = motion(taken)
        assert np.isfinite(moved.increments).all()
        assert (moved.lost <= np.pi**2 / 3).all()
    if track:
        assert (np.diff(track.time) > 0).all()
        # Whatever was scaled is unit again, or gone.
        assert track.quaternion == pytest.approx(true(track.time), abs=1e-12)
    if taken and track and (placed := outcome(on_stamps, taken, track, moved)):
        at, quaternion = placed
        assert (np.diff(at) > 0).all()
        assert np.isfinite(quaternion).all()


def outcome(method, *arguments):
    """Its result, or None where it says why there is none; any other exception is a fault."""
    try:
        return method(*arguments)
    except (Refusal, InputError):
        return None


# ---- a real recording ----


def test_a_recording_with_an_optical_reference(real_data):
    """171 of 5324 attitudes are missing; all stamps are the gyroscope's."""
    device = sensorbook.load(real_data / "broad-slow")
    taken, track = gyroscope_of(device), track_of(device)
    assert taken.notes == ()
    assert not taken.lost.any()
    assert track.notes == ("171 of the reference's 5324 rows (3.2 %) hold no attitude: left out.",)
    # Its readings are means over the interval before the stamp.
    moved = motion(taken, delay=0.0175)
    at, quaternion = on_stamps(taken, track, moved)
    assert (len(taken.time), len(at)) == (5324, 5153)
    assert quaternion == pytest.approx(track.quaternion, abs=1e-9)
    force = vectors_on_stamps(taken, device.accelerometer.trajectory)
    assert force == pytest.approx(device.accelerometer.trajectory.values, abs=1e-9)
    # Ten seconds by the gyroscope alone: its bias of 0.33 °/s makes 3.3° of it, no sense but one less.
    start, end = at[0], at[np.searchsorted(taken.time[at], taken.time[at[0]] + 10)]
    alone = propagate(moved.increments[start:end], quaternion[0])[-1]
    there = quaternion[np.searchsorted(at, end)]
    apart = Rotation.from_quat(alone).inv() * Rotation.from_quat(there)
    assert np.degrees(apart.magnitude()) < 5
