"""Wavelet denoising of the samples of a rest (B 2.2): decomposition, threshold, reconstruction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pywt

from sensorbook.calibration.positions import Positions

# B's figure shows three levels; it states no family and no threshold. Daubechies' with four vanishing
# moments and the universal threshold, soft, are the literature's default (Donoho 1995).
FAMILY, LEVELS = "db4", 3
NORMAL = 0.674489750196  # median of |x| of a standard normal variable


def denoise(values: np.ndarray) -> np.ndarray:
    """(N, D) samples less what a soft universal threshold, σ√(2 ln N), takes for noise.

    σ is the median absolute finest detail over 0.6745. Fewer levels where N is too short for three.
    """
    levels = min(LEVELS, pywt.dwt_max_level(len(values), FAMILY))
    if levels < 1:
        return np.array(values)
    parts = pywt.wavedec(values, FAMILY, level=levels, axis=0)
    sigma = np.median(np.abs(parts[-1]), axis=0) / NORMAL
    limit = sigma * np.sqrt(2 * np.log(len(values)))
    kept = [parts[0]] + [np.sign(d) * np.maximum(np.abs(d) - limit, 0) for d in parts[1:]]
    return pywt.waverec(kept, FAMILY, axis=0)[: len(values)]


def denoised(positions: Positions) -> Positions:
    """The positions with every rest's samples denoised."""
    return replace(positions, samples=tuple(denoise(s) for s in positions.samples))
