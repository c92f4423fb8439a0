"""What a calibration says of itself."""

import json

import numpy as np
import pytest
from scipy import stats

from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.ellipsoid import ENTRIES, packed, unpacked
from sensorbook.magnetometer.result import relative, scaled

from .turns import FIELD, iron_of, read, soft_iron_of, turned_by_hand


@pytest.fixture(scope="module")
def iron():
    return iron_of(np.random.default_rng(1))


@pytest.fixture(scope="module", params=[None, FIELD], ids=["relative", "field known"])
def fit(request, iron):
    rng = np.random.default_rng(2)
    return calibrate(
        read(rng, turned_by_hand(rng), iron), request.param, 0.003 * FIELD, "somewhere"
    )


@pytest.mark.parametrize("field", [None, 5e-5])
def test_covariance_is_carried_by_the_derivatives(field):
    """By finite differences of the values themselves."""
    rng = np.random.default_rng(3)
    p = packed(rng.uniform(-0.5, 0.5, 3), soft_iron_of(rng, [0.8, 1.1, 1.3]))
    centre, size = np.array([2e-5, -1e-5, 3e-5]), 4.2e-5

    def values(q):
        made = scaled(q, np.zeros((9, 9)), centre, size, field, 0.0)
        return np.r_[made["hard_iron"], [made["soft_iron"][e] for e in ENTRIES], made["field"]]

    step = 1e-6
    by = np.stack([(values(p + step * e) - values(p - step * e)) / (2 * step) for e in np.eye(9)])
    root = rng.standard_normal((9, 9))
    found = scaled(p, root @ root.T, centre, size, field, 0.0)["covariance"]
    expected = by.T @ root @ root.T @ by
    unit = np.r_[[size] * 3, [1] * 6, size]
    # Central differences to step², rounding 1e-16 / step.
    np.testing.assert_allclose(
        found / np.outer(unit, unit), expected / np.outer(unit, unit), rtol=0, atol=1e-7
    )


def test_corrected_readings_are_those_of_the_parameters():
    """In its own unit the ellipsoid has a field of 1, in T one of `field`."""
    rng = np.random.default_rng(4)
    p = packed(rng.uniform(-0.5, 0.5, 3), soft_iron_of(rng, [0.8, 1.1, 1.3]))
    m = rng.standard_normal((20, 3))
    h, s = unpacked(p)
    for field in (None, 5e-5):
        made = scaled(p, np.zeros((9, 9)), np.ones(3), 2.0, field, 0.0)
        true = (2 * m + 1 - made["hard_iron"]) @ made["soft_iron"]
        np.testing.assert_allclose(true / made["field"], (m - h) @ s, rtol=1e-12, atol=1e-12)


def test_relative_keeps_the_readings():
    s, field = relative(np.diag([1.1, 0.9, 1.2]), 5e-5)
    assert np.linalg.det(s) == pytest.approx(1)
    np.testing.assert_allclose(
        np.linalg.inv(s) * field, np.linalg.inv(np.diag([1.1, 0.9, 1.2])) * 5e-5
    )


def test_semi_axes_shortest_first(fit, iron):
    expected = np.sort(FIELD / np.linalg.eigvalsh(iron["soft_iron"]))
    np.testing.assert_allclose(fit.semi_axes, expected, rtol=0.01)


def test_interval_factor_is_student_s(fit):
    assert fit.interval_factor == pytest.approx(stats.t.ppf(0.975, fit.dof))
    assert 9 <= fit.dof <= 39


def test_results_are_json_with_every_key_of_the_contract(fit):
    results = fit.to_results()
    for key in ("method", "hard_iron", "soft_iron", "field", "residual_percent",
                "residual_percent_check", "coverage_percent", "unit"):  # fmt: skip
        assert key in results
    text = json.dumps(results, default=lambda v: v.tolist(), allow_nan=False)
    assert json.loads(text)["unit"] == "T"
    assert results["readings"] + results["set_aside"] == 3000
    assert len(results["parameters"]) == len(results["covariance"]) == 10
    np.testing.assert_array_equal(
        results["std"]["soft_iron"], np.transpose(results["std"]["soft_iron"])
    )
    np.testing.assert_allclose(results["std"]["soft_iron"][0][1], fit.std[6])
    assert results["residual_percent"] == 100 * fit.residual
    assert results["coverage_percent"] > 90


def test_table(fit):
    table = fit.table()
    assert list(table.index) == [
        *(f"hard iron {a}" for a in "xyz"),
        *(f"soft iron {a}" for a in ("xx", "yy", "zz", "xy", "xz", "yz")),
        "field",
    ]
    assert table.loc["hard iron x", "unit"] == "µT"
    assert float(table.loc["hard iron x", "value"].replace("−", "-")) == pytest.approx(
        1e6 * fit.hard_iron[0], abs=0.01
    )
    assert table["95 % interval"].str.startswith("± ").all()
    assert "hard iron x" in fit._repr_html_()


def test_against_the_truth(fit, iron):
    """A truth at the estimate is held; one ten intervals off is not, in that row alone."""
    truth = {k: getattr(fit, k) for k in ("hard_iron", "soft_iron", "field")}
    assert (fit.against(truth)["holds the truth"] == "yes").all()
    half = fit.interval_factor * fit.std
    off = truth | {"hard_iron": fit.hard_iron + 10 * half[0] * np.eye(3)[0]}
    told = fit.against(off)["holds the truth"]
    assert list(told.index[told == "no"]) == ["hard iron x"]
    known = fit.against({**iron, "field": FIELD})
    assert list(known.columns) == ["truth", "estimate", "95 % interval", "unit", "holds the truth"]
    assert (known["holds the truth"] == "yes").sum() >= 8  # of ten at 95 %


def test_a_field_known_exactly_is_fixed(iron):
    rng = np.random.default_rng(5)
    fit = calibrate(read(rng, turned_by_hand(rng), iron), FIELD)
    assert fit.table().loc["field", "95 % interval"] == "fixed"
