"""Methods and inputs side by side, as work B's tables 3 and 4 have them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from sensorbook.calibration.adjustment import rms
from sensorbook.calibration.model import ErrorModel
from sensorbook.calibration.multi_position import multi_position, norm_errors
from sensorbook.calibration.positions import Positions
from sensorbook.calibration.result import Calibration, rounded
from sensorbook.calibration.wavelet import denoised
from sensorbook.errors import Refusal

INPUTS = ("raw", "denoised", "means")  # B's RD, DD and MD
NAMES = {
    "six_position": "six-position (SPS)",
    "recursive": "recursive (RLS)",
    "multi_position": "multi-position (MP)",
}


def by_input(
    solve: Callable[..., Calibration], positions: Positions, *arguments
) -> dict[str, Calibration]:
    """A solver's calibration from raw samples, from denoised ones and from means (B 2.2).

    `solve(positions, *arguments, data=…)` is one of the solvers.
    """
    clean = denoised(positions)
    return {
        data: solve(clean if data == "denoised" else positions, *arguments, data=data)
        for data in INPUTS
    }


def sample_errors(model: ErrorModel, positions: Positions, gravity: float) -> np.ndarray:
    """(N,) ``‖a‖ − g`` of every single sample, m/s²."""
    return np.linalg.norm(model.correct(np.vstack(positions.samples)), axis=1) - gravity


def table(
    calibrations: Sequence[Calibration], judges: Positions, gravity: float, ownfit: str = ""
) -> pd.DataFrame:
    """Parameters and errors, a calibration a column.

    Parameters
    ----------
    judges : positions to judge by; ``‖a‖ − g`` of their means and of their samples, rms
    ownfit : method whose fit used the judging positions: its held-out error stands in their place
    """
    columns = {}
    for c in calibrations:
        half = c.interval_factor * c.std
        rows = {
            name: f"{rounded(value, h)} ± {rounded(h, h)}"
            for name, value, h in zip(c.parameters, c.values, half, strict=True)
        }
        own = c.method == ownfit
        rows["rms of means [mm/s²]"] = (
            f"{1000 * (c.rms_check if own else rms(norm_errors(c.model, judges, gravity))):.3g}"
        )
        rows["rms of samples [mm/s²]"] = (
            f"{1000 * rms(sample_errors(c.model, judges, gravity)):.4g}"
        )
        columns[f"{NAMES[c.method]}, {c.data}"] = rows
    return pd.DataFrame(columns).fillna("fixed")


def judged(calibration: Calibration, judges: Positions, gravity: float, ownfit: str = "") -> float:
    """rms of ``‖a‖ − g`` of the judging positions' means, m/s²; held out for the method `ownfit`."""
    if calibration.method == ownfit:
        return calibration.rms_check
    return rms(norm_errors(calibration.model, judges, gravity))


def why(calibrations: Sequence[Calibration], errors: dict[str, float]) -> str:
    """In a sentence or two, why the three methods rank as they do."""
    by_method = {c.method: c for c in calibrations}
    six = by_method["six_position"]
    tilt = np.degrees(six.excess / six.gravity)
    if errors["multi_position"] < 0.98 * errors["six_position"]:
        text = (
            "The six-position methods take the levelling for granted, and their residuals show that it "
            f"errs by {tilt:.2g}°; the multi-position fit does not need it."
        )
    else:
        text = (
            f"The levelling is good here ({tilt:.2g}° by its residuals), so that the six-position "
            "methods lose nothing by taking it for granted."
        )
    if abs(errors["recursive"] / errors["six_position"] - 1) < 0.1:
        text += (
            " SPS and RLS weigh the same positions alike, one solving for the model and one for its "
            "inverse, all at once or one after the other: they differ in the second order only."
        )
    return text


def calibrations_by_run(positions: Positions, gravity: float, files: Sequence[str]) -> list[dict]:
    """Each recording's own multi-position calibration, where its directions are enough."""
    found = []
    for r in np.unique(positions.runs):
        try:
            own = multi_position(positions[positions.runs == r], gravity, check=False)
        except Refusal:
            continue
        std = {"matrix": own.std_of("matrix"), "bias": own.std_of("bias")}
        found.append(
            {"file": files[r], "matrix": own.model.matrix, "bias": own.model.bias, "std": std}
        )
    return found


def ranking(errors: dict[str, float]) -> str:
    """Such as "MP 1.2 < SPS 3.4 < RLS 3.5", smallest first; values in mm/s², rounded alike tie as ≈."""
    ordered = sorted(errors.items(), key=lambda item: item[1])
    text = ""
    for k, (name, value) in enumerate(ordered):
        if k:
            text += " ≈ " if value < 1.02 * ordered[k - 1][1] else " < "
        text += f"{name} {1000 * value:.3g}"
    return text
