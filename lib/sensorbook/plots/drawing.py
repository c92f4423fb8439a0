"""Figures → images for a page, at a fraction of what `savefig` takes and to the same look."""

from __future__ import annotations

import io
import re

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatterMathtext, NullLocator
from PIL import Image

MARGIN = 0.1  # inch left around what is drawn
ROOM = (0.75, 0.15, 0.55, 0.15)  # inch around axes, at the left, right, below and above
TITLED = 0.4  # inch above axes with a title


def drawn(figure: Figure, dpi: int) -> Image.Image:
    """A figure that is ready, drawn without the empty rows and columns around it."""
    with plt.rc_context({"font.sans-serif": plt.rcParams["font.sans-serif"][:1]}):
        # One font to look for, not a list of those that an installation may lack.
        return _drawn(figure, dpi)


def _drawn(figure: Figure, dpi: int) -> Image.Image:
    lighten(figure)
    engine = figure.get_layout_engine()
    box = None
    if isinstance(engine, ConstrainedLayoutEngine):
        figure.set_dpi(dpi)
        if _is_plain(figure):
            # Needs no measuring where its numbers and labels have room enough.
            figure.set_layout_engine("none")
            _give_room(figure)
            image, box = _inked(figure)
            figure.set_layout_engine(engine)
        if box is None:
            image, box = _inked(figure)
    if box is None:
        # Something lies outside of the figure: laid out in one drawing, drawn in another.
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=dpi, bbox_inches="tight", pad_inches=MARGIN)
        return Image.open(buffer).convert("RGB")
    margin = round(MARGIN * dpi)
    left, top, right, bottom = box
    return image.crop(
        (
            max(left - margin, 0),
            max(top - margin, 0),
            min(right + margin, image.width),
            min(bottom + margin, image.height),
        )
    ).convert("RGB")


def _is_plain(figure: Figure) -> bool:
    """Whether a figure holds nothing but axes that are alone, with nothing that stands out far."""
    if len(figure.axes) != 1 or figure.legends or figure.get_suptitle():
        return False
    (axes,) = figure.axes
    legend = axes.get_legend()
    turned = axes.xaxis.get_tick_params().get("rotation")
    return not turned and (legend is None or legend.get_bbox_to_anchor() is axes.bbox)


def _give_room(figure: Figure) -> None:
    """Puts axes that are alone where numbers of five digits, and labels of a line, fit beside them."""
    (axes,) = figure.axes
    titled = any(axes.get_title(loc) for loc in ("left", "center", "right"))
    left, right, bottom, top = ROOM if not titled else (*ROOM[:3], TITLED)
    width, height = figure.get_size_inches()
    across, up = 1 - (left + right) / width, 1 - (bottom + top) / height
    axes.set_position((left / width, bottom / height, across, up))
    axes.set_in_layout(True)  # again, where it turns out that they need one


def _inked(figure: Figure) -> tuple[Image.Image, tuple[int, int, int, int] | None]:
    """A drawing, and the left, top, right and bottom of what is in it; None where that meets an edge."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    height, width, _ = pixels.shape
    colours = pixels.view(np.uint32)[..., 0]
    ink = colours != colours[0, 0]
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    image = Image.frombuffer("RGBA", (width, height), canvas.buffer_rgba(), "raw", "RGBA", 0, 1)
    if not len(rows) or 0 in (rows[0], columns[0], height - 1 - rows[-1], width - 1 - columns[-1]):
        return image, None
    return image, (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def encoded(figure: Figure, image: Image.Image) -> bytes:
    """The image of a figure as a PNG of a third of the full colours' size, with no difference that shows.

    64 colours do for lines and text, 256 for images and colour scales.
    """
    shaded = figure.findobj(lambda a: isinstance(a, ScalarMappable) and a.get_array() is not None)
    colours, level = (256, 8) if shaded else (64, 6)
    buffer = io.BytesIO()
    few = image.quantize(colours, Image.Quantize.FASTOCTREE)
    ground = few.getpixel((0, 0))  # mixed with its neighbours, it would not be the page's white
    palette = few.getpalette()
    palette[3 * ground : 3 * ground + 3] = image.getpixel((0, 0))
    few.putpalette(palette)
    few.save(buffer, format="png", compress_level=level)
    return buffer.getvalue()


def lighten(figure: Figure) -> None:
    """Makes a figure that is ready cheaper to draw, looking the same.

    Powers of ten become text, which needs no parser of mathematics, and small ticks of logarithmic axes
    that have no labels are drawn together: on their own each is laid out several times, label and all.
    The limits of those axes may not change any more.
    """
    flat = [a for a in figure.axes if not hasattr(a, "zaxis")]
    for axes in flat:
        for spine in axes.spines.values():
            spine.set_in_layout(False)  # the axes themselves reach as far
    logarithmic = [x for a in flat for x in (a.xaxis, a.yaxis) if x.get_scale() == "log"]
    for axis in logarithmic:
        if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
            axis.set_major_formatter(_Powers())
    unlabelled = [
        (axis, places)
        for axis in logarithmic
        if len(places := _inside(axis)) and not any(axis.get_minor_formatter().format_ticks(places))
    ]
    for axis, places in unlabelled:  # once all are known: axes that share a scale share their ticks
        axis.axes.add_artist(_Ticks(axis, places))
    for axis, _ in unlabelled:
        axis.set_minor_locator(NullLocator())


def _inside(axis: Axis) -> np.ndarray:
    """Places of the small ticks within the limits, up to rounding."""
    low, high = np.sort(axis.get_view_interval()) * [1 - 1e-6, 1 + 1e-6]
    places = np.asarray(axis.get_minorticklocs())
    return places[(places >= low) & (places <= high)]


class _Powers(LogFormatterMathtext):
    """10⁻³ as text where matplotlib writes it as mathematics."""

    _RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

    def __call__(self, x, pos=None):
        text = super().__call__(x, pos)
        power = re.fullmatch(r"\$\\mathdefault\{10\^\{(-?\d+)\}\}\$", text)
        return f"10{power[1].translate(self._RAISED)}" if power else text


class _Ticks(Artist):
    """The small ticks of an axis at some `places`, with their grid, drawn as the axis would.

    Neither a line nor a collection, so that no legend gives way to it.
    """

    def __init__(self, axis: Axis, places: np.ndarray):
        super().__init__()
        self.set_in_layout(False)
        self.set_zorder(axis.get_zorder())
        self._parts: list[Artist] = []
        along = "xy".index(axis.axis_name)
        tick = axis.get_minor_ticks(1)[0]
        if (grid := tick.gridline).get_visible():
            ends = np.empty((len(places), 2, 2))
            ends[:, :, along] = places[:, None]
            ends[:, :, 1 - along] = (0, 1)  # of the axes
            lines = LineCollection(
                ends,
                colors=grid.get_color(),
                linewidths=grid.get_linewidth(),
                linestyles=grid.get_linestyle(),
                alpha=grid.get_alpha(),
                transform=grid.get_transform(),
            )
            self._parts.append(lines)
        for mark in (tick.tick1line, tick.tick2line):
            if mark.get_visible():
                across = np.full(len(places), mark.get_data()[1 - along][0])
                marks = Line2D(*((places, across) if along == 0 else (across, places)))
                marks.update_from(mark)
                marks.set_transform(mark.get_transform())
                marks.set_clip_on(False)
                self._parts.append(marks)
        for part in self._parts:
            part.set_figure(axis.axes.figure)
            part.axes = axis.axes
            if part.get_clip_on():
                part.set_clip_path(axis.axes.patch)

    def draw(self, renderer) -> None:
        for part in self._parts:
            part.draw(renderer)
