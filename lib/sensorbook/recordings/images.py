"""Camera images: which files, the camera that took them, and the poses known for them."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sensorbook.errors import InputError, Problem, Refusal
from sensorbook.recordings.paths import resolve
from sensorbook.recordings.poses import Pose, read_poses
from sensorbook.recordings.recording import Finding, html_table, plain
from sensorbook.recordings.schema import FILE, Declared
from sensorbook.recordings.tables import open_table

MAX_PIXELS = 100_000_000  # twice the largest sensor that flies; a header can declare anything


@dataclass(frozen=True, eq=False)
class Images:
    """The images of one camera.

    Parameters
    ----------
    sensor, kind : "camera", "images"
    file : the pattern declared
    names : names of the images, relative to the device folder, sorted
    paths : where they are, in the same order
    camera : the `camera` table as declared
    poses : `Pose` by image name, of the images that the poses file has; {} where there is none
    sha256 : over all images in order
    """

    sensor: str
    kind: str
    file: str
    names: tuple[str, ...]
    paths: tuple[Path, ...]
    camera: Mapping
    poses: Mapping[str, Pose] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    sha256: str = ""
    declaration: Mapping = field(default_factory=dict)
    rate: None = None
    duration: float = math.nan

    def __len__(self) -> int:
        return len(self.names)

    def unusable(self) -> list[Finding]:
        """The images that cannot be read, or are none of this camera, by reason; reads all of them."""
        from sensorbook.camera.model import Camera
        from sensorbook.camera.picture import read_picture

        camera = Camera.of(self.camera)
        bad: dict[str, list[str]] = {}
        for path, name in zip(self.paths, self.names, strict=True):
            try:
                read_picture(path, camera)
            except Refusal as refusal:
                bad.setdefault(refusal.reason, []).append(name)
        return [
            Finding(
                names[0],
                "",
                "image",
                reason
                + (f"; so it is of {len(names) - 1} more, {names[1]} first" if names[1:] else ""),
                "mend the image or the camera table; a report goes on without it",
            )
            for reason, names in bad.items()
        ]

    def provenance(self) -> dict:
        """This recording's entry under `inputs` of results.json, in plain JSON types."""
        return plain(self.declaration) | {
            "file": self.file,
            "sha256": self.sha256,
            "sensor": self.sensor,
            "kind": self.kind,
            "samples": len(self),
            "rate_hz": None,
            "duration_s": None,
            "gaps": 0,
        }

    def _repr_html_(self) -> str:
        return html_table([("camera", f"{len(self)} images"), ("file", self.file)])


def read_images(declared: Declared, folder: Path) -> Images:
    """Lists the images and reads the poses; the images themselves are read by who needs them."""
    pattern, where = declared.file, f"{declared.label}: file"
    try:
        names = sorted(p.relative_to(folder).as_posix() for p in folder.glob(pattern))
    except (ValueError, NotImplementedError, OSError) as error:
        message = f"{pattern!r} is no pattern: {error}"
        raise InputError(Problem(FILE, where, message, "write images/*.png")) from None
    if not names:
        raise InputError(
            Problem(
                FILE, where, f"no image matches {pattern!r}", "write a pattern such as images/*.png"
            )
        )
    paths = tuple(resolve(folder, name, where) for name in names)
    digest = hashlib.sha256()
    problems = []
    for path, name in zip(paths, names, strict=True):
        if (pixels := _declared_pixels(path)) > MAX_PIXELS:
            message = f"declares {pixels / 1e6:.0f} million pixels"
            mend = f"at most {MAX_PIXELS / 1e6:.0f} million are read: crop or scale it"
            problems.append(Problem(name, "", message, mend))
        with path.open("rb") as stream:
            while chunk := stream.read(1 << 20):
                digest.update(chunk)
    if problems:
        raise InputError(*problems)
    poses: Mapping[str, Pose] = {}
    findings = []
    if poses_file := declared.table.get("poses"):
        table = open_table(resolve(folder, poses_file, f"{declared.label}: poses"), poses_file)
        poses = read_poses(table, names)
        _check_places(poses, declared.table["camera"], poses_file)
        if lacking := [name for name in names if name not in poses]:
            findings.append(
                Finding(
                    poses_file,
                    "image",
                    "pose",
                    f"{len(lacking)} of {len(names)} images have no row here, {lacking[0]} first",
                    "name them by their path in the device folder, or its last part",
                )
            )
    return Images(
        sensor="camera",
        kind="images",
        file=pattern,
        names=tuple(names),
        paths=paths,
        camera=declared.table["camera"],
        poses=poses,
        findings=tuple(findings),
        sha256=digest.hexdigest(),
        declaration=declared.table,
    )


def _check_places(poses: Mapping[str, Pose], camera: Mapping, file: str) -> None:
    """Raises `InputError` where a satellite is inside the Earth that its camera is declared to see."""
    from sensorbook.camera.scene import WGS84

    axes = np.array([camera["earth_radius"]] * 3 if "earth_radius" in camera else WGS84)
    problems = [
        Problem(file, name, f"x y z are {np.linalg.norm(pose.position):.6g} m from the Earth's centre, "
                "inside the Earth", "give metres, ECI")
        for name, pose in poses.items()
        if pose.position is not None and np.linalg.norm(pose.position / axes) <= 1
    ]  # fmt: skip
    if problems:
        raise InputError(*problems[:20])


def _declared_pixels(path: Path) -> int:
    """Pixels that an image's header declares, without decoding it; 0 where it is no image."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                return image.width * image.height
    except Image.DecompressionBombError:  # beyond twice Pillow's own limit
        return 2 * (Image.MAX_IMAGE_PIXELS or MAX_PIXELS)
    except (OSError, ValueError, SyntaxError):  # whoever reads it will say what is wrong
        return 0
