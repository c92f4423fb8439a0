"""The book: every chapter once, in order, on the first device that feeds it; what ends otherwise is told."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import time

import pytest
from browser import AXE, CHROMIUM, examine
from bs4 import BeautifulSoup
from throwaway import FIGURE, LOAD, NASTY, Run, chapter, run, write_device, write_notebook

from sensorbook import cli
from sensorbook.reporting import execute
from sensorbook.reporting.book import book
from sensorbook.reporting.chapters import Chapter

WITH_RECORD = 'device = ""\nsensor = ""\nthermal_record = ""'
STATIC = LOAD.replace("KIND", '"static"')
THERMAL = LOAD.replace("KIND", '"thermal"')
NEEDED = (
    "found = read_record(thermal_record)\nsay('Needed {t}.', t=found and found['device']['id'])"
)
NO_DEVICE = """
from sensorbook.notebook import *
say('Twice is {n}.', n=2 * number)
record({'twice': 2 * number})
"""
REFUSES = "import sensorbook\nraise sensorbook.Refusal('Too short.', 'Record <b>more</b>.')"


def without_device(slug, notebook):
    return Chapter(slug, notebook, slug.capitalize(), "", (), (), "")


def bind(paths, out, **options) -> Run:
    stdout, stderr = io.StringIO(), io.StringIO()
    code = book([str(p) for p in paths], str(out), stdout=stdout, stderr=stderr, **options)
    return Run(out, code, stdout.getvalue(), stderr.getvalue())


def entries(done) -> list:
    """The table of contents, an entry a chapter."""
    return BeautifulSoup(done.text("book", "index.html"), "html.parser").select(".toc li")


def said(entry) -> str:
    return " ".join(entry.get_text(" ").split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("book")


@pytest.fixture(scope="module")
def notebooks(folder):
    def made(name, *cells, parameters='device = ""\nsensor = ""'):
        return write_notebook(folder / f"{name}.ipynb", *cells, parameters=parameters)

    title = "# Title\n\n**What is\n$x$ <b>?** And **this?**"
    return {
        "thermal": made("thermal", title, THERMAL, "record({'thermal': {}})"),
        "static": made("static", "# S", STATIC, NEEDED, FIGURE, parameters=WITH_RECORD),
        "positions": made(
            "positions",
            "# P",
            LOAD.replace("KIND", '"positions"'),
            NEEDED,
            parameters=WITH_RECORD,
        ),
        "refused": made("refused", "# R", STATIC, REFUSES),
        "failing": made("failing", "# F", STATIC, "1 / 0"),
        "free": made(
            "free",
            "# Free\n\n**How much?**",
            NO_DEVICE,
            ("raise RuntimeError('a teaching cell ran')", ["teaching"]),
            parameters="number = 3.0",
        ),
        "broken": made("broken", "# B", "1 / 0", parameters="number = 3.0"),
    }


@pytest.fixture(scope="module")
def devices(folder):
    """The first feeds thermal and static, the second positions, whose gyroscope is another one."""
    first = [("accelerometer", "static"), ("gyroscope", "static"), ("gyroscope", "thermal")]
    second = [("accelerometer", "positions"), ("gyroscope", "positions"), ("gyroscope", "static")]
    return (
        write_device(folder / "data" / "one", "one", first, NASTY),
        write_device(folder / "data" / "two", "two", second),
    )


@pytest.fixture(scope="module")
def rows(notebooks):
    return (
        chapter("thermal", notebooks["thermal"], "thermal", result="thermal"),
        chapter("allan", notebooks["static"], needs=("thermal",)),
        without_device("free", notebooks["free"]),
        chapter("gyro", notebooks["positions"], "positions", needs=("thermal",)),
        chapter("refused", notebooks["refused"]),
        without_device("last", notebooks["free"]),
    )


@pytest.fixture(scope="module")
def bound(folder, devices, rows, table):
    table(*rows)
    return bind(devices, folder / "bound", jobs=2)


def test_every_chapter_has_its_three_files_and_nothing_else_is_there(bound, rows):
    files = {f"book/{row.slug}.{kind}" for row in rows for kind in ("html", "json", "ipynb")}
    assert bound.files() == {"book/index.html", *files}
    assert bound.code == 0, bound.stderr
    assert bound.stderr == ""


def test_progress_is_told_as_a_report_tells_it(bound):
    *lines, last = bound.stdout.splitlines()
    assert last == str(bound.out / "book" / "index.html")
    assert [line.split()[0] for line in lines] == [f"[{n}/6]" for n in range(1, 7)]
    told = {re.sub(r"^\S+ |, [\d.]+ s(, about .* left)?$", "", line) for line in lines}
    assert told == {
        "book/thermal on one gyroscope: complete",
        "book/allan on one gyroscope: complete",
        "book/free: complete",
        "book/gyro on two gyroscope: complete",
        "book/refused on one gyroscope: refused",
        "book/last: complete",
    }


def test_the_contents_are_in_reading_order_with_question_and_device(bound):
    found = entries(bound)
    assert [e.select_one(".number").get_text() for e in found] == list("123456")
    titles = [e.select_one(".name a") for e in found]
    assert [(a.get_text(), a["href"]) for a in titles] == [
        (slug.capitalize(), f"{slug}.html")
        for slug in ("thermal", "allan", "free", "gyro", "refused", "last")
    ]
    assert found[0].select_one(".question").get_text() == "What is $x$ <b>?"
    assert found[2].select_one(".question").get_text() == "How much?"
    assert found[1].select_one(".question") is None
    assert "On the gyroscope of A device" in said(found[3])
    assert f"On the gyroscope of {NASTY}" in said(found[0])
    assert "Needs no device" in said(found[2])
    assert [len(e.select("img")) for e in found] == [0, 1, 0, 0, 0, 0]
    assert found[1].img["alt"] == 'A "parabola" <b>'


def test_needs_come_from_the_same_sensor_of_the_same_device_alone(bound):
    assert "Needed one." in bound.text("book", "allan.html")
    # The thermal chapter was shown on another device's gyroscope.
    assert "Needed None." in bound.text("book", "gyro.html")
    allan, gyro = (json.loads(bound.text("book", f"{s}.json")) for s in ("allan", "gyro"))
    assert allan["parameters"] == {"thermal_record": "thermal.json"}
    assert gyro["parameters"] == {"thermal_record": ""}


def test_an_accelerometer_is_shown_where_there_is_no_gyroscope(tmp_path, rows, table):
    only = write_device(
        tmp_path / "d", "dev", [("magnetometer", "static"), ("accelerometer", "static")]
    )
    table(rows[4])
    assert "book/refused on dev accelerometer" in bind([only], tmp_path / "out").stdout


def test_a_chapter_without_device_is_complete_and_its_record_names_none(bound):
    record = json.loads(bound.text("book", "free.json"))
    assert (record["status"], record["device"], record["sensor"]) == ("complete", None, None)
    assert record["results"] == {"twice": 6.0}
    assert record["parameters"] == {}
    page = bound.text("book", "free.html")
    assert "Twice is 6.0." in page
    assert "Needs no device" in page


def test_a_refused_chapter_has_a_page_with_its_reason_and_does_not_fail_the_book(bound):
    assert "Too short. Record &lt;b&gt;more&lt;/b&gt;." in bound.text("book", "refused.html")
    entry = said(entries(bound)[4])
    assert "? refused" in entry
    assert "Too short. Record <b>more</b>." in entry


def test_pages_lead_to_contents_and_neighbours(bound, rows):
    for k, row in enumerate(rows):
        soup = BeautifulSoup(bound.text("book", f"{row.slug}.html"), "html.parser")
        assert soup.find("nav", {"aria-label": "Up"}).a["href"] == "index.html"
        assert soup.select_one(".eyebrow").get_text() == f"Chapter {k + 1}"
        before, after = soup.find_all(rel="prev"), soup.find_all(rel="next")
        assert [a["href"] for a in before] == ([f"{rows[k - 1].slug}.html"] if k else [])
        assert [a["href"] for a in after] == [f"{r.slug}.html" for r in rows[k + 1 : k + 2]]


def assert_links_resolve(done):
    for page in (done.out / "book").glob("*.html"):
        soup = BeautifulSoup(page.read_text(encoding="utf-8"), "html.parser")
        for link in soup.find_all("a", href=True):
            target = page if link["href"].startswith("#") else page.parent / link["href"]
            assert target.is_file(), (page.name, link["href"])


def test_links_resolve_and_pages_hold_no_script_and_no_address(bound):
    assert_links_resolve(bound)
    for page in (bound.out / "book").glob("*.html"):
        html = page.read_text(encoding="utf-8")
        soup = BeautifulSoup(html, "html.parser")
        assert not soup.find_all(["script", "iframe", "object"])
        assert [link["href"] for link in soup.find_all("link")] == ["data:,"]
        assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'" in html
        for tag in soup.find_all(src=True):
            assert tag["src"].startswith("data:image/png;base64,")
        assert not re.search(r"url\(|@import", html)


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the pages with")
@pytest.mark.parametrize("page", ["index", "allan", "free"])
def test_pages_serve_everyone_and_fit_a_telephone(bound, page, tmp_path):
    shown = examine(bound.out / "book" / f"{page}.html", tmp_path, [(390, "light"), (1280, "dark")])
    for seen in shown.values():
        assert (seen["scroll"], seen["wide"]) == (seen["client"], [])
        if AXE.exists():
            assert [v for v in seen["violations"] if v["impact"] in ("serious", "critical")] == []


def test_what_no_page_shows_is_said_to_be_in_the_notebooks(bound, tmp_path, rows, table):
    line = "Exercises, their solutions and longer derivations"
    for row in rows:
        page = BeautifulSoup(bound.text("book", f"{row.slug}.html"), "html.parser")
        last = page.main.find_all("p")[-1].get_text() if line in page.main.get_text() else ""
        path = f"{row.notebook.parent.name}/free.ipynb"
        told = (
            f"{line} of this chapter are not shown here: they are in {path}, which make lab opens."
        )
        assert last == (told if row.slug in ("free", "last") else ""), row.slug
    contents = BeautifulSoup(bound.text("book", "index.html"), "html.parser")
    assert contents.get_text().count(line) == 1
    table(rows[0])
    done = bind([write_device(tmp_path / "d", "dev", [("gyroscope", "thermal")])], tmp_path / "out")
    assert line not in done.text("book", "index.html"), "no chapter has any"


def test_a_device_report_says_nothing_of_them(tmp_path, folder, table):
    notebook = write_notebook(
        folder / "taught.ipynb", "# T", STATIC, "record({'noise': {}})", ("1 / 0", ["teaching"])
    )
    table(chapter("allan", notebook))
    done = run([write_device(tmp_path / "d", "dev", [("gyroscope", "static")])], tmp_path / "out")
    assert (done.code, done.stderr) == (0, "")
    assert "make lab" not in done.text("dev", "gyroscope", "allan.html")


def test_failing_and_unfed_chapters_are_told_and_lose_what_an_earlier_book_had(
    tmp_path, devices, notebooks, rows, table
):
    out = tmp_path / "out"
    thermal, allan, free, gyro, _, last = rows
    table(thermal, allan, free, gyro, last)
    bind(devices, out)
    failing = chapter("allan", notebooks["failing"])
    table(thermal, failing, without_device("free", notebooks["broken"]), gyro, last)
    done = bind(devices[:1], out)
    assert done.code == 1
    unfed = (
        'no device given has a recording of kind "positions" of the accelerometer, gyroscope or'
        " magnetometer: name one that has"
    )
    fault = "the chapter stopped with ZeroDivisionError: division by zero (a fault in sensorbook; "
    told = sorted(done.stderr.splitlines())
    assert len(told) == 2
    assert told[0].startswith(f"book/allan on one gyroscope: {fault}executed notebook: {out}/book/")
    assert told[1].startswith(f"book/free: {fault}executed notebook: {out}/book/free.ipynb")
    assert f"book/gyro: not rendered: {unfed}" in done.stdout.splitlines()
    removed = [line for line in done.stdout.splitlines() if "removed" in line]
    assert removed == [
        f"{out}/book/{slug}.html: removed: it was of an earlier book"
        for slug in ("allan", "free", "gyro")
    ]
    kept = {f"book/{s}.{k}" for s in ("thermal", "last") for k in ("html", "json", "ipynb")}
    assert done.files() == {"book/index.html", "book/allan.ipynb", "book/free.ipynb", *kept}
    found = entries(done)
    assert [bool(e.select_one(".name a")) for e in found] == [True, False, False, False, True]
    assert "✗ failed" in said(found[1])
    assert "ZeroDivisionError" in said(found[1])
    assert "– not rendered" in said(found[3])
    assert unfed in said(found[3])
    assert_links_resolve(done)
    soup = BeautifulSoup(done.text("book", "thermal.html"), "html.parser")
    assert soup.find(rel="next")["href"] == "last.html", "it passes over what has no page"


def test_without_a_device_the_chapters_that_need_none_are_the_book(tmp_path, rows, table):
    table(*rows)
    done = bind([], tmp_path)
    assert (done.code, done.stderr) == (0, "")
    files = {
        f"book/{slug}.{kind}" for slug in ("free", "last") for kind in ("html", "json", "ipynb")
    }
    assert done.files() == {"book/index.html", *files}
    lines = done.stdout.splitlines()
    unfed = [line for line in lines if "not rendered" in line]
    assert [line.split(":")[0] for line in unfed] == [
        f"book/{slug}" for slug in ("thermal", "allan", "gyro", "refused")
    ]
    assert not [line for line in lines if "removed" in line]
    kinds = [e.select_one(".soft").get_text() for e in entries(done)]
    assert [kind == "– not rendered" for kind in kinds] == [True, True, False, True, True, False]
    assert_links_resolve(done)


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"nbformat": 4}', "\x00\xff"])
def test_a_damaged_notebook_fails_its_chapter_alone(content, tmp_path, rows, table):
    damaged = tmp_path / "damaged.ipynb"
    damaged.write_text(content, encoding="latin-1")
    table(without_device("damaged", damaged), rows[2])
    done = bind([], tmp_path / "out")
    assert done.code == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("book/damaged: the chapter stopped with ")
    assert line.endswith("(a fault in sensorbook)")
    assert (done.out / "book" / "free.html").is_file()
    assert ["✗ failed" in said(entry) for entry in entries(done)] == [True, False]
    assert_links_resolve(done)


def test_a_book_that_is_stopped_has_contents_of_what_stands(
    tmp_path, devices, rows, table, monkeypatch
):
    thermal, _, free, _, refused, last = rows
    table(thermal, refused, free, last)
    executes, stopped_at = execute.execute, [free.notebook]
    # As where the tests themselves are run in the background, and were told to ignore it.
    signal.signal(signal.SIGINT, signal.default_int_handler)

    def stops(notebook, *rest, **options):
        if notebook in stopped_at:
            os.kill(os.getppid(), signal.SIGINT)  # what is made here is made in a fork
            time.sleep(60)
        return executes(notebook, *rest, **options)

    monkeypatch.setattr(execute, "execute", stops)
    with pytest.raises(KeyboardInterrupt):
        bind(devices, tmp_path, jobs=1)
    assert (tmp_path / "book" / "refused.html").is_file()
    done = Run(tmp_path, 130, "", "")
    pages = [e.select_one(".name a") for e in entries(done)]
    assert [a and a["href"] for a in pages] == ["thermal.html", "refused.html", None, None]
    assert "– not rendered the run was stopped before" in said(entries(done)[2])
    assert_links_resolve(done)
    earlier = done.files()
    stopped_at[:] = [thermal.notebook]
    other = write_device(tmp_path / "d", "other", [("gyroscope", "thermal")], "Another")
    with pytest.raises(KeyboardInterrupt):
        bind([other], tmp_path, jobs=1)
    assert done.files() - {"d/data.csv", "d/device.toml"} == {
        name for name in earlier if "refused" not in name
    }
    assert f"On the gyroscope of {NASTY}" in said(entries(done)[0]), "as its earlier page says"
    assert_links_resolve(done)


def test_a_fault_in_a_recording_names_the_device(tmp_path, rows, table):
    device = write_device(tmp_path / "d", "dev", [("gyroscope", "thermal")])
    (device / "data.csv").write_text("x,y,z,t\n1,2,3,4\n1,2,oops,4\n")
    table(rows[0])
    done = bind([device], tmp_path / "out")
    assert done.code == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("dev: data.csv: ")
    assert "oops" in line


def test_device_reports_stay_as_they_are_beside_the_book(tmp_path, devices, rows, table):
    """Chapters that need no device are none of a device's, and the book is no device."""
    out = tmp_path / "out"
    table(*rows)
    reported = run(devices[:1], out)
    before = {name: reported.text(name) for name in reported.files()}
    assert not [name for name in before if re.search("free|last|book", name)]
    found = json.loads(before["one/results.json"])
    assert {c["chapter"] for c in found["chapters"]} == {"thermal", "allan", "refused"}
    bind(devices, out)
    after = {n: reported.text(n) for n in reported.files() if not n.startswith("book/")}
    link = ' <a href="book/index.html">The methods, chapter by chapter</a>.'
    assert after.pop("index.html") == before.pop("index.html").replace(
        "1 device.", f"1 device.{link}"
    )
    assert after == before
    assert '<a href="../index.html">← All devices</a>' in reported.text("book", "index.html")
    again = run(devices[:1], out)
    assert link in again.text("index.html")
    assert "Free" not in again.text("index.html")


@pytest.mark.parametrize("bad", ["missing", "empty", "twice", "invalid"])
def test_a_device_with_a_problem_leaves_an_earlier_book(bad, tmp_path, devices):
    out = tmp_path / "out"
    (out / "book").mkdir(parents=True)
    (out / "book" / "thermal.html").write_text("earlier")
    other = tmp_path / bad
    message = "device.toml"
    if bad == "empty":
        other.mkdir()
    elif bad == "twice":
        write_device(other, "one", [("gyroscope", "static")])
        message = 'have the same id "one"'
    elif bad == "invalid":
        write_device(other, "bad", [("gyroscope", "static")])
        file = other / "device.toml"
        file.write_text(file.read_text().replace('"deg/s"', '"deg/x"', 1))
        message = "deg/x"
    done = bind([devices[0], other], out)
    assert done.code == 1
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""
    assert done.files() == {"book/thermal.html"}
    assert done.text("book", "thermal.html") == "earlier"


def test_a_book_folder_that_leads_elsewhere_or_holds_recordings_is_refused(tmp_path, devices):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "out").mkdir()
    os.symlink(elsewhere, tmp_path / "out" / "book")
    done = bind(devices, tmp_path / "out")
    assert (done.code, len(done.stderr.splitlines())) == (1, 1)
    assert "symbolic link" in done.stderr
    assert not list(elsewhere.iterdir())
    device = write_device(tmp_path / "book", "dev", [("gyroscope", "static")])
    done = bind([device], tmp_path)
    assert (done.code, len(done.stderr.splitlines())) == (1, 1)
    assert "--out" in done.stderr
    assert sorted(p.name for p in device.iterdir()) == ["data.csv", "device.toml"]


@pytest.mark.parametrize("place", [".", "reports", "static.csv", "link/reports"])
@pytest.mark.parametrize("named", ["", "device.toml"])
def test_a_folder_among_the_recordings_is_refused(place, named, tmp_path, capsys):
    device = write_device(tmp_path / "d", "dev", [("gyroscope", "static")])
    os.symlink(device, tmp_path / "link")
    out = tmp_path / place if place.startswith("link") else device / place
    assert cli.main(["book", str(device / named), "--out", str(out)]) == 1
    shown = capsys.readouterr()
    assert shown.err == (
        f"--out {out}: {device} holds a device's recordings: choose a folder outside of it\n"
    )
    assert shown.out == ""
    assert sorted(p.name for p in device.iterdir()) == ["data.csv", "device.toml"]


@pytest.mark.parametrize("command", ["book", "report"])
def test_an_out_without_a_name_is_refused(command, tmp_path, devices, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main([command, str(devices[0]), "--out", ""]) == 2
    assert capsys.readouterr().err.endswith("error: argument --out: '' names no folder\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [("--jobs", "0"), ("x", "--only", "thermal")])
def test_wrong_usage_is_2(arguments, capsys):
    assert cli.main(["book", *arguments]) == 2
    assert "usage: sensorbook" in capsys.readouterr().err


def test_the_command_says_how_and_does_it(tmp_path, devices, rows, table, capsys):
    assert cli.main(["book", "--help"]) == 0
    shown = capsys.readouterr().out
    assert "example:\n  sensorbook book " in shown
    assert "gyroscope" in shown
    assert "[DEVICE ...]" in shown
    assert "without a DEVICE" in shown
    table(rows[2])
    assert cli.main(["book", str(devices[0]), "--out", str(tmp_path), "--jobs", "1"]) == 0
    assert "[1/1] book/free: complete" in capsys.readouterr().out
    assert (tmp_path / "book" / "free.html").is_file()


def test_only_keeps_to_chapters_of_devices(tmp_path, rows, table, capsys):
    table(*rows)
    assert cli.main(["report", str(tmp_path), "--only", "free"]) == 2
    error = capsys.readouterr().err
    assert "no chapter 'free'; choose from thermal, allan, gyro, refused\n" in error
