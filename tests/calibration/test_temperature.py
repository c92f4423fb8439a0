"""Bias and scale factors against temperature."""

import numpy as np

from sensorbook.calibration import multi_position
from sensorbook.calibration.temperature import fit_temperature, several_temperatures

from .sets import BIAS, EIGHTEEN, MATRIX, G, by_hand, rests


def at_temperatures(levels, seed, scale=(0, 0, 0), bias=(0, 0, 0), bend=0.0):
    """18 rests at each temperature; slopes per °C about 25 °C."""
    rng = np.random.default_rng(seed)
    parts = []
    for r, level in enumerate(levels):
        x = level - 25.0
        parts.append(
            rests(
                by_hand(EIGHTEEN, 4, rng),
                rng,
                matrix=MATRIX + np.diag(scale) * x,
                bias=BIAS + np.array(bias) * x + bend * x**2,
                runs=np.full(18, r),
                temperature=np.full(18, float(level)),
                samples=200,
            )
        )
    first = parts[0]
    return type(first)(
        sum((p.samples for p in parts), ()),
        np.vstack([p.spans for p in parts]),
        sum((p.labels for p in parts), ()),
        np.concatenate([p.runs for p in parts]),
        np.concatenate([p.temperature for p in parts]),
    )


def fitted(positions):
    return fit_temperature(multi_position(positions, G), positions)


def test_slopes_come_out_and_the_degree_is_one():
    fit = fitted(at_temperatures((10, 20, 30, 40), 1, (2e-4, -1e-4, 0), (0.004, 0, -0.002)))
    assert fit.degree == 1
    c = fit.calibration
    np.testing.assert_allclose(
        np.diag(c.temperature["matrix_coefficients"][0]), [2e-4, -1e-4, 0], atol=1e-5
    )
    np.testing.assert_allclose(c.temperature["bias_coefficients"][0], [0.004, 0, -0.002], atol=1e-4)
    # At the reference temperature the errors are those of 25 °C.
    assert c.reference_temperature == 25.0
    assert np.abs((c.model.bias - BIAS) / c.std_of("bias")).max() < 4
    assert c.temperature["range"] == [10.0, 40.0]
    assert c.kept.all()
    assert c.rms_check < 1.5e-3


def test_where_nothing_moves_nothing_is_modelled():
    zero = sum(
        fitted(at_temperatures((10, 20, 30, 40), [seed, 2])).degree == 0 for seed in range(12)
    )
    assert zero >= 10


def test_a_bend_needs_degree_two():
    fit = fitted(at_temperatures((5, 15, 25, 35, 45), 3, bend=2e-4))
    assert fit.degree == 2
    assert fit.errors[2] < fit.errors[1] / 3


def test_changes_across_the_range_with_their_errors():
    fit = fitted(at_temperatures((10, 20, 30, 40), 4, bias=(0.004, 0, 0)))
    assert abs(fit.changes[3] - 0.12) < 4 * fit.changes_std[3]
    assert abs(fit.changes[4]) < 4 * fit.changes_std[4]
    assert len(fit.by_run) == 4


def test_one_temperature_is_not_several():
    assert not several_temperatures(at_temperatures((24, 25, 24), 5))
    assert not several_temperatures(at_temperatures((10, 40), 5))
    assert several_temperatures(at_temperatures((10, 25, 40), 5))
    rng = np.random.default_rng(6)
    assert not several_temperatures(rests(EIGHTEEN, rng))


def test_what_the_directions_do_not_show_is_not_fitted():
    """Away from the first temperature only the x–y plane was seen: nothing tells of z there."""
    rng = np.random.default_rng(7)
    plane = EIGHTEEN[np.abs(EIGHTEEN[:, 2]) < 0.1]
    parts = [rests(by_hand(EIGHTEEN, 4, rng), rng, temperature=np.full(18, 10.0))]
    for r, warmth in enumerate((20.0, 30.0, 40.0), start=1):
        n = len(plane)
        parts.append(
            rests(by_hand(plane, 2, rng), rng, runs=np.full(n, r), temperature=np.full(n, warmth))
        )
    first = parts[0]
    joined = type(first)(
        sum((p.samples for p in parts), ()),
        np.vstack([p.spans for p in parts]),
        sum((p.labels for p in parts), ()),
        np.concatenate([p.runs for p in parts]),
        np.concatenate([p.temperature for p in parts]),
    )
    fit = fitted(joined)
    assert fit.degree == 0
    assert fit.calibration.temperature is None


def test_three_temperatures_tell_a_line_from_none():
    found = [
        fitted(at_temperatures((15, 25, 35), [seed, 8], bias=(0.001, -0.0008, 0.0012))).degree
        for seed in range(8)
    ]
    assert found.count(1) >= 7


def test_levels_of_one_recording_are_its_cycles():
    several = at_temperatures((10, 20, 30, 40), 9, bias=(0.004, 0, -0.002))
    one = type(several)(
        several.samples,
        several.spans,
        several.labels,
        np.zeros(len(several), dtype=int),
        several.temperature,
    )
    assert several_temperatures(one)
    assert fitted(one).degree == 1
