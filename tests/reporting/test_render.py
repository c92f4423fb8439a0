"""Pages: self-contained, inert to what the input holds, and readable."""

from __future__ import annotations

import re

import nbformat
import pytest
from bs4 import BeautifulSoup
from throwaway import NASTY

from sensorbook.notebook import MIME, escape
from sensorbook.reporting import group, index, results
from sensorbook.reporting.render import chapter_page, inert_html, mathml

RECORD = {
    "chapter": "allan",
    "title": "Allan deviation",
    "sensor": "gyroscope",
    "status": "complete",
    "reason": None,
    "device": {"id": "dev-1", "name": NASTY},
    "software": dict.fromkeys(("sensorbook", "python", "numpy", "scipy"), "1.0"),
    "created": "2026-05-01T10:00:00+00:00",
}
PIXEL = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="


def page(*cells, record=RECORD):
    notebook = nbformat.v4.new_notebook()
    for cell in cells:
        if isinstance(cell, str):
            notebook.cells.append(nbformat.v4.new_markdown_cell(cell))
        else:
            notebook.cells.append(nbformat.v4.new_code_cell("code_of_ours()", outputs=[cell]))
    return chapter_page(notebook, record)


def output(metadata=None, **data):
    kinds = {"png": "image/png", "html": "text/html", "markdown": "text/markdown"}
    bundle = {kinds.get(k, "text/plain" if k == "plain" else MIME): v for k, v in data.items()}
    return nbformat.v4.new_output("display_data", data=bundle, metadata=metadata or {})


def body(html):
    return BeautifulSoup(html, "html.parser")


def test_pages_hold_no_script_and_no_address():
    html = page(
        "# Title\n\n[a link](https://a.example/x) https://b.example <https://c.example>",
        "## Two\n\n$x < y$\n\n$$\\sqrt{2}$$",
        "## Three\n\n- one\n\n## Four",
        output(png=PIXEL, metadata={"image/png": {"alt": "A point"}}),
        record=RECORD | {"device": {"id": "dev-1", "name": "A device"}},
    )
    assert not re.search(r"https?:|//[a-z]|<script|xmlns|url\(", html, re.IGNORECASE)
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'" in html
    assert "a link" in html
    assert "b.example" in html
    for tag in body(html).find_all(src=True):
        assert tag["src"].startswith("data:image/png;base64,")
    for tag in body(html).find_all(href=True):
        assert re.match(r"#|\.\./index\.html|data:,|allan\.(ipynb|json)", tag["href"])


def test_the_first_heading_is_the_title_and_the_others_make_the_contents():
    soup = body(page("# What $N$ is", "## A\n\n### B <i>c</i>\n\n## A", "## $D$"))
    assert [h.get_text() for h in soup.find_all("h1")] == ["What N is"]
    links = soup.find(class_="contents").find_all("a")
    assert [a["href"] for a in links] == ["#a", "#b-c", "#a-1", "#section"]
    for link in links:
        assert soup.find(id=link["href"][1:]).name in ("h2", "h3")


def test_mathematics_becomes_mathml():
    soup = body(
        page(
            "# T\n\nInline $\\sigma^2(\\tau)$ and\n\n$$\\begin{aligned} a &= b \\\\ c &< d \\end{aligned}$$"
        )
    )
    inline, block = soup.find_all("math")
    assert inline.get_text() == "σ2(τ)"
    assert block["display"] == "block"
    assert "<" in block.get_text()


@pytest.mark.parametrize(
    "latex",
    [r"\text{<script>alert(1)</script>}", r"\href{javascript:x}{y}", r"\notacommand{<b>}", "<img>"],
)
def test_mathematics_cannot_carry_markup(latex):
    soup = body(mathml(latex, "inline"))
    assert not soup.find_all(["script", "img", "b", "a"])
    assert not soup.find_all(href=True)


def test_functions_are_set_apart_from_their_argument():
    assert "<mi>ln</mi><mspace" in mathml(r"2 \ln 2", "inline")
    assert "mspace" not in mathml(r"\sin(x)", "inline")
    assert "mspace" not in mathml(r"\sigma^2 = \ln^2(x)", "inline")


@pytest.mark.parametrize(
    ("latex", "shown"),
    [
        (r"\mathbf A", "\N{MATHEMATICAL BOLD CAPITAL A}"),
        (r"\mathbf{A}", "\N{MATHEMATICAL BOLD CAPITAL A}"),
        (r"\mathbf{Az09}", "𝐀𝐳𝟎𝟗"),
        (r"\mathbf x_{\mathbf n}", "𝐱𝐧"),
        (r"\mathbf\Omega\mathbf\nabla", "𝛀𝛁"),
        (r"\boldsymbol\omega", "\N{MATHEMATICAL BOLD ITALIC SMALL OMEGA}"),
        (r"\boldsymbol{\varphi\epsilon}", "𝝋𝝐"),
        (r"\boldsymbol{x1}", "𝒙𝟏"),  # there are no bold italic digits
        (r"\mathbb R\mathbb{R}\mathbb{Xk1}", "ℝℝ𝕏𝕜𝟙"),
        (r"\mathcal L\mathcal{A}", "ℒ𝒜"),
        (r"\mathfrak C\mathfrak g", "ℭ𝔤"),
        (r"\mathsf T", "𝖳"),
        (r"\mathtt x", "𝚡"),
        (r"\mathit{gh}", "𝑔ℎ"),
        (r"\mathbf{a + ш}", "𝐚+ш"),  # what has no bold character stays
    ],
)
def test_alphabets_are_characters_as_browsers_know_no_other(latex, shown):
    made = mathml(latex, "inline")
    assert body(made).get_text() == shown
    assert "mathvariant" not in made


def test_an_upright_letter_stays_upright():
    assert mathml(r"\mathrm d t", "inline").count('<mi mathvariant="normal">d</mi>') == 1


def test_mathematics_that_cannot_be_converted_is_shown_as_written():
    assert mathml(r"\left( x<", "inline") == r"<code>\left( x&lt;</code>"


def test_figures_have_their_description_size_and_caption():
    about = {"alt": 'A "b" <i>', "caption": "See <b>", "width": 600, "height": 300}
    (figure,) = body(page(output(png=PIXEL, metadata={"image/png": about}))).find_all("figure")
    assert figure.img["alt"] == 'A "b" <i>'
    assert (figure.img["width"], figure.img["height"]) == ("600", "300")
    assert figure.figcaption.get_text() == "See <b>"


def test_a_figure_without_description_still_has_an_alternative_text():
    assert body(page(output(png=PIXEL))).img["alt"]


def test_our_text_may_hold_html_and_outputs_may_not():
    soup = body(page("# T\n\n<mark>ours</mark>", output(markdown="<u>theirs</u> **bold**")))
    assert soup.find("mark").get_text() == "ours"
    assert not soup.find("u")
    assert "<u>theirs</u> bold" in soup.main.get_text()


@pytest.mark.parametrize(
    "text", [NASTY, "# heading\n* item", "![x](y.png)", "1. a | b | c", "$a$ www.x.example"]
)
def test_input_text_in_a_sentence_stays_inert(text):
    soup = body(page("# T", output(markdown=f"The device {escape(text)} is here.")))
    (paragraph,) = soup.main.find_all("p")
    shown = " ".join(text.split())
    assert paragraph.get_text() == f"The device {shown} is here."
    assert not paragraph.find_all(True)


def test_unescaped_links_and_images_of_an_output_lead_nowhere():
    soup = body(
        page("# T", output(markdown="[a](javascript:x) [b](http://c) ![d](http://e) [f](g.html)"))
    )
    assert not soup.main.find_all(["a", "img"])


def test_the_devices_name_is_text_wherever_it_stands():
    soup = body(page("# T"))
    assert NASTY in soup.title.get_text()
    assert soup.header.nav.get_text(strip=True) == f"← {NASTY}"
    assert not soup.find_all("script")


def test_html_of_outputs_keeps_tables_only():
    kept = inert_html(
        '<style>td {}</style><table class="t" onclick="x()"><caption>c</caption><tr>'
        '<td colspan="2" style="x">1 &lt; 2</td></tr></table><script>alert(1)</script>'
        '<a href="http://x">y</a><img src=x onerror=alert(1)><svg><g onload=x></svg>'
    )
    soup = body(kept)
    assert soup.table["class"] == ["t"]
    assert soup.td.attrs == {"colspan": "2"}
    assert not soup.find_all(["script", "style", "a", "img", "svg", "g"])
    assert soup.td.get_text() == "1 < 2"


def test_what_is_not_for_readers_is_left_out():
    soup = body(
        page(
            "# T",
            nbformat.v4.new_output("stream", name="stderr", text="a warning of a library"),
            output(record={"results": {}}, plain="Results recorded: noise"),
            output(markdown="*caption*", metadata={"sensorbook": "caption"}),
            nbformat.v4.new_output("stream", name="stdout", text="\x1b[31mprinted <b>\x1b[0m"),
        )
    )
    text = soup.main.get_text()
    assert "a warning" not in text
    assert "recorded" not in text
    assert "caption" not in text
    assert soup.find_all("pre")[-1].get_text() == "printed <b>" or "printed <b>" in text


def test_code_is_folded_away_and_joined():
    soup = body(page("# T", output(markdown="shown")))
    (fold,) = soup.find_all("details")
    assert "open" not in fold.attrs
    assert "code_of_ours" in fold.get_text()


def test_pages_do_not_inherit_from_each_other():
    first, again = page("# One\n\n## A\n\n## B\n\n## C"), page("# Two\n\n## A\n\n## B\n\n## C")
    assert first.replace("One", "Two") == again


@pytest.mark.parametrize(
    ("numbers", "shown"),
    [
        ((0.21043, 0.206, 0.2151), ("0.2104", "0.2060", "0.2151")),
        ((10.31, 9.8, 10.83), ("10.31", "9.80", "10.83")),
        ((1234.5, 1100, 1400), ("1230", "1100", "1400")),
        ((1.234e-7, 1.1e-7, 1.4e-7), ("1.23e-07", "1.1e-07", "1.4e-07")),
        ((2.0, 2.0, 2.0), ("2", "2", "2")),
    ],
)
def test_intervals_choose_the_digits(numbers, shown):
    assert index.interval(*numbers) == shown


def noise_table(**of_x):
    """The rows of a device page whose axis x has these noise terms: name, unit and cells of x and y."""
    plain = dict.fromkeys(
        ("quantization", "random_walk", "bias_instability", "rate_random_walk", "rate_ramp")
    )
    found = {"noise": dict.fromkeys("xyz", plain) | {"x": plain | of_x}}
    device = {"id": "dev-1", "name": "A device", "model": None, "serial": None, "spec": {}}
    record = {key: RECORD[key] for key in ("chapter", "title", "sensor", "status", "reason")}
    assembled = results.assemble(
        device, RECORD["software"], RECORD["created"], [record | {"results": found}]
    )
    rows = body(index.device_page(assembled, results.SCHEMA.parent)).select("table tbody tr")
    cells = [[cell.get_text(" ") for cell in row.find_all(["th", "td"])] for row in rows]
    return {row[0]: (row[4], row[1], row[2]) for row in cells if len(row) == 5}


def entry(value):
    return {"value": value, "low": 0.9 * value, "high": 1.1 * value}


def test_rare_terms_have_a_row_where_an_axis_shows_them():
    usual = [
        "Angle random walk N",
        "Noise density √2·N",
        "Bias instability B",
        "Rate random walk K",
    ]
    assert list(noise_table()) == usual
    rows = noise_table(quantization=entry(1e-4), rate_ramp=entry(1e-6))
    assert list(rows) == ["Quantization Q", *usual, "Rate ramp R"]
    # 1e-6 rad/s² · 180/π · 3600 s/h
    assert rows["Rate ramp R"] == ("°/h/s", "0.206 0.186 … 0.227", "no visible effect")


def test_a_gauss_markov_process_has_its_rows_where_an_axis_has_one():
    rows = noise_table(
        gauss_markov={"correlation_time": entry(40.0), "std": entry(4.848e-5)}  # 10 °/h
    )
    assert list(rows)[4:] == ["Gauss–Markov std", "Gauss–Markov correlation time"]
    assert rows["Gauss–Markov std"] == ("°/h", "10.00 9.00 … 11.00", "–")
    assert rows["Gauss–Markov correlation time"] == ("s", "40.0 36.0 … 44.0", "–")


def test_the_group_page_bears_what_others_left_in_the_folder(tmp_path):
    for name, text in (("a", "not json"), ("b", "{}"), ("c<b>", "[]")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "results.json").write_text(text)
    (tmp_path / "link").symlink_to(tmp_path / "a")
    soup = body(group.group_page(tmp_path))
    assert len(soup.tbody.find_all("tr")) == 3
    assert soup.get_text().count("cannot be read") == 3


def test_marks_that_reverse_the_order_show():
    name = "log\u202evsc.exe\u2066"
    html = page("# Title", record=RECORD | {"device": {"id": "dev-1", "name": name}})
    assert "log\ufffdvsc.exe\ufffd" in html
    assert not re.search("[\u202a-\u202e\u2066-\u2069]", html)


def test_the_index_says_first_what_was_refused_and_each_reason_once():
    device = {"id": "dev-1", "name": "A device", "model": None, "serial": None, "spec": {}}
    refused = RECORD | {"status": "refused", "reason": "The rest is too short.", "results": {}}
    records = [refused, refused | {"chapter": "noise"}]
    found = results.assemble(device, RECORD["software"], RECORD["created"], records)
    soup = body(index.device_page(found, results.SCHEMA.parent))
    first = soup.main.find("div", recursive=False)
    assert [p.get_text() for p in first.find_all("p")] == [
        "? 2 of 2 chapters refused: the recordings cannot determine what they ask.",
        "The rest is too short.",
    ]
    # A sensor without a number has no heading of its own.
    assert [h.get_text() for h in soup.find_all("h2")] == ["Chapters"]


def test_an_empty_header_cell_is_no_header():
    table = "<table><thead><tr><th></th><th>x</th></tr></thead></table>"
    cells = body(page(output(html=table))).select("table tr > *")
    assert [cell.name for cell in cells] == ["td", "th"]
