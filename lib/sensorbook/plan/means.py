"""Covariance of means over stretches of one recording, under noise terms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sensorbook.noise.model import NoiseTerms


def covariance_of_means(start: np.ndarray, seconds: np.ndarray, terms: NoiseTerms) -> np.ndarray:
    """(P, P) covariance of the means over stretches from `start` (P,) s on, `seconds` (P,) long.

    From the generalised covariance of the noise's integral that `noise.covariance` states, in continuous
    time: −N²|s|/2 + B² s² ln|s|/2π + K²|s|³/12. It holds for differences: whatever weights are put on the
    means must add up to zero, since flicker noise and a random walk have no level of their own.
    """
    start, end = np.asarray(start, dtype=float), np.asarray(start + seconds, dtype=float)
    size = np.asarray(seconds, dtype=float)

    def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        s = np.abs(a[:, None] - b)
        log = np.log(np.where(s == 0, 1.0, s))
        return (
            -(terms.random_walk**2) * s / 2
            + terms.bias_instability**2 * s**2 * log / (2 * np.pi)
            + terms.rate_random_walk**2 * s**3 / 12
        )

    both = between(end, end) - between(end, start) - between(start, end) + between(start, start)
    return both / np.outer(size, size)


def about_the_whole(start: np.ndarray, seconds: np.ndarray, terms: NoiseTerms) -> np.ndarray:
    """(P, P) covariance of what means of stretches apart from each other err by as the bias.

    The bias that a calibration finds is that of its recording: the mean, from the first start to the last
    end, of all noise but the white.
    """
    slow = replace(terms, random_walk=0.0)
    first = np.min(start)
    whole = np.max(start + seconds) - first
    together = covariance_of_means(np.append(start, first), np.append(seconds, whole), slow)
    less = np.hstack([np.eye(len(start)), -np.ones((len(start), 1))])
    return less @ together @ less.T + np.diag(terms.random_walk**2 / np.asarray(seconds))
