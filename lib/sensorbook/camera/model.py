"""A pinhole camera with distortion: pixels to directions and back.

Camera axes are x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike


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
        if not (self.width >= 1 and self.height >= 1):
            raise ValueError(f"image of {self.width} × {self.height}: give pixels, 1 or more")
        if not 0 < self.focal_px < np.inf:
            raise ValueError(f"focal_px is {self.focal_px}: give pixels, above 0")
        if self.centre.shape != (2,) or not np.isfinite(self.centre).all():
            raise ValueError(f"principal_point is {self.principal_point}: give x and y in pixels")
        if len(self.distortion) > 8 or not np.isfinite(self.distortion).all():
            raise ValueError(f"distortion is {self.distortion}: give up to 8 numbers")
        turn = np.asarray(self.to_body)
        if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-3):
            raise ValueError(
                "to_body is no rotation: give 3 × 3, its rows unit vectors at right angles"
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
        """Unit vectors (…, 3) in camera axes through pixels (…, 2): (3.12), distortion taken out."""
        pixels = np.asarray(pixels, dtype=float)
        if pixels.shape[-1:] != (2,) or not np.isfinite(pixels).all():
            raise ValueError(f"pixels of shape {pixels.shape}: give finite x and y, (…, 2)")
        if any(self.distortion):
            flat = np.ascontiguousarray(pixels.reshape(-1, 1, 2))
            to_rounding = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-14)
            plane = cv2.undistortPoints(
                flat, self._matrix, self._coefficients, criteria=to_rounding
            ).reshape(pixels.shape)
        else:
            plane = (pixels - self.centre) / self.focal_px
        rays = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def project(self, directions: ArrayLike) -> np.ndarray:
        """Pixels (…, 2) of directions (…, 3) in camera axes; NaN where they are behind the camera.

        NaN, too, so far off the axis that the distortion's polynomials turn back, or have a pole: they
        would put what is out of view into the image.
        """
        directions = np.asarray(directions, dtype=float)
        if directions.shape[-1:] != (3,):
            raise ValueError(f"directions of shape {directions.shape}: give x, y and z, (…, 3)")
        ahead = directions[..., 2] > 0
        depth = np.where(ahead, directions[..., 2], np.nan)
        plane = directions[..., :2] / depth[..., None]
        if any(self.distortion):
            flat = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1).reshape(
                -1, 1, 3
            )
            known = np.nan_to_num(flat)
            pixels, _ = cv2.projectPoints(
                known, np.zeros(3), np.zeros(3), self._matrix, self._coefficients
            )
            ahead &= (plane**2).sum(axis=-1) < self._turns_back
            return np.where(ahead[..., None], pixels.reshape(plane.shape), np.nan)
        return self.focal_px * plane + self.centre

    def sees(self, directions: ArrayLike, margin: float = 0.0) -> np.ndarray:
        """Whether directions (…, 3) in camera axes fall into the image, `margin` pixels from its edge."""
        pixels = self.project(directions)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= margin - 0.5) & (pixels <= self._last + 0.5 - margin)
        return inside.all(axis=-1)

    @cached_property
    def grid(self) -> np.ndarray:
        """Unit vectors (height, width, 3) through all pixels' centres."""
        x, y = np.meshgrid(np.arange(self.width), np.arange(self.height))
        return self.rays(np.stack([x, y], axis=-1))

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
    def _matrix(self) -> np.ndarray:
        (x, y), f = self.centre, self.focal_px
        return np.array([[f, 0, x], [0, f, y], [0, 0, 1.0]])

    @property
    def _coefficients(self) -> np.ndarray:
        """As many as OpenCV takes: 4, 5 or 8."""
        given = np.zeros(8)
        given[: len(self.distortion)] = self.distortion
        return given


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
