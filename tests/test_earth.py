"""The Earth's magnetic field at a place, against published values."""

from datetime import date

import numpy as np
import pytest

from sensorbook.earth import FIELD_STD, field_at

# NOAA/NCEI and BGS, test values of the World Magnetic Model 2020 (TR, table 6) and 2025
# (WMM2025_TEST_VALUES.txt): date, height km, latitude, longitude; X, Y, Z, F in nT; dip, deg.
# The models are of other authors and fits than the IGRF, from much the same observations.
PUBLISHED = [
    (date(2020, 1, 1), 0, 80, 0, 6570.4, -146.3, 54606.0, 55000.1, 83.14),
    (date(2020, 1, 1), 0, 0, 120, 39624.3, 109.9, -10932.5, 41104.9, -15.42),
    (date(2020, 1, 1), 0, -80, 240, 5940.6, 15772.1, -52480.8, 55120.6, -72.20),
    (date(2020, 1, 1), 100, 80, 0, 6261.8, -185.5, 52429.1, 52802.0, 83.19),
    (date(2020, 1, 1), 100, 0, 120, 37636.7, 104.9, -10474.8, 39067.3, -15.55),
    (date(2020, 1, 1), 100, -80, -120, 5744.9, 14799.5, -49969.4, 52430.6, -72.37),
    (date(2025, 1, 1), 0, 80, 0, 6521.6, 145.9, 54791.5, 55178.5, 83.21),
    (date(2025, 1, 1), 0, 0, 120, 39677.8, -109.6, -10580.2, 41064.3, -14.93),
    (date(2025, 1, 1), 0, -80, -120, 6117.5, 15751.9, -52022.5, 54698.2, -72.00),
]


@pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: f"{row[0].year} {row[2:4]} {row[1]} km")
def test_strength_and_dip_as_published(row):
    day, height, latitude, longitude, x, y, z, strength, dip = row
    assert np.sqrt(x**2 + y**2 + z**2) == pytest.approx(strength, abs=0.2)  # copied rightly
    found = field_at(
        {"latitude": latitude, "longitude": longitude, "height": 1000 * height, "date": day}
    )
    # The two models differ by up to some 20 nT, a tenth of what is stated as the standard error.
    assert 1e9 * found.strength == pytest.approx(strength, abs=25)
    assert np.degrees(found.dip) == pytest.approx(dip, abs=0.04)
    assert found.std == FIELD_STD


def test_between_epochs():
    """WMM2025's value for 2027.5 at 0° N 120° E; its forecast and the IGRF's differ by more."""
    found = field_at({"latitude": 0.0, "longitude": 120.0, "date": date(2027, 7, 2)})
    x, y, z = 39701.6, -167.4, -10381.8
    assert 1e9 * found.strength == pytest.approx(np.sqrt(x**2 + y**2 + z**2), abs=60)
    assert found.dip == pytest.approx(np.arctan2(z, np.hypot(x, y)), abs=np.radians(0.1))


def test_height_not_given_is_taken_as_the_ellipsoid():
    site = {"latitude": 48.0, "longitude": 11.0, "date": date(2024, 5, 1)}
    assert field_at(site) == field_at(site | {"height": 0.0})
    # A dipole's field falls by 3 / radius: 0.047 % a kilometre.
    higher = field_at(site | {"height": 1000.0}).strength
    assert higher / field_at(site).strength == pytest.approx(1 - 3 / 6371, abs=1e-4)


@pytest.mark.parametrize(
    ("latitude", "longitude", "words"),
    [
        (39.89, 32.78, "39.89° N, 32.78° E"),
        (-33.9, -70.25, "33.9° S, 70.25° W"),
        (0.0, 0.0, "0° N, 0° E"),
    ],
)
def test_place_in_words(latitude, longitude, words):
    found = field_at({"latitude": latitude, "longitude": longitude, "date": date(2024, 5, 1)})
    assert found.source == f"the Earth's field (IGRF-14) at {words} on 2024-05-01"


@pytest.mark.parametrize(
    ("site", "words"),
    [
        (None, "not known: [site] has no latitude and no longitude and no date"),
        ({}, "not known: [site] has no latitude and no longitude and no date"),
        ({"latitude": 1.0, "longitude": 2.0}, "not known: [site] has no date"),
        ({"date": date(2024, 5, 1)}, "not known: [site] has no latitude and no longitude"),
        (
            {"latitude": 1.0, "date": date(2024, 5, 1), "height": 3.0},
            "not known: [site] has no longitude",
        ),
    ],
)
def test_what_is_missing_is_named(site, words):
    found = field_at(site)
    assert (found.strength, found.dip, found.std, found.source) == (None, None, 0.0, words)


@pytest.mark.parametrize(
    ("day", "year"), [(date(1899, 12, 31), 1899), (date(2030, 1, 1), 2030), (date(1, 1, 1), 1)]
)
def test_a_date_outside_the_model(day, year):
    found = field_at({"latitude": 1.0, "longitude": 2.0, "date": day})
    assert found.strength is None
    assert found.dip is None
    assert found.source == f"not known: the IGRF holds from 1900 to 2030, not in {year}"


@pytest.mark.parametrize("day", [date(1900, 1, 1), date(2029, 12, 31)])
def test_first_and_last_day(day, capsys):
    found = field_at({"latitude": 50.0, "longitude": 10.0, "date": day})
    assert 45e-6 < found.strength < 51e-6
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("latitude", [90.0, -90.0])
def test_at_a_pole_the_longitude_does_not_matter(latitude):
    """The field there is that of 100 m away, and nearly upright."""
    day = date(2024, 5, 1)
    found = [
        field_at({"latitude": latitude, "longitude": longitude, "date": day})
        for longitude in (0.0, 77.0, -120.0)
    ]
    near = field_at({"latitude": latitude * 0.99999, "longitude": 0.0, "date": day})
    for one in found:
        assert one.strength == pytest.approx(near.strength, rel=1e-4)
        assert one.dip == pytest.approx(near.dip, abs=1e-3)
        assert one.dip * latitude > 0
        assert one.strength == pytest.approx(found[0].strength, rel=1e-6)


def test_longitude_counts_either_way():
    site = {"latitude": -20.0, "date": date(2024, 5, 1)}
    west = field_at(site | {"longitude": -120.0})
    assert field_at(site | {"longitude": 240.0}).strength == pytest.approx(west.strength, rel=1e-9)
