"""The page of all devices: order, reasons, outliers, distributions, and what input cannot do to it."""

from __future__ import annotations

import copy
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from sensorbook.reporting.group import group_page

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))
from browser import CHROMIUM, Opened
from throwaway import NASTY
from trees import result, write_tree


class Texts(HTMLParser):
    """Text of rows and list items, in order, and of the first path of class `far` in each figure."""

    def __init__(self, page: str):
        super().__init__()
        self.rows: list[str] = []
        self.items: list[str] = []
        self.open = ""
        self.feed(page)
        self.rows, self.items = ([text.strip() for text in of] for of in (self.rows, self.items))

    def handle_starttag(self, tag, attrs):
        if tag in ("tr", "li"):
            self.open = tag
            (self.rows if tag == "tr" else self.items).append("")
        elif tag in ("table", "ul", "h2", "main", "script"):
            self.open = ""
        elif tag in ("td", "th", "br") and self.open:
            self.handle_data(" ")

    def handle_endtag(self, tag):
        if tag in ("ul", "table"):
            self.open = ""

    def handle_data(self, data):
        kept = self.rows if self.open == "tr" else self.items
        if self.open:
            kept[-1] = " ".join((kept[-1] + data).split()) + (" " if data[-1:].isspace() else "")


def page_of(root, *results):
    for found in results:
        folder = root / found["device"]["id"]
        folder.mkdir()
        (folder / "results.json").write_text(json.dumps(found), encoding="utf-8")
    return group_page(root.resolve())


@pytest.fixture
def rng():
    return np.random.default_rng(21)


def test_failures_come_first_with_their_reason(tmp_path, rng):
    write_tree(tmp_path, 60, rng, models=("IMU-A",))
    shown = Texts(group_page(tmp_path.resolve()))
    devices = [row.split()[0] for row in shown.rows if row.startswith("unit-")]
    assert len(devices) == 60
    assert devices[:2] == ["unit-00007", "unit-00057"]
    assert devices[2:] == sorted(devices[2:])
    # 1.4 times the limit of 3e-4 rad/s/√Hz, which is 1.03 °/√h.
    assert any(
        item.startswith("unit-00007: gyroscope angle random walk N y 1.44, limit ≤ 1.031 °/√h; ")
        for item in shown.items
    )
    assert "✓ 58 pass" in shown.items
    assert "✗ 2 fail" in shown.items


def test_an_outlier_is_named_and_nothing_else(tmp_path, rng):
    write_tree(tmp_path, 60, rng, models=("IMU-A",))
    items = Texts(group_page(tmp_path.resolve())).items
    named = [item for item in items if "robust standard deviations" in item]
    assert [item.split(":")[0] for item in named] == ["unit-00007", "unit-00057", "unit-00005"]
    assert "gyroscope angle random walk N" in named[0]  # which fails, too
    assert "accelerometer velocity random walk N" in named[2]
    assert "above the median 0.16" in named[2]


def test_what_one_cannot_measure_well_is_no_outlier(tmp_path, rng):
    found = [result(k, rng, ("A",)) for k in range(40)]
    for one in found:
        for axis in "xyz":
            value = 4e-5 * float(np.exp(rng.normal(0, 0.01)))
            entry = one["sensors"]["gyroscope"]["noise"][axis]["bias_instability"]
            entry |= {"value": value, "low": 0.97 * value, "high": 1.03 * value}
        one["checks"] = []
    odd = found[3]["sensors"]["gyroscope"]["noise"]["y"]["bias_instability"]
    odd |= {"value": 8e-5, "low": 3e-5, "high": 21e-5}  # twice the median, known to a factor of 2.6
    page = page_of(tmp_path, *found)
    assert not [i for i in Texts(page).items if i.startswith("unit-00003:") and "bias" in i]
    odd |= {"low": 7.8e-5, "high": 8.2e-5}
    (tmp_path / "unit-00003" / "results.json").write_text(json.dumps(found[3]))
    assert [i for i in Texts(group_page(tmp_path.resolve())).items if i.startswith("unit-00003:")]


IRON = {"method": "ellipsoid", "field_known": True, "residual_percent": 1.0, "coverage_percent": 98.0,
        "heading_error_after_deg": 0.3, "hard_iron": [1e-5, 2e-5, 3e-5], "interval_factor": 2.0,
        "soft_iron": [[1.1, 0, 0], [0, 1.0, 0], [0, 0, 1.0]], "field": 48e-6,
        "std": {"hard_iron": [1e-8] * 3, "soft_iron": [[1e-3] * 3] * 3, "field": 1e-7}}  # fmt: skip


def compasses(root, rng, count, **changes):
    """The page of `count` compasses of one model; a change gives the value of a device from its number."""
    found = []
    for k in range(count):
        one = result(k, rng, ("C",)) | {"checks": []}
        mine = {key: change(k) for key, change in changes.items()}
        one["sensors"] = {"magnetometer": {"calibration": IRON | mine}}
        found.append(one)
    page = page_of(root, *found)
    named = [i for i in Texts(page).items if "robust standard deviations" in i]
    return named, re.findall(r'role="img" aria-label="([^"]*)"', page)


def test_what_most_have_alike_has_no_outliers(tmp_path, rng):
    named, labels = compasses(
        tmp_path, rng, 20, coverage_percent=lambda k: 60.0 if k == 3 else 98.0 * (1 + k * 1e-16)
    )
    assert named == []
    assert any("coverage of directions. 20 devices, median 98 %" in label for label in labels)


@pytest.mark.parametrize("quantity", ["residual_percent", "heading_error_after_deg"])
def test_a_small_error_is_no_outlier_and_a_large_one_is(tmp_path, rng, quantity):
    around = np.exp(rng.normal(0, 0.05, 30))
    named, _ = compasses(
        tmp_path, rng, 30, **{quantity: lambda k: float(around[k]) * {4: 0.05, 9: 20}.get(k, 1)}
    )
    assert [item.split(":")[0] for item in named] == ["unit-00009"]
    assert "above the median" in named[0]


def soft(xx):
    return [[xx, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]


def test_relative_soft_irons_are_not_compared_with_scaled_ones(tmp_path, rng):
    around = np.exp(rng.normal(0, 0.05, 30))
    named, labels = compasses(
        tmp_path, rng, 30,
        soft_iron=lambda k: soft(1 + float(around[k]) * (3e-3 if k < 5 else 0.2 if k < 29 else 3.0)),
        field_known=lambda k: k >= 5,
    )  # fmt: skip
    assert [item.split(":")[0] for item in named] == ["unit-00029"]
    assert re.search(
        r"soft iron off identity [\d.]+, \d+ robust standard deviations above", named[0]
    )
    (label,) = [label for label in labels if "soft iron" in label]
    assert re.search(
        r"25 devices, median 0\.\d+, from 0\.\d+ to \d\.\d+; 1 outlying; 5 of another scale left out",
        label,
    )


def test_models_are_groups_the_needy_one_first(tmp_path, rng):
    write_tree(tmp_path, 20, rng, models=("IMU-A", "IMU-B"))  # unit 7, which fails, is a B
    rows = Texts(group_page(tmp_path.resolve())).rows
    heads = [row for row in rows if row.startswith("IMU-")]
    assert heads == ["IMU-B ✓ 9 pass ✗ 1 fail", "IMU-A ✓ 10 pass"]


def test_every_quantity_of_a_model_has_its_distribution(tmp_path, rng):
    write_tree(tmp_path, 20, rng, models=("IMU-A",))
    page = group_page(tmp_path.resolve())
    labels = re.findall(r'role="img" aria-label="([^"]*)"', page)
    assert len(labels) == 4
    assert labels[0].startswith("Gyroscope: angle random walk N. 20 devices, median 0.3")
    assert "limit ≤ 1.031" in labels[0]
    (tmp_path / "few").mkdir()
    assert "<svg" not in page_of(tmp_path / "few", *(result(k, rng) for k in range(5)))


@pytest.mark.parametrize("content", [
    "", "[]", "null", "{", '{"device": 3}', "[" * 5000, '{"device": {"id": "a"}, "chapters": [1]}'
])  # fmt: skip
def test_what_cannot_be_read_is_a_row_that_says_so(tmp_path, rng, content):
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "results.json").write_text(content)
    shown = Texts(page_of(tmp_path, result(1, rng)))
    assert "bad ✗ failed – – – – –" in shown.rows[2]
    assert "bad: its results.json cannot be read: render it again" in shown.items


@pytest.mark.parametrize("value", [float("inf"), float("nan"), 1e305, -1.0, 0, True, "x", None])
def test_numbers_that_are_none_break_nothing(tmp_path, rng, value):
    found = [result(k, rng, ("A",)) for k in range(12)]
    found[2]["sensors"]["gyroscope"]["noise"]["x"]["random_walk"]["value"] = value
    found[3]["checks"][0] |= {"value": value, "low": value, "high": value}
    page = page_of(tmp_path, *found)
    assert sum(row.startswith("unit-") for row in Texts(page).rows) == 12
    assert "nan" not in page
    assert "inf" not in page.replace("info", "")


def test_links_to_elsewhere_are_not_read(tmp_path, rng):
    out = tmp_path / "out"
    out.mkdir()
    page_of(out, result(1, rng))
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "results.json").write_text(json.dumps(result(2, rng)))
    (out / "link").symlink_to(tmp_path / "secret")
    assert "unit-00002" not in group_page(out.resolve())


def test_names_stay_inert(tmp_path, rng):
    found = result(1, rng)
    for key in ("name", "model"):
        found["device"][key] = NASTY
    found["problems"] = [NASTY]
    found["checks"] = []
    page = page_of(tmp_path, found)
    assert page.count("<script>") == 1
    assert "<img" not in page


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the page with")
def test_a_click_sorts_and_the_policy_allows_this_script_alone(tmp_path, rng):
    write_tree(tmp_path, 15, rng, models=("IMU-A",))
    page = group_page(tmp_path.resolve())
    opened = tmp_path / "page.html"
    opened.write_text(page, encoding="utf-8")
    (tmp_path / "browser").mkdir()
    shown = Opened(opened, tmp_path / "browser")
    assert shown.console == []
    assert shown.requests == set()
    assert shown.dom.count("<button") == 8  # the script ran
    driver = 'document.querySelectorAll("thead button")[3].click();'
    opened.write_text(
        re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page).replace(
            "</body>", f"<script>{driver}</script></body>"
        ),
        encoding="utf-8",
    )
    (tmp_path / "again").mkdir()
    rows = [r for r in Texts(Opened(opened, tmp_path / "again").dom).rows if r.startswith("unit-")]
    numbers = [float(re.search(r"(?:pass|fail|undecided) ([\d.]+)", row)[1]) for row in rows]
    assert len(numbers) == 15
    assert numbers == sorted(numbers)
    # One more script than the one whose hash the policy holds does not run.
    opened.write_text(
        page.replace("</body>", f"<script>{driver}</script></body>"), encoding="utf-8"
    )
    (tmp_path / "third").mkdir()
    third = Opened(opened, tmp_path / "third")
    assert any("Content Security Policy" in line for line in third.console)
    first = next(r for r in Texts(third.dom).rows if r.startswith("unit-"))
    assert first.startswith("unit-00007")


def test_ten_thousand_devices_are_lean(tmp_path, rng):
    """A row of the page in bytes; the whole is measured by benchmarks/group_page.py."""
    write_tree(tmp_path, 300, rng)
    more = tmp_path / "more"
    more.mkdir()
    base = [result(k, rng) for k in range(300)]
    small = len(group_page(tmp_path.resolve()).encode())
    extra = copy.deepcopy(base)
    for k, found in enumerate(extra):
        found["device"]["id"] = f"more-{k:05d}"
    page_of(tmp_path, *extra)
    assert (len(group_page(tmp_path.resolve()).encode()) - small) / 300 < 500
