"""Drawings of the scene's chapter: what the window's controls and numbers show is what is set and found."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.camera.explorer import Settings, explore
from sensorbook.camera.visibility import looking_at_both
from sensorbook.plots import camera_window as plots


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_blocks_do_not_overlap_and_every_arrow_has_its_ends():
    axes = plots.plot_blocks()
    boxes = [patch.get_bbox() for patch in axes.patches if hasattr(patch, "get_bbox")]
    assert len(boxes) == len(plots._BLOCKS)
    for k, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[k + 1 :])
    assert {name for pair in plots._ARROWS for name in pair} <= set(plots._BLOCKS)


def test_window_shows_what_is_set_and_found():
    made = Settings(place=np.radians(30), cameras=2)
    seen = explore(replace(made, angles=looking_at_both(made)))
    (controls, numbers), (chain, ours) = plots.plot_window(seen)
    pressed = [
        t.get_text().strip()
        for t in controls.texts
        if t.get_bbox_patch() and t.get_color() == "white"
    ]
    assert pressed == ["leo", "two", "full"]
    shown = [t.get_text() for t in controls.texts if t.get_text().endswith("°")]
    angles = np.degrees([seen.settings.place, *seen.settings.angles])
    assert shown == [f"{a:.1f}°".replace("-", "−") for a in angles]
    cells = numbers.tables[0].get_celld()
    assert cells[1, 0].get_text().get_text() == f"{np.degrees(seen.true[0]):.3f}"
    whole = np.degrees(np.linalg.norm(seen.error))
    assert cells[7, 2].get_text().get_text() == f"{whole:.3f}"
    for axes in (chain, ours):
        assert (axes.images[0].get_array() == seen.images[0]).all()
        assert "Sun's centre" not in axes.get_legend_handles_labels()[1]


def test_window_without_a_solution_has_dashes():
    grid = plots.plot_window(explore(Settings(orbit="geo")))
    assert grid[0, 1].tables[0].get_celld()[1, 2].get_text().get_text() == "–"
