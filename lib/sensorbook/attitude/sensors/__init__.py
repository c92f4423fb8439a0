"""Attitude sensors as simulation models beside their inversions (work C, 3.1 to 3.5), one file a sensor.

Each module holds the forward model, in a form that does not use the inversion's formulas, and the
inversion, which returns a frozen result over a batch of samples. What a sample cannot give is NaN there,
with a sentence in `reasons` ("" where all is well); settings that are wrong raise a ValueError.
Attitude is passive, v_body = A v_ref; angles are in radians, currents in any unit, fields in T.
"""
