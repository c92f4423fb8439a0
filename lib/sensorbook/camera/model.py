"""A pinhole camera with distortion: pixels to directions and back.

Camera axes are x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Integral, Real

import numpy as np
from numpy.typing import ArrayLike

FARTHEST = 1e6  # pixels from the image's first, beyond which a place is a mistake
_EXACT = 1e-10  # pixels, to which the distortion is taken out
_ROUNDS = 40  # of Newton's method: 3 or 4 do, more where the distortion is about to turn back
_STUCK = 1e-5  # of a whole step: a point that gets no further has no direction
_NODES = 4096
_BLOCK = 1 << 14  # points at a time, which stay in the processor's cache


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera.

    Parameters
    ----------
    width, height : pixels
    focal_px : focal length in pixels
    principal_point : (x, y), pixels; the middle of the image where left out
    distortion : k₁, k₂, p₁, p₂, k₃, k₄, k₅, k₆ of OpenCV's model, as many as are known
    to_body : (3, 3), turns directions in camera axes into body axes

    >>> wide = Camera(1280, 720, 369.5)  # work C, table 4.2
    >>> right = wide.rays([1279.5, 359.5])
    >>> round(2 * float(np.degrees(np.arctan2(right[0], right[2]))), 1)  # across, degrees
    120.0
    """

    width: int
    height: int
    focal_px: float
    principal_point: tuple[float, float] | None = None
    distortion: tuple[float, ...] = ()
    to_body: np.ndarray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = getattr(self, name)
            if not isinstance(size, Integral) or isinstance(size, bool):
                raise ValueError(f"{name} is {size!r}: give pixels, a whole number")
        if not (self.width >= 1 and self.height >= 1):
            raise ValueError(f"image of {self.width} × {self.height}: give pixels, 1 or more")
        if not (isinstance(self.focal_px, Real) and 0 < self.focal_px < np.inf):
            raise ValueError(f"focal_px is {self.focal_px!r}: give pixels, above 0")
        if self.principal_point is not None and not finite(self.principal_point, (2,)):
            raise ValueError(f"principal_point is {self.principal_point}: give x and y in pixels")
        if not any(finite(self.distortion, (count,)) for count in range(9)):
            raise ValueError(f"distortion is {self.distortion!r}: give up to 8 numbers")
        if not finite(self.to_body, (3, 3)):
            raise ValueError(
                "to_body is no rotation: give 3 × 3 numbers, its rows unit vectors at right angles"
            )
        turn = np.asarray(self.to_body)
        if not np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-3):
            raise ValueError(
                "to_body is no rotation: give 3 × 3 numbers, its rows unit vectors at right angles"
            )
        if np.linalg.det(turn) < 0:
            raise ValueError("to_body mirrors: give a right-handed rotation, of determinant 1")

    @classmethod
    def of(cls, table: Mapping) -> Camera:
        """The camera that a `[camera]` table of device.toml declares, less what it says of the scene.

        Raises `ValueError` also where its distortion has no direction for some of its pixels.
        """
        own = {key: value for key, value in table.items() if key not in ("sees", "earth_radius")}
        if "to_body" in own:
            # The nearest rotation: printed matrices have four digits.
            left, _, right = np.linalg.svd(np.array(own["to_body"], dtype=float))
            own["to_body"] = left @ right
        for key in ("principal_point", "distortion"):
            if key in own:
                own[key] = tuple(map(float, own[key]))
        camera = cls(**own)
        if any(camera.distortion) and (fault := camera._folds()):
            raise ValueError(fault)
        return camera

    @property
    def centre(self) -> np.ndarray:
        """The principal point, (2,)."""
        if self.principal_point is not None:
            return np.array(self.principal_point, dtype=float)
        return np.array([(self.width - 1) / 2, (self.height - 1) / 2])

    def rays(self, pixels: ArrayLike) -> np.ndarray:
        """Unit vectors (…, 3) in camera axes through pixels (…, 2): (3.12), distortion taken out.

        NaN for pixels that the distortion has no direction for: it turns back before.
        """
        pixels = np.asarray(pixels, dtype=float)
        if pixels.shape[-1:] != (2,) or not np.isfinite(pixels).all():
            raise ValueError(f"pixels of shape {pixels.shape}: give finite x and y, (…, 2)")
        if np.abs(pixels).max(initial=0.0) > FARTHEST:
            raise ValueError(
                f"a pixel {np.abs(pixels).max():.3g} away: give places in or near the image, "
                f"within {FARTHEST:.0e}"
            )
        plane = (pixels - self.centre) / self.focal_px
        if any(self.distortion):
            flat = plane.reshape(-1, 2)
            parts = np.array_split(flat, 1 + len(flat) // _BLOCK)
            plane = np.concatenate([self._undistorted(part) for part in parts])
            plane = plane.reshape(pixels.shape)
        rays = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def project(self, directions: ArrayLike) -> np.ndarray:
        """Pixels (…, 2) of directions (…, 3) in camera axes; NaN where they are behind the camera.

        NaN, too, so far off the axis that the distortion turns back, or has a pole: it would put what is
        out of view into the image. And NaN of a direction that is not finite.
        """
        directions = np.asarray(directions, dtype=float)
        if directions.shape[-1:] != (3,):
            raise ValueError(f"directions of shape {directions.shape}: give x, y and z, (…, 3)")
        ahead = (directions[..., 2] > 0) & np.isfinite(directions).all(axis=-1)
        depth = np.where(ahead, directions[..., 2], np.nan)
        with np.errstate(all="ignore"):  # a direction at right angles is infinitely far, or nowhere
            plane = directions[..., :2] / depth[..., None]
            if any(self.distortion):
                plane, _, grows = self._distorted(plane)
                plane = np.where(grows[..., None], plane, np.nan)
            pixels = self.focal_px * plane + self.centre
        return np.where(ahead[..., None], pixels, np.nan)

    def sees(self, directions: ArrayLike, margin: float = 0.0) -> np.ndarray:
        """Whether directions (…, 3) in camera axes fall into the image, `margin` pixels from its edge."""
        pixels = self.project(directions)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= margin - 0.5) & (pixels <= self._last + 0.5 - margin)
        return inside.all(axis=-1)

    @cached_property
    def grid(self) -> np.ndarray:
        """Unit vectors (height, width, 3) through all pixels' centres, NaN as those of `rays`."""
        x, y = np.meshgrid(np.arange(self.width), np.arange(self.height))
        return self.rays(np.stack([x, y], axis=-1))

    def _distorted(self, plane: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where points (…, 2) of the plane z = 1 come to lie, (…, 2), by OpenCV's model.

        Also its derivatives (…, 3): x' by x, x' by y, which is y' by x, and y' by y; and whether the
        image still grows there (…,), one direction to a pixel.
        """
        k1, k2, p1, p2, k3, k4, k5, k6 = self._coefficients
        x, y = plane[..., 0], plane[..., 1]
        square = x * x + y * y
        above = 1 + square * (k1 + square * (k2 + square * k3))
        below = 1 + square * (k4 + square * (k5 + square * k6))
        factor = above / below
        slope = (
            k1 + square * (2 * k2 + 3 * square * k3)
            - factor * (k4 + square * (2 * k5 + 3 * square * k6))
        ) / below  # of the factor by r²  # fmt: skip
        moved = np.stack(
            [
                x * factor + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * factor + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        xx = factor + 2 * slope * x * x + 2 * p1 * y + 6 * p2 * x
        xy = 2 * slope * x * y + 2 * p1 * x + 2 * p2 * y
        yy = factor + 2 * slope * y * y + 6 * p1 * y + 2 * p2 * x
        grows = (square < self._turns_back) & (xx * yy > xy * xy)
        return moved, np.stack([xx, xy, yy], axis=-1), grows

    @np.errstate(all="ignore")
    def _undistorted(self, target: np.ndarray) -> np.ndarray:
        """The points (N, 2) of the plane z = 1 that come to lie at `target` (N, 2); NaN where none does.

        Newton's method from where the radial part alone has its root, in steps that bring each point
        nearer to its target and keep it where the image grows.
        """
        nodes, reached = self._radial
        far = np.hypot(*target.T)
        start = target * np.where(far > 0, np.interp(far, reached, nodes) / far, 1.0)[:, None]
        found = np.full(target.shape, np.nan)
        tangential = np.any(self._coefficients[2:4])
        left = np.flatnonzero((far < reached[-1]) | tangential)
        plane, target, part = start[left], target[left], np.ones(len(left))
        moved, slope, _ = self._distorted(plane)
        # Places of 1e6 pixels are only known to their own rounding.
        exact = _EXACT / self.focal_px + 4 * np.finfo(float).eps * far[left]
        for _ in range(_ROUNDS):
            miss = target - moved
            off = np.hypot(*miss.T)
            there = off <= exact
            found[left[there]] = plane[there]
            on = ~there & (part > _STUCK)
            if not on.any():
                break
            left, plane, target, part, exact = left[on], plane[on], target[on], part[on], exact[on]
            moved, slope, miss, off = moved[on], slope[on], miss[on], off[on]
            xx, xy, yy = slope.T
            step = np.stack(
                [yy * miss[:, 0] - xy * miss[:, 1], xx * miss[:, 1] - xy * miss[:, 0]], axis=-1
            )
            trial = plane + (part / (xx * yy - xy * xy))[:, None] * step
            ahead, ahead_slope, grows = self._distorted(trial)
            better = grows & (np.hypot(*(target - ahead).T) < off)
            plane = np.where(better[:, None], trial, plane)
            moved = np.where(better[:, None], ahead, moved)
            slope = np.where(better[:, None], ahead_slope, slope)
            part = np.where(better, np.minimum(2 * part, 1.0), part / 4)
        return found

    @cached_property
    def _radial(self) -> tuple[np.ndarray, np.ndarray]:
        """Distances from the axis on the plane z = 1, up to where they turn back, and where they go."""
        last = np.sqrt(self._turns_back)
        nodes = np.sinh(np.linspace(0, np.arcsinh(min(last, 1e9)), _NODES))
        if np.isfinite(last):
            nodes[-1] = last * (1 - 1e-12)
        radial = Camera(
            1, 1, 1.0, distortion=(*self._coefficients[:2], 0, 0, *self._coefficients[4:])
        )
        with np.errstate(all="ignore"):
            reached = radial._distorted(np.stack([nodes, 0 * nodes], axis=-1))[0][:, 0]
            # Coefficients near to nothing turn back where their roots are lost to rounding.
            ends = np.flatnonzero(~(np.diff(reached) > 0))
        if len(ends):
            nodes, reached = nodes[: ends[0] + 1], reached[: ends[0] + 1]
        return nodes, reached

    @cached_property
    def _turns_back(self) -> float:
        """r² on the plane z = 1 from where the radial distortion no longer grows with r."""
        k1, k2, _, _, k3, k4, k5, k6 = self._coefficients
        above, below = (
            np.polynomial.Polynomial([1, k1, k2, k3]),
            np.polynomial.Polynomial([1, k4, k5, k6]),
        )
        square = np.polynomial.Polynomial([0, 1])
        # r·above/below has a slope of 0 where this in r² has; a pole where below has.
        slope = (above + 2 * square * above.deriv()) * below - 2 * square * above * below.deriv()
        roots = np.concatenate([slope.trim(1e-15).roots(), below.trim(1e-15).roots()])
        real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
        return float(real.min()) if len(real) else np.inf

    def _folds(self) -> str:
        """What is wrong with a distortion that has no direction for some pixels; "" for nothing."""
        corners = np.array([[x, y] for x in (0, self.width - 1) for y in (0, self.height - 1)])
        middles = np.array(
            [[x, self.centre[1]] for x in (0, self.width - 1)]
            + [[self.centre[0], y] for y in (0, self.height - 1)]
        )
        pixels = np.concatenate([corners, middles]).astype(float)
        with np.errstate(all="ignore"):
            back = self.project(self.rays(pixels))
            worst = np.linalg.norm(back - pixels, axis=-1)
        if (worst < 0.01).all():  # NaN: beyond where the distortion turns back
            return ""
        (x, y) = pixels[int(np.argmax(np.nan_to_num(worst, nan=np.inf)))]
        return (
            f"distortion {tuple(self.distortion)} has no direction for pixel ({x:.0f}, {y:.0f}): it turns "
            "back before; give coefficients that hold for the whole image, or the image's used part"
        )

    @property
    def _last(self) -> np.ndarray:
        return np.array([self.width - 1, self.height - 1])

    @property
    def _coefficients(self) -> np.ndarray:
        """All eight."""
        given = np.zeros(8)
        given[: len(self.distortion)] = self.distortion
        return given


def finite(value: object, shape: tuple[int, ...]) -> bool:
    """Whether these are finite numbers in this shape."""
    try:
        numbers = np.asarray(value)
    except ValueError:  # ragged
        return False
    if numbers.shape != shape or (numbers.size and numbers.dtype.kind not in "iuf"):
        return False
    return bool(np.isfinite(numbers).all())


def grey(image: ArrayLike, camera: Camera) -> np.ndarray:
    """The image as it is, (height, width), uint8; an error says what else it is."""
    image = np.asarray(image)
    if image.ndim != 2:
        raise ValueError(
            f"image has the shape {image.shape}: give one grey channel, (height, width)"
        )
    if image.dtype != np.uint8:
        raise ValueError(f"image is of {image.dtype}: give 8-bit values, 0 to 255")
    if image.shape != (camera.height, camera.width):
        raise ValueError(
            f"image is {image.shape[1]} × {image.shape[0]} pixels, its camera "
            f"{camera.width} × {camera.height}: give images of this camera"
        )
    return image
