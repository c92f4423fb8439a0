"""sensorbook: calibration results and reports from raw sensor recordings.

Conventions, stated here once and contradicted nowhere:

- **Units** are SI inside: rad/s, m/s², T, s, Hz; temperatures in °C. Field units (°/h, mg, µT) appear
  only where something is shown.
- **Arrays** hold one sample a row: shape (N,) or (N, 3) with the axes x, y, z.
- **Power spectra** are one-sided where a density is drawn, P₁ = 2·S; noise coefficients (N, B, K) are
  defined by the two-sided S, as in IEEE Std 952. `noise_density` is one-sided, √2·N.
- **Intervals** `low`, `high` bound the 95 % confidence interval.
- **Calibration** is `true = inverse(matrix) · (raw − bias)`; the magnetometer's is
  `true = soft_iron · (raw − hard_iron)`.
- **Thermal models are relative**: B(T) − B(reference temperature) is subtracted, never the reading at
  the reference temperature itself.
- **Attitude** is passive, v_body = A v_ref; quaternions are scalar-last, reference → body; an attitude's
  error is the rotation vector, in body axes, from the true attitude to the estimated.
- **Frames**: inertial is GCRS, Earth-fixed is WGS 84 (ITRS), tangent is north, east, down; times are UTC.
- **Standard gravity** is 9.80665 m/s² (exact, CGPM 1901).
"""

from sensorbook.errors import InputError, Problem, Refusal
from sensorbook.recordings import Device, Recording, load

__version__ = "0.1.0"
__all__ = ["Device", "InputError", "Problem", "Recording", "Refusal", "load"]
