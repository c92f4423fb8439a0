"""Presets `leo`, `meo`, `geo`: cameras in orbit, readable, and true to what truth.json says."""

import json

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sensorbook
from sensorbook.attitude.rotations import error_vector, matrix_from_quaternion
from sensorbook.camera.attitude import attitude_from_image
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_CAMERA, EARTH_RADIUS, HEIGHTS
from sensorbook.earth import GRAVITATION, sun_direction
from sensorbook.recordings import check
from sensorbook.simulate import simulate
from sensorbook.simulate.camera import CAMERAS, PLANES, START, frames, places
from sensorbook.simulate.folder import SimulatedDevice, write

# Of 180 frames and pairs, seeds 0 to 5 of three orbits, the largest error was 0.08°.
TOLERANCE = 0.1  # degrees


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("orbit") / "cameras", "leo", seed=5)


@pytest.fixture(scope="session")
def recordings(folder):
    return dict(zip(CAMERAS, sensorbook.load(folder).runs("camera", "images"), strict=True))


@pytest.fixture(scope="session")
def truth(folder):
    return json.loads((folder / "truth.json").read_text())["images"]


def image_of(recording, name):
    return cv2.imread(str(recording.paths[recording.names.index(name)]), cv2.IMREAD_GRAYSCALE)


def degrees_off(found, quaternion):
    return np.degrees(
        np.linalg.norm(error_vector(found.matrix, matrix_from_quaternion(quaternion)))
    )


# ---- the folder ----


def test_nothing_to_mend(folder):
    assert check(folder) == ([], [])


def test_recordings(recordings):
    assert {name: (run.file, len(run)) for name, run in recordings.items()} == {
        "one": ("one/*.png", 8),
        "earth": ("earth/*.png", 5),
        "sun": ("sun/*.png", 5),
    }
    assert [run.camera["sees"] for run in recordings.values()] == ["both", "earth", "sun"]
    for name, run in recordings.items():
        assert run.camera["earth_radius"] == 6371e3
        assert set(run.poses) == set(run.names)
        camera = Camera.of(run.camera)
        assert (camera.width, camera.height, camera.focal_px) == (1280, 720, 369.5)
        # Declared matrices are made orthonormal: rounding alone may differ.
        np.testing.assert_allclose(camera.to_body, CAMERAS[name].to_body, rtol=0, atol=1e-14)


def test_the_printed_mounting_is_made_orthonormal(recordings):
    turn = np.array(recordings["earth"].camera["to_body"])
    # Rounding of three products, which differs from processor to processor.
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), rtol=0, atol=4e-15)
    np.testing.assert_allclose(turn, EARTH_CAMERA, rtol=0, atol=1e-4)  # printed to four digits


def test_same_seed_same_bytes(tmp_path):
    def digest(place, seed):
        images, poses, truth = frames(np.random.default_rng(seed), "leo", 1, 0)
        write(SimulatedDevice("", images | {"poses.csv": poses}, truth), place)
        files = (p for p in place.rglob("*") if p.is_file())
        return {p.relative_to(place).as_posix(): p.read_bytes() for p in files}

    one, again, other = (digest(tmp_path / str(k), seed) for k, seed in enumerate((5, 5, 6)))
    assert one == again
    names = {"one/0001.png", "poses.csv", "truth.json"}
    assert set(one) == {*names, "device.toml"}
    assert all(one[name] != other[name] for name in names)


def test_an_image_is_written_as_it_is(tmp_path):
    image = np.random.default_rng(5).integers(0, 256, (30, 40), dtype=np.uint8)
    write(SimulatedDevice("", {"a/b/c.png": image}, {}), tmp_path / "d")
    read = cv2.imread(str(tmp_path / "d" / "a" / "b" / "c.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, image)


# ---- orbits ----


@pytest.mark.parametrize("orbit", HEIGHTS)
def test_places_are_of_one_revolution_with_the_sun_clear_of_the_earth(orbit):
    times, position, sun = places(orbit, 8)
    distance = EARTH_RADIUS + HEIGHTS[orbit]
    np.testing.assert_allclose(np.linalg.norm(position, axis=1), distance, atol=2e-3)  # as written
    inclination = np.radians(PLANES[orbit][0])
    normal = np.cross(position[-2], position[-1])  # less than half a revolution apart
    assert normal[2] / np.linalg.norm(normal) == pytest.approx(np.cos(inclination), abs=1e-9)
    rate = np.sqrt(GRAVITATION / distance**3)
    passed = (times - START).astype(float)
    assert 0 <= passed[0] < passed[-1] < 2 * np.pi / rate
    assert (np.diff(passed) > 0).all()
    moved = (position[:-1] * position[1:]).sum(axis=1) / distance**2
    np.testing.assert_allclose(moved, np.cos(rate * np.diff(passed)), atol=1e-9)
    above = np.degrees(np.arccos(-(position * sun).sum(axis=1) / distance))
    above -= np.degrees(np.arcsin(EARTH_RADIUS / distance))
    assert above.min() > 30
    assert above.max() < 95


def test_both_cameras_of_a_pair_have_one_pose(recordings):
    for down, up in zip(
        *(recordings[name].poses.values() for name in ("earth", "sun")), strict=True
    ):
        assert down.time == up.time
        np.testing.assert_array_equal(down.position, up.position)
        np.testing.assert_array_equal(down.quaternion, up.quaternion)


# ---- truth ----


def test_truth_follows_from_the_poses(recordings, truth):
    assert set(truth) == {name for run in recordings.values() for name in run.names}
    for run in recordings.values():
        to_body = Rotation.from_matrix(run.camera["to_body"])
        # The quaternion turns the inertial axes into the body's; what is seen turns the other way.
        for name, pose in run.poses.items():
            true, distance = truth[name], np.linalg.norm(pose.position)
            turn = to_body.inv() * Rotation.from_quat(pose.quaternion).inv()
            np.testing.assert_allclose(
                true["earth_direction"], turn.apply(-pose.position / distance), atol=1e-12
            )
            sun = sun_direction(pose.time, pose.position)
            np.testing.assert_allclose(true["sun_direction"], turn.apply(sun), atol=1e-12)
            np.testing.assert_allclose(true["quaternion"], pose.quaternion, atol=1e-12)
            assert np.sin(np.radians(true["earth_angular_radius_deg"])) == pytest.approx(
                6371 / 8371, abs=1e-9
            )


def test_what_is_in_view(truth):
    def where(folder, what):
        return [truth[name][f"{what}_in_view"] for name in sorted(truth) if name.startswith(folder)]

    assert where("one", "sun") == [True] * 6 + [False, True]
    assert where("one", "earth") == [True] * 7 + [False]
    assert where("sun", "sun") == [True] * 4 + [False]
    assert where("earth", "earth") == [True] * 5


def test_images_show_what_truth_says(recordings, truth):
    for folder, run in recordings.items():
        for name in run.names:
            image, true, camera = image_of(run, name), truth[name], CAMERAS[folder]
            dark = image.copy()
            if true["sun_in_view"]:
                x, y = np.rint(camera.project(true["sun_direction"])).astype(int)
                assert image[y, x] > 245  # less its noise
                dark[max(y - 6, 0) : y + 7, max(x - 6, 0) : x + 7] = 0  # its disc and around
            assert dark.max() < 240
            # Beyond six sigmas of noise.
            assert ((dark > 12).sum() > 500) == true["earth_in_view"], name


def test_one_camera_finds_its_attitude(recordings, truth):
    run = recordings["one"]
    camera, statuses = Camera.of(run.camera), []
    for name, pose in run.poses.items():
        sun = sun_direction(pose.time, pose.position)
        found = attitude_from_image(image_of(run, name), camera, pose.position, sun)
        statuses.append(found.status)
        if found.matrix is not None:
            assert degrees_off(found, truth[name]["quaternion"]) < TOLERANCE, name
    no = "no solution: {} not in view"
    assert statuses == ["ok"] * 6 + [no.format("Sun"), no.format("Earth")]


def test_two_cameras_find_their_attitude(recordings, truth):
    down, up = recordings["earth"], recordings["sun"]
    looks_down, looks_up = Camera.of(down.camera), Camera.of(up.camera)
    statuses = []
    for name, other in zip(down.names, up.names, strict=True):
        pose = down.poses[name]
        sun = sun_direction(pose.time, pose.position)
        found = attitude_from_image(
            image_of(down, name),
            looks_down,
            pose.position,
            sun,
            sun_view=(image_of(up, other), looks_up),
        )
        statuses.append(found.status)
        if found.matrix is not None:
            assert degrees_off(found, truth[name]["quaternion"]) < TOLERANCE, name
    assert statuses == ["ok"] * 4 + ["no solution: Sun not in view"]


@pytest.mark.parametrize("orbit", ["meo", "geo"])
def test_the_other_orbits(orbit):
    images, poses, truth = frames(np.random.default_rng([5, 1]), orbit, alone=1, pairs=0)
    assert list(images) == list(truth) == poses["image"] == ["one/0001.png"]
    position = np.array([poses[axis][0] for axis in "xyz"])
    sun = sun_direction(poses["time"][0], position)
    found = attitude_from_image(images["one/0001.png"], CAMERAS["one"], position, sun)
    assert degrees_off(found, truth["one/0001.png"]["quaternion"]) < TOLERANCE
