"""The chapter on a gyroscope aided by a reference: its numbers, and sentences that follow the facts."""

import nbformat
import numpy as np
import pytest
from devices import ended, read_chapter

from sensorbook.attitude.aiding import Motion, References
from sensorbook.attitude.experiment import PRINTED, RATES
from sensorbook.errors import InputError
from sensorbook.reporting import chapters

SLUG = "aided_attitude"
SHORT = {"seeds": 2, "seconds": 40}


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    return read_chapter(SLUG, tmp_path_factory.mktemp("chapter"))


def of(found):
    return found[0]["results"][SLUG]


def test_work_c_s_table(read):
    found, text = of(read), read[1]
    assert found["rates_hz"] == list(RATES)
    ours = np.degrees(found["mean_euler_error"]["reset"])
    for rate, angles, ratio in zip(RATES, ours, found["ratio_to_c"]["aided"], strict=True):
        assert ratio == pytest.approx(angles.mean() / np.mean(PRINTED[rate]))
        assert 0.6 < ratio < 1.4
    assert "10.3, 3.67, 7.38" in text
    low, high = min(found["ratio_to_c"]["aided"]), max(found["ratio_to_c"]["aided"])
    assert f"{low:.2f} to {high:.2f} times** C's" in text
    assert "the method is, and its trend" in text
    kept = found["ratio_to_c"]["rate_kept"]
    assert f"With the rate kept it is {min(kept):.2f} to {max(kept):.2f} times C's" in text
    assert "**The reset alone is the reading that agrees with C's table.**" in text
    assert np.abs(np.log(kept)).max() > np.abs(np.log(found["ratio_to_c"]["aided"])).max()


def test_filter_and_yardstick(read):
    found, text = of(read), read[1]
    ratios = found["ratio_to_known_bias"]
    assert max(ratios["mekf"]) < 1.55
    assert min(ratios["reset"]) > max(1, min(ratios["mekf"]))
    assert found["mixed_up"]["value"] > 2 * found["mixed_up"]["right"]
    assert "each correction turns about a wrong axis" in text
    assert f"is {min(ratios['mekf']):.2f} to {max(ratios['mekf']):.2f} times the yardstick" in text
    assert "the bias is learnt from 7 of them" in text
    assert "The reset loses most at 0.1 Hz" in text
    assert "It is *one step late*" in text


def test_bias_and_consistency(read):
    found, text = of(read), read[1]
    off = np.subtract(found["bias"]["value"], [0.03, 0.04, -0.01])
    # Six standard errors leave no sound run out; 0.0041 rad/s is what 60 s of white noise allow.
    assert (np.abs(off) < 6 * np.array(found["bias"]["std"])).all()
    np.testing.assert_allclose(found["bias"]["std"], 0.0041, rtol=0.1)
    nees = {name: each["mean"] for name, each in found["nees"].items()}
    assert "0 ± 1.7 °/s for the filter" in text
    assert nees["N as it is"] == pytest.approx(3, abs=0.6)
    assert "**the filter errs as much as it says**" in text
    assert nees["N ten times too small"] > 30
    assert nees["N ten times too large"] < 0.5
    assert found["nees_bounds"] == pytest.approx([1.37, 5.25], abs=0.01), "χ² of 18 over 6"
    assert "of 18 biases are within 1.96" in text
    assert "NEES tells what the errors would hardly have told" in text
    assert all(abs(v - 1) < 0.12 for v in found["growth_over_predicted"].values())
    assert "**the growth follows the covariance**" in text


def test_outage(read):
    found, text = of(read), read[1]
    before, end, after = np.degrees(found["outage"]["angle_1"]["reset"])
    assert before < 1.5
    # The whole angle's error is 20° and more; less than half of it is angle 1 on this motion.
    assert 6 < end < 25
    assert after < 1.5
    assert "(C, in one run: 0.84°, 18°, 1.05°)" in text
    assert "it goes on with the bias that it has learnt" in text
    assert found["outage"]["whole"]["mekf"][1] < 0.75 * found["outage"]["whole"]["reset"][1]


def test_recovery_from_the_outage(read):
    """By C's equations it is no gradual one, but by the product as printed near the reference frame."""
    found, text = of(read), read[1]
    left = {name: np.degrees(v) for name, v in found["outage"]["recovery"].items()}
    for name in ("work C: reset", "work C: reset and rate kept"):
        assert left[name][0] > 15
        assert left[name][1:].max() < 1, "one step of the gyroscope's noise is 0.34° an axis"
    assert 1 < left["elements for Ω"][1] < 5
    assert left["elements for Ω"][2] < 1
    near = left["product as printed, angles a third"]
    # 2 sin(θ/2) with θ up to 34° leaves 0.58 at most, but for what each interval adds.
    assert (near[1:4] < 0.65 * near[:3] + 1).all()
    assert near[1] > 5 * left["work C: reset"][1]
    assert "**Neither reading recovers gradually, nor does the small angle.**" in text
    assert "**that is a gradual recovery**" in text
    assert "may show its equation as printed, on a body that stays near" in text


def test_other_references(read):
    found, text = of(read)["by_reference_error"], read[1]
    assert found["mekf"][0] == pytest.approx(found["mekf"][1], rel=0.02), "the gyroscope's own part"
    assert found["reset"][-1] > 1.3 * found["mekf"][-1]
    assert "a better one would not make it better" in text


def test_a_good_gyroscope(tmp_path):
    """A bias of 0.015 °/s and a sixth of C's noise: 0.1° in 10 s against 0.9° of noise."""
    good = {"bias_deg_s": [0.01, 0.005, -0.01], "random_walk": 0.005, "reference_error_deg": 0.02}
    found = read_chapter(SLUG, tmp_path, **SHORT, **good)
    assert "**With this gyroscope the reset is good enough** where references are rare" in found[1]
    assert max(of(found)["ratio_to_known_bias"]["reset"][:3]) < 1.15
    assert "C's numbers belong to another gyroscope" in found[1]
    assert "(C, in one run" not in found[1]
    assert "C's table does not" not in found[1]
    assert "it looks for a bias, and what it takes for one is mostly noise" in found[1]
    assert "it does harm" not in found[1]
    assert "loses most" not in found[1]
    assert "There is no bias here" not in found[1]


def test_no_bias(tmp_path):
    found = read_chapter(SLUG, tmp_path, **SHORT, bias_deg_s=[0, 0, 0])
    assert "**There is no bias here**" in found[1]
    assert "left in place" not in found[1]
    assert "true are (0, 0, 0)" in found[1]
    assert "with no side that they lean to" in found[1]
    assert "it looks for a bias, and what it takes for one is mostly noise" in found[1]
    assert min(of(found)["ratio_to_known_bias"]["mekf"]) > 0.9


def test_references_poorer_than_the_gyroscope(tmp_path):
    """5° against 0.05° of noise in 10 s: a single reference is worth next to nothing."""
    poor = {"bias_deg_s": [0.01, 0.005, -0.01], "random_walk": 0.0003, "reference_error_deg": 5.0}
    found = read_chapter(SLUG, tmp_path, **SHORT, **poor)
    text, errors = found[1], of(found)["mean_error"]
    assert "Hz on the references are poorer than what the gyroscope holds between them.**" in text
    assert "**it does harm**" in text
    assert errors["mekf"][-1] < errors["reset"][-1] / 3
    assert of(found)["gain"][-1] < 0.01
    assert "no better than what the gyroscope has held since the one before" in text
    # From gains of a line through all references so far it starts well, and lags only a little then.
    assert errors["complementary"][-1] < errors["reset"][-1] / 2
    assert "here the references make the errors, and no N is much of a lie" in text
    assert "lines that the references themselves make rough" in text
    assert "It is *one step late*" not in text
    assert "good enough" not in text


def test_a_gyroscope_that_knows_nothing(tmp_path):
    """57° in a second: between references the attitude is anything."""
    found = read_chapter(SLUG, tmp_path, **SHORT, random_walk=1.0)
    assert "nobody knows this attitude**: even the filter that knows the bias errs by" in found[1]
    assert "good enough" not in found[1]
    assert of(found)["mean_error"]["mekf"][0] > 1.5


def test_a_bias_that_no_data_sheet_told(tmp_path):
    found = read_chapter(SLUG, tmp_path, **SHORT, bias_deg_s=[20.0, -15.0, 10.0])
    assert "the largest is 20 °/s, 12 of the standard errors in `bias_std_deg_s`" in found[1]
    assert "**its standard errors are not right: the bias is beyond what it was told**" in found[1]
    assert "e+0" not in found[1], "hundreds of degrees without a power of ten"
    assert of(found)["bias"]["prior_std"] == pytest.approx(np.radians(1.7))


def test_lines_fit_on_a_screen_and_the_two_run():
    chapter = next(c for c in chapters.CHAPTERS if c.slug == SLUG)
    book = nbformat.read(chapter.notebook, as_version=4)
    for cell in book.cells:
        assert max(map(len, cell.source.splitlines())) <= 150, cell.source
    (last,) = [c.source for c in book.cells if c.source.startswith("## In two lines")]
    code = last.split("```python\n")[1].split("```")[0]
    still = np.tile([0, 0, 0, 1.0], (5, 1))
    names = {
        "motion": Motion.of(np.arange(5) * 0.1, np.zeros((4, 3))),
        "references": References(np.arange(5), still, np.tile(1e-6 * np.eye(3), (5, 1, 1))),
        "random_walk": 1e-3,
        "rate_random_walk": 1e-5,
        "bias_std": 0.03,
    }
    first, second = code.strip().splitlines()
    exec(f"{first}\nfound = {second}", names)
    assert names["found"] == pytest.approx(still, abs=1e-12)


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"seeds": 1}, "seeds: number of runs is 1 — give a whole number, 2 to 200"),
        ({"seed": -1}, "seed: seed is -1 — give a whole number, 0 to"),
        ({"seconds": 10}, "seconds: length is 10 s — give 20 to 600 s"),
        ({"bias_deg_s": [1.0, 2.0]}, "bias_deg_s: is [1.0, 2.0] — give a list of 3: bias about x"),
        ({"bias_deg_s": [1.0, 2.0, 90.0]}, "bias_deg_s: bias about z is 90 °/s — give -20 to 20"),
        ({"bias_std_deg_s": 0.0}, "standard error of the bias is 0 °/s — give 0.001 to 20 °/s"),
        ({"random_walk": 0.0}, "random_walk: angle random walk is 0 rad/s/√Hz — give 1e-06 to 1"),
        ({"reference_error_deg": 0.0}, "reference_error_deg: standard error is 0° — give 0.001 to"),
        ({"outage": [12, 58]}, "outage: end is 58 s — give 6 to 55 s"),
        ({"outage": [2, 20]}, "outage: start is 2 s — give 5 to 54 s"),
        (
            {"outage": [20, 12]},
            "outage: is from 20 to 12 s — give a start, and an end at least 1 s",
        ),
    ],
)
def test_nonsense_is_named(tmp_path, parameters, reason):
    status, found = ended(SLUG, tmp_path, **parameters)
    assert status == "failed"
    assert reason in found


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("outage = 12", "outage: is 12 — give a list of 2: start [s], end [s]"),
        ("seeds = 2.5", "seeds: number of runs is 2.5 — give a whole number"),
        ("seconds = '60'", "seconds: length is '60' — give 20 to 600 s"),
        ("bias_deg_s = [0, 'a', 0]", "bias_deg_s: bias about y is 'a' — give -20 to 20 °/s"),
    ],
)
def test_another_kind_of_value_typed_in_jupyter(line, reason):
    chapter = next(c for c in chapters.CHAPTERS if c.slug == SLUG)
    book = nbformat.read(chapter.notebook, as_version=4)
    parameters, checking = [c.source for c in book.cells if c.cell_type == "code"][:2]
    names = {}
    exec(f"{parameters}\n{line}", names)
    with pytest.raises(InputError) as caught:
        exec(checking, names)
    (said,) = str(caught.value).splitlines()
    assert reason in said
