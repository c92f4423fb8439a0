"""Static calibration of accelerometer and gyroscope (A 5.1–5.5, work B)."""
