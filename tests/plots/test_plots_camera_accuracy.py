"""Figures of the camera's accuracy: what is drawn is what was found, in degrees."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.camera import accuracy
from sensorbook.camera.study import CAMERA, looks, trials
from sensorbook.plots import camera_accuracy as plots


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def tried():
    rng = np.random.default_rng(1521)
    return {o: list(trials(o, {}, 3, rng, chain=True, chosen=True)) for o in ("leo", "geo")}


def points(axes, marker):
    return np.concatenate([a.get_xydata() for a in axes.lines if a.get_marker() == marker])


def test_centre_errors():
    fitted = {"leo": np.radians([[10, 13.64], [20, 26.7]])}
    axes = plots.plot_centre_errors(fitted)
    np.testing.assert_allclose(points(axes, "o"), np.degrees(fitted["leo"]))
    curve = axes.lines[0].get_xydata()
    assert np.interp(10, *curve.T) == pytest.approx(13.64, abs=0.01)
    assert curve[-1, 0] == pytest.approx(40.44, abs=0.01), "ends where the ellipse does"


def test_by_angle(tried):
    axes = plots.plot_by_angle(tried)
    assert [a.get_title().split(",")[0] for a in axes] == ["LEO", "GEO"]
    dots = points(axes[1], ".")
    expected = {(round(np.degrees(t.off_axis), 6), round(np.degrees(np.linalg.norm(e)), 9))
                for t in tried["geo"] for e in (t.error, t.chain_error) if e is not None}  # fmt: skip
    assert {(round(x, 6), round(y, 9)) for x, y in dots} == expected
    assert axes[0].get_yscale() == "log"


def test_formula(tried):
    axes = plots.plot_formula(tried)
    (x, y), *_ = points(axes, "s")
    t = tried["geo"][0]
    assert x == pytest.approx(np.degrees(accuracy.by_formula(t, accuracy.angular_radius("geo"))[1]))
    assert y == pytest.approx(np.degrees(np.linalg.norm(t.chain_error)))
    assert plots.plot_formula({"geo": []}).get_xscale() == "log", "nothing to draw is no error"


def test_looks():
    seen = accuracy.alike("geo", {"full": {}, "textured": looks()["textured"]}, 1522)
    left, right = plots.plot_looks(seen, CAMERA)
    assert [text.get_text() for text in left.get_legend().get_texts()] == ["full", "textured"]
    limb = seen["full"][1]
    assert len(right.lines[0].get_xdata()) == limb.used.sum()


def test_varied(tried):
    found = accuracy.Varied({}, 2, 1e-4, 2e-4, 5e-5)
    none = accuracy.Varied({"no solution: Sun not in view": 2}, 0, None, None, None)
    axes = plots.plot_varied({640: none, 1280: found}, {2.0: found}, tried["geo"])
    np.testing.assert_allclose(axes[0].lines[0].get_xydata(), [[1280, np.degrees(1e-4)]])
    assert len(axes[2].lines[0].get_xdata()) == 3


def test_sun_vectors():
    home, _ = accuracy.from_earth()
    changes = {o: accuracy.sun_vectors(o, home)[1] for o in ("leo", "geo")}
    printed = {o: np.full(3, 1e-5) for o in changes}
    left, right = plots.plot_sun_vectors(changes, printed)
    assert left.lines[1].get_ydata().max() == pytest.approx(0.0161, abs=1e-4)
    np.testing.assert_allclose(points(right, "o")[:, 1], np.degrees(1e-5))
