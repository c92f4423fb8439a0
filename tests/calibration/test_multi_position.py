"""Calibration from the length of gravity."""

import numpy as np
import pytest

from sensorbook.calibration import multi_position
from sensorbook.calibration.multi_position import held_out, twelve_parameter_correlation
from sensorbook.errors import Refusal

from .sets import BIAS, EIGHTEEN, FACES, MATRIX, G, by_hand, rests

TRUE = np.r_[MATRIX[np.tri(3, dtype=bool)], BIAS]


def test_without_noise_the_truth_comes_out():
    rng = np.random.default_rng(1)
    fit = multi_position(rests(by_hand(EIGHTEEN, 4, rng), rng, white=1e-9, wander=0), G)
    np.testing.assert_allclose(fit.values, TRUE, rtol=0, atol=1e-8)  # noise of 1e-9 m/s²
    assert fit.rms_after < 1e-8
    assert fit.parameters[:3] == ("matrix.xx", "matrix.yx", "matrix.yy")
    assert fit.parameters[-1] == "bias.z"


def test_the_errors_are_those_that_are_stated():
    """60 sets: standardised errors have the size that Student's t says, in every parameter."""
    scaled, covered = [], []
    for seed in range(60):
        rng = np.random.default_rng([seed, 2])
        fit = multi_position(rests(by_hand(EIGHTEEN, 4, rng), rng), G, check=False)
        scaled.append((fit.values - TRUE) / fit.std)
        covered.append(np.abs(scaled[-1]) <= fit.interval_factor)
    # 9 parameters, 60 sets: 95 % ± 1 %, correlated within a set; three times that.
    assert 0.92 <= np.mean(covered) <= 0.98
    # The mean of 60 standardised errors (t, 9 degrees of freedom: sd 1.13) is within ±0.15 at 1 sd.
    assert np.abs(np.mean(scaled, axis=0)).max() < 0.5


def test_what_white_noise_does_not_explain_is_added():
    rng = np.random.default_rng(3)
    quiet = multi_position(rests(EIGHTEEN, rng, wander=0), G)
    rough = multi_position(rests(EIGHTEEN, rng, wander=5e-3), G)
    assert 0.3 < quiet.chi_square < 2.5  # χ²/9 has sd 0.47
    assert rough.chi_square > 20
    assert rough.excess == pytest.approx(5e-3, rel=0.6)  # 9 degrees of freedom: 24 % at 1 sd
    assert rough.std[-1] > 4 * quiet.std[-1]


def test_a_position_that_does_not_belong_is_named():
    rng = np.random.default_rng(4)
    good = rests(by_hand(np.vstack([EIGHTEEN, EIGHTEEN]), 4, rng), rng)
    parts = list(good.samples)
    parts[7] = parts[7] + [0.0, 0.03, 0.03]
    bad = type(good)(tuple(parts), good.spans, good.labels, good.runs)
    fit = multi_position(bad, G)
    assert fit.rejected == ("8 (70.0–74.0 s)",)
    assert not fit.kept[7]
    assert np.abs(fit.values - TRUE).max() < 2e-3


def test_good_sets_lose_no_position():
    lost = 0
    for seed in range(60):
        rng = np.random.default_rng([seed, 5])
        lost += bool(multi_position(rests(EIGHTEEN, rng), G, check=False).rejected)
    assert lost <= 2  # 0.3 % of sets each


def test_held_out_is_larger_than_fitted():
    rng = np.random.default_rng(6)
    positions = rests(by_hand(EIGHTEEN, 4, rng), rng)
    fit = multi_position(positions, G)
    assert fit.rms_check > fit.rms_after
    assert fit.rms_check < 4 * fit.rms_after


def test_several_recordings_are_held_out_whole():
    """A bias that differs by recording shows in the held-out error, not in folds across both."""
    rng = np.random.default_rng(7)
    two = [rests(EIGHTEEN, rng), rests(EIGHTEEN, rng, bias=BIAS + 0.02)]
    samples = two[0].samples + two[1].samples
    spans = np.vstack([two[0].spans, two[1].spans])
    runs = np.repeat([0, 1], 18)
    labels = tuple(f"{k} (0.0–1.0 s)" for k in range(36))
    both = type(two[0])(samples, spans, labels, runs)
    errors = held_out(both, G, np.tri(3, dtype=bool), "means")
    assert np.sqrt(np.mean(errors**2)) > 0.015


def test_six_parameters_leave_misalignment():
    rng = np.random.default_rng(8)
    positions = rests(by_hand(EIGHTEEN, 4, rng), rng)
    six = multi_position(positions, G, parameters=6)
    assert six.model.matrix[1, 0] == 0
    # ½ g (M_yx, M_zx, M_zy as sums of pairs) on the edges: some tens of mm/s².
    assert six.rms_after > 20 * multi_position(positions, G).rms_after


def test_of_twelve_parameters_three_pairs_are_one():
    """B 3.1: correlations of 0.999 and more."""
    rng = np.random.default_rng(9)
    positions = rests(by_hand(EIGHTEEN, 4, rng), rng)
    names, correlation = twelve_parameter_correlation(multi_position(positions, G), positions)
    assert len(names) == 12
    for pair in ("xy", "xz", "yz"):
        i, j = names.index(f"matrix.{pair}"), names.index(f"matrix.{pair[::-1]}")
        assert correlation[i, j] < -0.999


@pytest.mark.parametrize("data", ["raw", "denoised"])
def test_samples_one_by_one_give_the_same_numbers_and_claim_too_much(data):
    from sensorbook.calibration.wavelet import denoised

    rng = np.random.default_rng(10)
    positions = rests(by_hand(EIGHTEEN, 4, rng), rng, wander=2e-3)
    means = multi_position(positions, G)
    other = multi_position(denoised(positions) if data == "denoised" else positions, G, data=data)
    np.testing.assert_allclose(other.values, means.values, atol=2e-3)
    assert other.std[-1] < means.std[-1] / 3


@pytest.mark.parametrize(
    ("directions", "words"),
    [
        (FACES, "6 rests in 6 distinct directions do not determine 9 parameters"),
        (np.vstack([FACES, FACES[:1]]), "7 rests in 6 distinct directions (1 alike within"),
        (FACES[[0, 2, 4]], "3 rests in 3 distinct directions"),
        (np.tile(FACES[:1], (12, 1)), "12 rests in 1 distinct direction "),
    ],
)
def test_what_cannot_be_determined_is_refused_with_what_to_add(directions, words):
    rng = np.random.default_rng(11)
    with pytest.raises(Refusal) as caught:
        multi_position(rests(by_hand(directions, 0.5, rng), rng), G)
    assert words in caught.value.reason
    assert caught.value.remedy.startswith("Record them again with these positions added: ")
    assert any(name in caught.value.remedy for name in ("x up", "x down", "y up", "z up"))


def test_no_rest_at_all():
    rng = np.random.default_rng(12)
    with pytest.raises(Refusal, match=r"No rest was found"):
        multi_position(rests(EIGHTEEN, rng)[np.zeros(18, dtype=bool)], G)


def test_a_wrong_gravity_scales_the_result():
    rng = np.random.default_rng(13)
    positions = rests(by_hand(EIGHTEEN, 4, rng), rng)
    a, b = (multi_position(positions, g, check=False).model for g in (G, 1.001 * G))
    np.testing.assert_allclose(a.matrix, 1.001 * b.matrix, atol=1e-7)
    np.testing.assert_allclose(a.bias, b.bias, atol=1e-6)


def test_two_positions_that_hide_each_other_are_both_named():
    rng = np.random.default_rng(20)
    good = rests(by_hand(EIGHTEEN, 4, rng), rng)
    parts = list(good.samples)
    for k, sign in ((3, 1), (11, -1)):
        parts[k] = parts[k] + 0.1 * sign * EIGHTEEN[k]
    fit = multi_position(type(good)(tuple(parts), good.spans, good.labels, good.runs), G)
    assert set(np.flatnonzero(~fit.kept)) == {3, 11}
    assert np.abs(fit.values - TRUE).max() < 3e-3


def test_nine_positions_leave_nothing_to_judge_by():
    rng = np.random.default_rng(21)
    nine = np.vstack([FACES, EIGHTEEN[[6, 10, 14]], EIGHTEEN[[9]]])
    with pytest.raises(Refusal):
        multi_position(rests(nine[:9], rng), G)
    ten = np.vstack([EIGHTEEN[::2], EIGHTEEN[1::3]])
    fit = multi_position(rests(ten, rng), G)
    assert fit.dof == len(ten) - 9
    assert np.isfinite(fit.rms_check)


def test_gravity_s_uncertainty_is_that_of_the_matrix_alone():
    rng = np.random.default_rng(22)
    fit = multi_position(rests(EIGHTEEN, rng), G)
    wide = fit.with_gravity(0.02)
    np.testing.assert_array_equal(wide.std_of("bias"), fit.std_of("bias"))
    added = np.sqrt(wide.std_of("matrix") ** 2 - fit.std_of("matrix") ** 2)
    np.testing.assert_allclose(np.diag(added), 0.02 / G * np.diag(fit.model.matrix), rtol=1e-6)
    assert fit.with_gravity(5e-4) is fit


def test_rounding_is_in_the_intervals():
    """A converter eight times as coarse as the noise: the means are off by some of a step."""
    rng = np.random.default_rng(23)
    fine = rests(by_hand(EIGHTEEN, 4, rng), rng, wander=0)
    step = 0.08
    coarse = type(fine)(
        tuple(step * np.rint(s / step) for s in fine.samples), fine.spans, fine.labels, fine.runs
    )
    assert coarse.coarse.mean() > 0.5
    assert not fine.coarse.any()
    fit = multi_position(coarse, G)
    assert fit.std[-1] > 5 * multi_position(fine, G).std[-1]
    assert (np.abs(fit.values - TRUE) < 2 * fit.interval_factor * fit.std).all()
