"""All images of a device's cameras: what each gave, in as little memory as its entry in results.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np
import pandas as pd

from sensorbook.attitude.rotations import matrix_from_quaternion, quaternion_from_matrix
from sensorbook.camera.baseline import baseline
from sensorbook.camera.frames import Frame, image_names, read_frames
from sensorbook.camera.picture import read_picture
from sensorbook.errors import InputError, Problem
from sensorbook.recordings.images import Images

_KEPT = 60  # edge points of an image's limb that stay, to draw it small
_SHOWN = 12  # images in a gallery
_LISTED = 5  # names in an error
_LONGEST = 40  # of a name in the table
_COLUMNS = _EARTH, _RADIUS, _SUN, _ATTITUDE, _STD, _ERROR = (
    "Earth [°]",
    "radius [°]",
    "Sun [°]",
    "attitude x, y, z, w",
    "± [°]",
    "error [°]",
)


@dataclass(frozen=True, eq=False)
class Survey:
    """What the images gave.

    Attributes
    ----------
    frames : one an image, in order; their limbs have few points left
    records : their entries under `camera.images` of results.json
    chain : direction (3,) to the Earth by work C's chain, in camera axes, of each image whose true
        attitude is known; None elsewhere, and where the chain found none
    chosen : the image whose steps are to be looked at, with all its edge points
    earth, sun : the frames of the chosen attitude that see either; None where there is none
    """

    frames: tuple[Frame, ...]
    records: tuple[dict, ...]
    chain: tuple[np.ndarray | None, ...]
    chosen: Frame
    earth: Frame | None
    sun: Frame | None

    @property
    def solved(self) -> list[Frame]:
        """The frames whose status is "ok"."""
        return [frame for frame in self.frames if frame.status == "ok"]

    @property
    def reasons(self) -> dict[str, list[str]]:
        """Names of the images without solution, by reason, the most frequent first."""
        found: dict[str, list[str]] = {}
        for frame in self.frames:
            if frame.status != "ok":
                reason = frame.status.replace(f" ({frame.partner})", "")
                found.setdefault(reason.removeprefix("no solution: "), []).append(frame.image)
        return dict(sorted(found.items(), key=lambda item: -len(item[1])))

    @property
    def notes(self) -> dict[str, list[str]]:
        """Names of the images that were changed to be read, by what was done."""
        found: dict[str, list[str]] = {}
        for frame in self.frames:
            if frame.note:
                found.setdefault(frame.note, []).append(frame.image)
        return found

    @property
    def attitudes(self) -> list[Frame]:
        """A frame for each attitude: two cameras that make one count once."""
        seen: set[str] = set()
        found = []
        for frame in self.frames:
            if frame.matrix is not None and frame.partner not in seen:
                found.append(frame)
                seen.add(frame.image)
        return found

    @property
    def with_ellipse(self) -> Frame | None:
        """The first frame in which work C's chain found an Earth, of those whose true attitude is known."""
        pairs = zip(self.frames, self.chain, strict=True)
        return next((frame for frame, direction in pairs if direction is not None), None)

    def gallery(self, most: int = _SHOWN) -> list[Frame]:
        """At most so many readable images: one a reason that has no solution, the others evenly."""
        readable = [k for k, frame in enumerate(self.frames) if is_readable(frame)]
        first = {}
        for k in readable:
            if self.frames[k].status != "ok":
                first.setdefault(self.frames[k].status, k)
        failed = list(first.values())[: most // 2]
        others = [k for k in readable if k not in failed]
        others.sort(key=lambda k: self.frames[k].status != "ok")
        solved = [k for k in others if self.frames[k].status == "ok"]
        room = most - len(failed)
        pool = solved if len(solved) >= room else others[:room]
        if len(pool) > room:
            pool = [pool[k] for k in np.linspace(0, len(pool) - 1, room).round().astype(int)]
        return [self.frames[k] for k in sorted({*failed, *pool})]

    def table(self, most: int) -> pd.DataFrame:
        """What the first images gave, at most so many, in words and degrees; columns of nothing left out."""
        rows = [_row(frame) for frame in self.frames[:most]]
        table = pd.DataFrame(rows).set_index("image").rename_axis(None)
        return table.loc[:, (table != "").any()]


def survey(runs: Sequence[Images], image: str = "") -> Survey:
    """Reads every image of a device's cameras, one by one.

    `image` names the one whose steps are looked at; where it is empty it is the first that is solved and
    sees the Earth, else the one that shows most. Raises `InputError` where there is none of its name.
    """
    wanted = _wanted(image, image_names(runs))
    frames, records, chain = [], [], []
    chosen, best, whole = None, -1, {}
    # The Sun's cameras last: their frames, which wait for those of the Earth's, hold little.
    for frame in read_frames(sorted(runs, key=lambda run: run.camera.get("sees") == "sun")):
        frames.append(thinned(frame))
        records.append(frame.record())
        chain.append(_by_chain(frame) if true_earth(frame) is not None else None)
        if wanted and wanted in (frame.image, frame.partner):
            whole[frame.image, frame.sees] = frame
        if not wanted and _worth(frame) > best:
            chosen, best = frame, _worth(frame)
    if wanted:
        chosen = next(frame for (name, _), frame in whole.items() if name == wanted)
    # By what they see, too: one camera's images may stand for both of a pair.
    known = {(frame.image, frame.sees): frame for frame in frames} | whole
    other = {"earth": "sun", "sun": "earth"}.get(chosen.sees)
    both = [chosen] + ([known[chosen.partner, other]] if chosen.partner else [])
    return Survey(
        tuple(frames),
        tuple(records),
        tuple(chain),
        chosen,
        next((frame for frame in both if frame.limb is not None), None),
        next((frame for frame in both if frame.sun is not None), None),
    )


def is_readable(frame: Frame) -> bool:
    """Whether its picture could be read: something was looked for in it."""
    return frame.limb is not None or frame.sun is not None


def true_earth(frame: Frame) -> np.ndarray | None:
    """The true direction (3,) to the Earth's centre in camera axes, where the pose tells it."""
    position, quaternion = frame.pose.position, frame.pose.quaternion
    if position is None or quaternion is None:
        return None
    down = matrix_from_quaternion(quaternion) @ (-position / np.linalg.norm(position))
    return frame.camera.to_body.T @ down


def off_axis(direction: np.ndarray) -> tuple[float, float]:
    """Angle of a direction (3,) off the camera's axis, and its azimuth from right towards down, rad."""
    x, y, z = direction
    return float(np.arctan2(np.hypot(x, y), z)), float(np.arctan2(y, x))


def angle(first: np.ndarray, second: np.ndarray) -> float:
    """Between two directions (3,), rad; exact for small angles, too."""
    return float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))


def normalised_errors(frames: Sequence[Frame]) -> np.ndarray:
    """Errors squared over their covariance, of the frames whose true attitude is known: mean 3 if honest."""
    return np.array(
        [
            frame.error @ np.linalg.solve(frame.covariance, frame.error)
            for frame in frames
            if frame.error is not None
        ]
    )


def earth_errors(found: Survey) -> dict[str, np.ndarray]:
    """Of the images whose limb is found and whose true attitude is known, angles in rad.

    Returns
    -------
    off_axis : (n,), of the true direction to the Earth's centre
    cone, together, chain : (n,), errors of the cone's axis, of the direction that limb and Sun give
        together, and of work C's chain; NaN where there is none
    """
    rows = []
    for frame, chain in zip(found.frames, found.chain, strict=True):
        true = true_earth(frame)
        if true is None or frame.earth_direction is None:
            continue
        together = None if frame.matrix is None else frame.earth_direction
        found_by = (frame.limb.direction, together, chain)
        off = angle(true, np.array([0, 0, 1.0]))
        rows.append((off, *(np.nan if one is None else angle(one, true) for one in found_by)))
    table = np.array(rows).reshape(-1, 4)
    return dict(zip(("off_axis", "cone", "together", "chain"), table.T, strict=True))


def printed(value: float, form: str) -> str:
    """A number with a true minus and no power of ten.

    >>> printed(-0.123, ".2g"), printed(180.0, ".2g"), printed(5.1e-05, ".2g")
    ('−0.12', '180', '0.000051')
    """
    text = f"{value:.0f}" if form.endswith("g") and abs(value) >= 100 else f"{value:{form}}"
    return f"{Decimal(text):f}".replace("-", "−")


def attitude_std(frame: Frame) -> float:
    """Standard error of the attitude as a whole, rad: of the size of its error vector."""
    return float(np.sqrt(np.trace(frame.covariance)))


def thinned(frame: Frame) -> Frame:
    """The frame with few of its limb's points, all of them used."""
    limb = frame.limb
    if limb is None:
        return frame
    kept = np.flatnonzero(limb.used)
    kept = kept[:: max(1, -(-len(kept) // _KEPT))]
    few = replace(
        limb,
        pixels=limb.pixels[kept],
        used=limb.used[kept],
        residuals=limb.residuals[kept],
        sigma=None,
        rays=None,
        across=None,
    )
    return replace(frame, limb=few)


def _row(frame: Frame) -> dict[str, str]:
    """An image as a row of text."""
    limb, sun, degrees = frame.limb, frame.sun, np.degrees
    row = dict.fromkeys(("image", "status", *_COLUMNS), "")
    row |= {"image": shortened(frame.image), "status": frame.status.removeprefix("no solution: ")}
    if frame.earth_direction is not None:
        row[_EARTH] = (
            f"{_place(frame.earth_direction)} ±\u00a0{printed(degrees(frame.earth_std), '.2g')}"
        )
        std = degrees(np.sqrt(limb.covariance[2, 2]))
        row[_RADIUS] = f"{degrees(limb.angular_radius):.3f} ±\u00a0{printed(std, '.2g')}"
    if sun is not None and sun.direction is not None:
        row[_SUN] = f"{_place(sun.direction)} ±\u00a0{printed(degrees(sun.std), '.2g')}"
    if frame.matrix is not None:
        x, y, z, w = (printed(q, ".4f") for q in quaternion_from_matrix(frame.matrix))
        row[_ATTITUDE] = f"{x},\u00a0{y}, {z},\u00a0{w}"
        row[_STD] = printed(degrees(attitude_std(frame)), ".2g")
    if frame.error is not None:
        size = np.linalg.norm(frame.error)
        row[_ERROR] = f"{printed(degrees(size), '.2g')} ({size / attitude_std(frame):.1f}\u00a0×)"
    return row


def _place(direction: np.ndarray) -> str:
    away, azimuth = np.degrees(off_axis(direction))
    return f"{away:.3f},\u00a0{printed(azimuth, '.1f')}"


def shortened(name: str, most: int = _LONGEST) -> str:
    """A name of at most so many characters, its beginning and its end kept."""
    half = most // 2
    return name if len(name) <= most else f"{name[: half - 1]}…{name[-half:]}"


def _by_chain(frame: Frame) -> np.ndarray | None:
    """The Earth's direction by work C's chain where ours found a limb."""
    if frame.earth_direction is None:
        return None
    return baseline(read_picture(frame.path, frame.camera)[0], frame.camera).earth_direction


def _worth(frame: Frame) -> int:
    """How much there is to look at in an image."""
    if not is_readable(frame):
        return 0
    limb = frame.limb is not None and frame.limb.direction is not None
    sun = frame.sun is not None and frame.sun.direction is not None
    return 1 + 2 * limb + sun + 4 * (frame.status == "ok")


def _wanted(image: str, names: Mapping[str, str]) -> str:
    """The short name of the image asked for, which may be given by its path; "" for none."""
    if not isinstance(image, str):
        raise InputError(Problem("parameters", "image", f"is {image!r}", "give an image's name"))
    if not image or image in names.values():
        return image
    if image in names:
        return names[image]
    some = ", ".join(list(names.values())[:_LISTED])
    more = f" (and {len(names) - _LISTED} more)" if len(names) > _LISTED else ""
    raise InputError(
        Problem("parameters", "image", f"there is no {image!r}", f"give one of {some}{more}")
    )
