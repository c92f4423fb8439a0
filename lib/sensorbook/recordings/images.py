"""Camera images: which files, the camera that took them, and the poses known for them."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

import numpy as np

from sensorbook.errors import InputError, Problem, Refusal
from sensorbook.recordings.paths import resolve
from sensorbook.recordings.poses import Pose, limited, read_poses
from sensorbook.recordings.recording import Finding, html_table, plain
from sensorbook.recordings.schema import FILE, Declared
from sensorbook.recordings.tables import open_table

_NAMED = 3  # images named of those with one fault


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
                reason + _and_of(names[1:]),
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
    from sensorbook.camera.model import Camera

    try:
        Camera.of(declared.table["camera"])
    except ValueError as error:
        message, _, mend = str(error).partition("; ")
        place = f"{declared.label}: camera"
        raise InputError(Problem(FILE, place, message, mend or "mend the table")) from None
    pattern, where = declared.file, f"{declared.label}: file"
    try:
        found = (p.relative_to(folder) for p in folder.glob(pattern))
        # Hidden files are a system's own, such as macOS's ._0001.png.
        names = sorted(p.as_posix() for p in found if not any(s[0] == "." for s in p.parts))
    except (ValueError, NotImplementedError, OSError) as error:
        message = f"{pattern!r} is no pattern: {error}"
        raise InputError(Problem(FILE, where, message, "write images/*.png")) from None
    if not names:
        raise InputError(
            Problem(
                FILE, where, f"no image matches {pattern!r}", "write a pattern such as images/*.png"
            )
        )
    problems: list[Problem] = []
    paths = []
    for name in names:
        try:
            paths.append(resolve(folder, name, where))
        except InputError as error:
            problems += error.problems
    problems = limited(list(dict.fromkeys(problems)))
    poses, findings = {}, []
    if poses_file := declared.table.get("poses"):
        try:
            table = open_table(resolve(folder, poses_file, f"{declared.label}: poses"), poses_file)
            poses, findings = read_poses(table, names, _earth(declared.table["camera"]))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(*problems)
    if poses_file and (lacking := [name for name in names if name not in poses]):
        findings.append(
            Finding(
                poses_file,
                "image",
                "pose",
                f"{len(lacking)} of {len(names)} images have no row here, {lacking[0]} first",
                "name them by their path in the device folder, or its last part",
            )
        )
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as stream:
            while chunk := stream.read(1 << 20):
                digest.update(chunk)
    return Images(
        sensor="camera",
        kind="images",
        file=pattern,
        names=tuple(names),
        paths=tuple(paths),
        camera=declared.table["camera"],
        poses=poses,
        findings=tuple(findings),
        sha256=digest.hexdigest(),
        declaration=declared.table,
    )


def listed_twice(cameras: Iterable[Images]) -> list[Finding]:
    """Images that the patterns of two recordings have in common."""
    count = Counter(name for images in cameras for name in images.names)
    if not (twice := [name for name, times in count.items() if times > 1]):
        return []
    have = "image belongs" if len(twice) == 1 else "images belong"
    return [
        Finding(
            twice[0],
            "",
            "image",
            f"{len(twice)} {have} to two recordings, this one first: each counts twice",
            "give each camera a folder of its own",
        )
    ]


def shared_rows(cameras: Iterable[Images]) -> list[Finding]:
    """Rows of poses that give the last part of a path, which is that of several images of a device."""
    by_row: dict[tuple[str, str], dict[str, None]] = {}
    for images in cameras:
        for name, pose in images.poses.items():
            if pose.row != name and pose.row == PurePosixPath(name).name:
                by_row.setdefault((images.declaration["poses"], pose.row), {})[name] = None
    shared = [(*key, list(names)) for key, names in by_row.items() if len(names) > 1]
    if not shared:
        return []
    file, row, names = shared[0]
    more = len(shared) - 1
    so = f", and so {'is' if more == 1 else 'are'} {more} more" if more else ""
    return [
        Finding(
            file,
            row,
            "pose",
            f"is the row of {len(names)} images alike, {names[0]} and {names[1]}{so}",
            "name images by their path in the device folder where they were not taken together",
        )
    ]


def _earth(camera: Mapping) -> np.ndarray:
    """Semi-axes of the Earth that a camera is declared to see, m."""
    from sensorbook.camera.scene import WGS84

    return np.array([camera["earth_radius"]] * 3 if "earth_radius" in camera else WGS84)


def _and_of(names: list[str]) -> str:
    """That others share a fault, the first of them by name."""
    if not names:
        return ""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"; the same of {', '.join(names[:_NAMED])}{more}"
