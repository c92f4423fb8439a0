"""One image on its way from pixels to an attitude: work C's steps (4.1–4.3), and by the cone of the limb."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import uniform_filter1d

from sensorbook.attitude import triad, two_vector
from sensorbook.attitude.rotations import error_vector, matrix_from_quaternion
from sensorbook.camera.attitude import ImageAttitude, attitude_from_image
from sensorbook.camera.baseline import HIGH, LOW, SMOOTHING, WINDOW, Baseline, baseline
from sensorbook.camera.ellipse import Ellipse, guaranteed_ellipse
from sensorbook.camera.frames import Frame
from sensorbook.camera.limb import Limb
from sensorbook.camera.model import Camera
from sensorbook.camera.picture import read_picture
from sensorbook.earth import sun_direction
from sensorbook.errors import Refusal

CHAIN, FIRST, JOINT = (
    "C's chain and TRIAD",
    "cone and Sun, two vectors",
    "edges and Sun together",
)
_REACH = (14, 8)  # pixels outside and inside of an edge that its profile shows
PATCH = 9  # pixels, side of the part of an image that is shown in numbers


@dataclass(frozen=True, eq=False)
class Steps:
    """What every step made of an image of the Earth, and of the Sun's where another camera took it.

    Attributes
    ----------
    earth, sun : frames that see either, or None
    earth_image, sun_image : their pictures, grey (H, W) uint8; one where one camera sees both
    chain : work C's chain on the Earth's picture, or None
    found : attitude from edges and Sun together, or None
    matrices : attitudes (3, 3) by method, of those that could be made
    """

    earth: Frame | None
    sun: Frame | None
    earth_image: np.ndarray | None
    sun_image: np.ndarray | None
    chain: Baseline | None
    found: ImageAttitude | None
    matrices: dict[str, np.ndarray]

    @property
    def limb(self) -> Limb | None:
        """The limb, where it was found."""
        limb = None if self.earth is None else self.earth.limb
        return limb if limb is not None and limb.direction is not None else None

    def errors(self) -> dict[str, float]:
        """Error of each attitude, rad, where the true one is known."""
        if self.earth is None or self.earth.pose.quaternion is None:
            return {}
        true = matrix_from_quaternion(self.earth.pose.quaternion)
        return {
            name: float(np.linalg.norm(error_vector(matrix, true)))
            for name, matrix in self.matrices.items()
        }

    def apart(self, method: str) -> float:
        """How far a method's attitude is from the last method's, rad."""
        last = self.matrices[JOINT]
        return float(np.linalg.norm(error_vector(self.matrices[method], last)))

    @property
    def sun_filtered(self) -> np.ndarray:
        """The Sun's picture after work C's median."""
        return cv2.medianBlur(self.sun_image, WINDOW)


def take_steps(earth: Frame | None, sun: Frame | None) -> Steps:
    """Goes through an image again, keeping what every step made of it."""
    earth_image = None if earth is None else read_picture(earth.path, earth.camera)[0]
    if sun is None or (earth is not None and sun.image == earth.image):
        sun_image = None if sun is None else earth_image
    else:
        sun_image = read_picture(sun.path, sun.camera)[0]
    chain = None if earth is None else baseline(earth_image, earth.camera)
    matrices, found = {}, None
    if earth is not None and sun is not None and earth.matrix is not None:
        position = earth.pose.position
        to_sun = sun_direction(earth.pose.time, position)
        reference = [to_sun, -position / np.linalg.norm(position)]
        whole = chain if sun_image is earth_image else baseline(sun_image, sun.camera)
        if chain.earth_direction is not None and whole.sun_direction is not None:
            measured = _in_body(whole.sun_direction, chain.earth_direction, sun, earth)
            with_chain = _solved(triad, measured, reference)
            matrices |= {} if with_chain is None else {CHAIN: with_chain}
        found = attitude_from_image(
            earth_image, earth.camera, position, to_sun, earth.semi_axes, (sun_image, sun.camera)
        )
        measured = _in_body(sun.sun.direction, earth.limb.direction, sun, earth)
        sigma = [sun.sun.std, max(earth.limb.std, 1e-6)]
        matrices[FIRST] = _solved(two_vector, measured, reference, sigma=sigma)
        matrices[JOINT] = found.matrix
    return Steps(earth, sun, earth_image, sun_image, chain, found, matrices)


def take_chain(frame: Frame) -> tuple[np.ndarray, Baseline]:
    """A frame's picture (H, W), uint8, and what work C's chain makes of it."""
    image = read_picture(frame.path, frame.camera)[0]
    return image, baseline(image, frame.camera)


@dataclass(frozen=True, eq=False)
class Gradient:
    """What Canny's method has of an image before its thresholds.

    Attributes
    ----------
    size : (H, W), of the smoothed image's gradient, as sums of Sobel's 3 × 3 (a slope of one is 8)
    thin : (H, W) bool, where it is larger than at both neighbours along the gradient
    """

    size: np.ndarray
    thin: np.ndarray


def gradient(filtered: np.ndarray) -> Gradient:
    """The gradient of an image (H, W), uint8, after the median, and where it is largest along itself.

    As OpenCV's Canny has it, which knows four directions: along rows, columns and the two diagonals.
    """
    smooth = cv2.GaussianBlur(filtered, *SMOOTHING)
    dx, dy = (
        cv2.Sobel(smooth, cv2.CV_32F, *way, ksize=3, borderType=cv2.BORDER_REPLICATE)
        for way in ((1, 0), (0, 1))
    )
    size = np.hypot(dx, dy)
    square = np.pad(dx**2 + dy**2, 1)

    def beside(down: int, right: int) -> np.ndarray:
        high, wide = square.shape
        return square[1 + down : high - 1 + down, 1 + right : wide - 1 + right]

    own = beside(0, 0)
    flat, steep = (np.abs(dy) < t * np.abs(dx) for t in np.tan(np.radians([22.5, 67.5])))
    falling = (dx < 0) == (dy < 0)  # the diagonal from top left to bottom right
    thin = np.select(
        [flat, ~steep, falling],
        [
            (own > beside(0, -1)) & (own >= beside(0, 1)),
            (own > beside(-1, 0)) & (own >= beside(1, 0)),
            (own > beside(-1, -1)) & (own > beside(1, 1)),
        ],
        (own > beside(-1, 1)) & (own > beside(1, -1)),
    )
    return Gradient(size, thin)


def telling_pixel(chain: Baseline, found: Gradient) -> tuple[int, int]:
    """Column and row of the chain's pixel whose patch shows most of Canny's two thresholds.

    In most of them all edges are strong; sought is one around which some are, and some go on below.
    """
    strong = found.thin & (found.size > HIGH)
    weak = found.thin & (found.size > LOW) & ~strong
    counts = [
        cv2.boxFilter(mask.astype(np.float32), -1, (PATCH, PATCH), normalize=False)
        for mask in (strong, weak)
    ]
    x, y = chain.chain.astype(int).T
    half = PATCH // 2
    high, wide = found.size.shape
    inside = (x >= half) & (x < wide - half) & (y >= half) & (y < high - half)
    best = int(np.argmax(np.where(inside, np.minimum(*counts)[y, x], -1)))
    return int(x[best]), int(y[best])


def patch(image: np.ndarray, pixel: tuple[int, int], side: int = PATCH) -> np.ndarray:
    """The part (side, side) of an image around column and row `pixel`, moved inside at the border."""
    x, y = patch_corner(image, pixel, side)
    return image[y : y + side, x : x + side]


def patch_corner(image: np.ndarray, pixel: tuple[int, int], side: int = PATCH) -> tuple[int, int]:
    """Column and row of a patch's first pixel."""
    high, wide = image.shape
    x, y = (
        int(np.clip(p - side // 2, 0, max(n - side, 0)))
        for p, n in zip(pixel, (wide, high), strict=True)
    )
    return x, y


def half_ellipse(chain: Baseline) -> tuple[np.ndarray, Ellipse]:
    """Half of a chain's edges (N, 2), those on one side of their ellipse, and the ellipse through these.

    Raises `Refusal` where half of the edges tell none.
    """
    ellipse = chain.ellipse
    away = (chain.chain - ellipse.centre) / ellipse.semi_axes.max()
    turn = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    # From the end of the widest gap on, so that the half is one arc.
    gaps = np.diff(turn, append=turn[0] + 2 * np.pi)
    start = turn[(int(np.argmax(gaps)) + 1) % len(turn)]
    order = np.argsort((np.arctan2(away[:, 1], away[:, 0]) - start) % (2 * np.pi), kind="stable")
    half = chain.chain[order[: len(order) // 2]]
    return half, guaranteed_ellipse(half)


def share_on_limb(chain: Baseline, limb: Limb, camera: Camera, within: float = 3.0) -> float:
    """The part of a chain's edges that lie so many pixels or less from the limb that was found."""
    rays = camera.rays(chain.chain)
    off = np.arccos(np.clip(rays @ limb.direction, -1, 1)) - limb.angular_radius
    # A pixel's angle where it is, towards the limb's axis.
    inward = limb.direction - (rays @ limb.direction)[:, None] * rays
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-12)
    pixel = 1e-4 / np.linalg.norm(camera.project(rays + 1e-4 * inward) - chain.chain, axis=1)
    return float(np.mean(np.abs(off) <= within * pixel))


def field_of_view(camera: Camera) -> tuple[float, float]:
    """Angles across and down that an image spans through its principal point, rad.

    >>> across, down = field_of_view(Camera(1280, 720, 369.5))
    >>> round(float(np.degrees(across)), 1), round(float(np.degrees(down)), 1)
    (120.0, 88.5)
    """
    x, y = camera.centre
    ends = [[(-0.5, y), (camera.width - 0.5, y)], [(x, -0.5), (x, camera.height - 0.5)]]
    first, last = np.swapaxes(camera.rays(ends), 0, 1)
    across = np.linalg.norm(np.cross(first, last), axis=-1)
    across, down = np.arctan2(across, (first * last).sum(axis=-1))
    return float(across), float(down)


def centre_bias(off: float, radius: float) -> float | None:
    """How far outward of the Earth's centre the centre of its imaged ellipse lies, rad.

    The limb of angular `radius` ρ about a direction `off` = θ the axis runs from tan(θ − ρ) to tan(θ + ρ)
    in the image; the middle is sin θ cos θ/(cos²θ − sin²ρ). None from θ + ρ = 90° on, where the limb is no
    ellipse but a parabola, and beyond a branch of a hyperbola.

    >>> round(float(np.degrees(centre_bias(np.radians(20), np.radians(49.6)))), 2)
    26.68
    """
    below = np.cos(off) ** 2 - np.sin(radius) ** 2
    if off + radius >= np.pi / 2 or below <= 0:
        return None
    return float(np.arctan(np.sin(off) * np.cos(off) / below) - off)


def around(limb: Limb, directions: np.ndarray) -> np.ndarray:
    """Azimuths (N,) of directions (N, 3) about the limb's axis, rad, from right towards down."""
    right = np.array([1.0, 0, 0]) - limb.direction[0] * limb.direction
    size = np.linalg.norm(right)
    right = limb.basis[0] if size < 1e-6 else right / size
    return np.arctan2(directions @ np.cross(limb.direction, right), directions @ right)


def shared_residual(limb: Limb, beside: int = 15) -> float:
    """Root mean square, pixels, of what so many neighbouring edges have in common of their residuals.

    Residuals that are independent have 1/√beside of their own; ground, clouds and haze make waves of more.
    """
    used = np.flatnonzero(limb.used)
    order = used[np.argsort(around(limb, limb.rays[used]), kind="stable")]
    means = uniform_filter1d(limb.residuals[order], min(beside, len(order)), mode="nearest")
    return float(np.sqrt(np.mean(means**2)))


def best_edge(limb: Limb, camera: Camera) -> int:
    """The used edge point that is known best, of those whose profile lies within the image."""
    reach = max(_REACH) * limb.scale
    inside = (limb.pixels >= reach) & (
        limb.pixels <= [camera.width - 1 - reach, camera.height - 1 - reach]
    )
    fits = limb.used & inside.all(axis=1)
    return int(np.argmin(np.where(fits if fits.any() else limb.used, limb.sigma, np.inf)))


def edge_profile(
    image: np.ndarray, limb: Limb, camera: Camera, edge: int
) -> tuple[np.ndarray, np.ndarray]:
    """Places (n,) along the way inward across an edge, pixels from where it lies, and their grey levels."""
    step = 1e-3
    start = limb.pixels[edge]
    inward = camera.project(limb.rays[edge] + step * limb.across[edge]) - start
    inward /= np.linalg.norm(inward)
    along = np.arange(-_REACH[0], _REACH[1] + 0.25, 0.25) * limb.scale
    x, y = (start + along[:, None] * inward).T.astype(np.float32)
    values = cv2.remap(
        image, x[:, None], y[:, None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return along, values[:, 0].astype(float)


def _in_body(to_sun, to_earth, sun: Frame, earth: Frame) -> np.ndarray:
    return np.array([sun.camera.to_body @ to_sun, earth.camera.to_body @ to_earth])


def _solved(solver, measured, reference, **kwargs) -> np.ndarray | None:
    try:
        return solver(measured, reference, **kwargs).matrix
    except Refusal:
        return None
