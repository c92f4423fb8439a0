"""Executed notebooks → self-contained pages, and the surroundings all pages share.

Pages hold no script and no network address. Input text may stand in any output, so HTML in Markdown
outputs is escaped and HTML outputs keep only the tags of tables and text; the notebooks' own
Markdown cells are ours and may hold HTML.
"""

from __future__ import annotations

import contextlib
import html
import re
import threading
import unicodedata
from collections.abc import Iterable
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import bleach
import jinja2
import nbformat
from latex2mathml.converter import Converter
from markupsafe import Markup
from nbconvert import HTMLExporter, TemplateExporter
from nbconvert.filters.highlight import Highlight2HTML
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath

from sensorbook.notebook import MIME

TEMPLATES = Path(__file__).with_name("templates")

# What tables and short texts are made of; `style`, links and images have no place in an output.
TAGS = {
    "table", "thead", "tbody", "tfoot", "tr", "th", "td", "caption", "p", "div", "span", "br", "hr",
    "strong", "em", "b", "i", "u", "small", "code", "pre", "sub", "sup", "ul", "ol", "li", "dl", "dt",
    "dd", "h3", "h4", "h5", "h6", "abbr",
}  # fmt: skip
ATTRIBUTES = {
    "*": ["class", "title"],
    "th": ["colspan", "rowspan", "scope"],
    "td": ["colspan", "rowspan"],
    "ol": ["start"],
}
MATH_ATTRIBUTES = {
    "accent", "accentunder", "columnalign", "columnlines", "columnspacing", "depth", "display",
    "displaystyle", "fence", "form", "height", "linethickness", "lspace", "mathsize", "mathvariant",
    "maxsize", "minsize", "movablelimits", "rowlines", "rowspacing", "rspace", "scriptlevel",
    "separator", "stretchy", "symmetric", "voffset", "width",
}  # fmt: skip
# `mathvariant` → what the names of Unicode's mathematical alphanumerics begin with, the first that has
# the character: there are no bold italic digits, and some letters stood elsewhere before.
ALPHABETS = {
    "bold": ("MATHEMATICAL BOLD",),
    "italic": ("MATHEMATICAL ITALIC",),
    "bold-italic": ("MATHEMATICAL BOLD ITALIC", "MATHEMATICAL BOLD"),
    "double-struck": ("MATHEMATICAL DOUBLE-STRUCK", "DOUBLE-STRUCK"),
    "script": ("MATHEMATICAL SCRIPT", "SCRIPT"),
    "bold-script": ("MATHEMATICAL BOLD SCRIPT",),
    "fraktur": ("MATHEMATICAL FRAKTUR", "BLACK-LETTER"),
    "bold-fraktur": ("MATHEMATICAL BOLD FRAKTUR",),
    "sans-serif": ("MATHEMATICAL SANS-SERIF",),
    "bold-sans-serif": ("MATHEMATICAL SANS-SERIF BOLD",),
    "sans-serif-italic": ("MATHEMATICAL SANS-SERIF ITALIC",),
    "sans-serif-bold-italic": ("MATHEMATICAL SANS-SERIF BOLD ITALIC",),
    "monospace": ("MATHEMATICAL MONOSPACE",),
}


@cache
def environment() -> jinja2.Environment:
    """The templates of every page; whatever they show is escaped."""
    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    made.filters["day"] = _day
    made.globals["style"] = Markup((TEMPLATES / "style.css").read_text(encoding="utf-8"))
    return made


def chapter_page(
    notebook: nbformat.NotebookNode, record: dict[str, Any], book: dict[str, Any] | None = None
) -> str:
    """The page of an executed notebook, up to where it refused; `record` is the chapter's.

    In the book, `book` holds the chapter's `number`, its neighbours `previous` and `next`, each a (slug,
    title) with a page, or None, and `teaching`: the notebook with its teaching cells, or "".
    """
    exporter = _exporter()
    exporter.headings = []
    last = next((i for i, cell in enumerate(notebook.cells) if _refused(cell)), None)
    shown = notebook if last is None else {**notebook, "cells": notebook.cells[: last + 1]}
    body, _ = exporter.from_notebook_node(nbformat.from_dict(shown))
    body = body.replace("<th></th>", "<td></td>")  # an empty header is read out as one
    title = next((text for level, _, text in exporter.headings if level == 1), record["title"])
    contents = [heading for heading in exporter.headings if heading[0] in (2, 3)]
    return page(
        "chapter", title=title, contents=contents, body=Markup(body), record=record, book=book
    )


def page(template: str, **shown: Any) -> str:
    """A page made from a template; marks that reverse the reading order are made visible."""
    made = environment().get_template(f"{template}.html.j2").render(**shown)
    return re.sub("[\u202a-\u202e\u2066-\u2069]", "\ufffd", made)


def _refused(cell: nbformat.NotebookNode) -> bool:
    return any(o.output_type == "error" for o in cell.get("outputs", ()))


def warm_up(notebooks: Iterable[Path] = ()) -> None:
    """Makes what the first page in a process has to make, and the code of some notebooks' pages."""
    table = nbformat.v4.new_output(
        "display_data", {"text/html": "<table><tr><td>1</td></tr></table>"}
    )
    cells = [
        nbformat.v4.new_markdown_cell("# $N$\n\n**a** |b|"),
        nbformat.v4.new_code_cell("1", outputs=[table]),
    ]
    notebook = nbformat.v4.new_notebook(cells=cells)
    _exporter().from_notebook_node(notebook)
    environment().get_template("chapter.html.j2")
    for path in notebooks:
        with contextlib.suppress(Exception):  # damaged: its execution tells
            for cell in nbformat.read(path, as_version=4).cells:
                if cell.cell_type == "code":
                    _highlighted(cell.source)


_thread = threading.local()


def _exporter() -> _Exporter:
    """One exporter a thread: making one takes longer than a page, and it is not for sharing."""
    if not hasattr(_thread, "exporter"):
        _thread.exporter = _Exporter()
    return _thread.exporter


class _Exporter(HTMLExporter):
    """nbconvert's exporter with our template, which renders the page's body."""

    headings: list[tuple[int, str, Markup]] = []  # noqa: RUF012, one exporter a thread

    def __init__(self) -> None:
        super().__init__(
            template_name="body",
            extra_template_basedirs=[str(TEMPLATES)],
            default_preprocessors=[],  # each validates the notebook again, and none changes it here
        )

    def from_notebook_node(self, nb: nbformat.NotebookNode, **kwargs: Any) -> tuple[str, dict]:
        # Not HTMLExporter's own, which parses the page with its images and writes it anew, to add what
        # our template has: that takes longer than all the rest.
        self.register_filter("highlight_code", _highlighted)
        return TemplateExporter.from_notebook_node(self, nb, **kwargs)

    def _create_environment(self) -> jinja2.Environment:
        made = super()._create_environment()
        made.autoescape = True
        made.filters["own_markdown"] = lambda text: self._markdown(text, escape=False)
        made.filters["inert_markdown"] = lambda text: self._markdown(text, escape=True)
        made.filters["inert_html"] = inert_html
        made.filters["shown"] = _shown
        return made

    def _markdown(self, text: str, escape: bool) -> Markup:
        renderer = _Renderer(escape=escape, headings=self.headings)
        return Markup(MarkdownWithMath(renderer=renderer).render(text))


class _Renderer(IPythonRenderer):
    """Markdown → HTML with MathML, anchors on headings and no way out of the page."""

    def __init__(self, escape: bool, headings: list[tuple[int, str, Markup]]):
        super().__init__(escape=escape, exclude_anchor_links=True)
        self.headings = headings

    def heading(self, text: str, level: int, **_: Any) -> str:
        plain = html.unescape(re.sub(r"<math.*?</math>|<[^>]*>", "", text, flags=re.DOTALL))
        slug = re.sub(r"\W+", "-", plain.lower()).strip("-") or "section"
        taken = {anchor for _, anchor, _ in self.headings}
        anchor = next(a for n in range(1000) if (a := f"{slug}-{n}" if n else slug) not in taken)
        first = level == 1 and not any(known == 1 for known, _, _ in self.headings)
        self.headings.append((level, anchor, Markup(text)))
        # The first H1 is the page's title and stands in its head.
        return "" if first else f'<h{level} id="{html.escape(anchor)}">{text}</h{level}>\n'

    def text(self, text: str) -> str:
        return html.escape(html.unescape(text), quote=False)

    def link(self, text: str, url: str, title: str | None = None) -> str:
        if url.startswith("#"):
            return f'<a href="{html.escape(url)}">{text}</a>'
        return re.sub(r"^(?:https?|mailto)://?", "", text)

    def image(self, text: str, url: str, title: str | None = None) -> str:
        if self._escape:
            return html.escape(text)
        return super().image(text, url, title)

    def table(self, text: str) -> str:
        return f'<div class="scroll" tabindex="0"><table>\n{text}</table></div>\n'

    def block_math(self, body: str) -> str:
        return f'<div class="math" tabindex="0">{mathml(body, "block")}</div>\n'

    def inline_math(self, body: str) -> str:
        return mathml(body, "inline")

    def latex_environment(self, name: str, body: str) -> str:
        return self.block_math(f"\\begin{{{name}}}{body}\\end{{{name}}}")


def mathml(latex: str, display: str) -> str:
    """LaTeX → MathML; what cannot be converted is shown as it is written."""
    try:
        tree = Converter(display=display).convert_to_element(latex)
    except Exception:  # the converter raises whatever its parser stumbles over
        return f"<code>{html.escape(latex)}</code>"
    for element in tree.iter():
        # The converter keeps character references as text, and its own output does not escape.
        if element.tag == "mi" and re.fullmatch("&#x000[4-7].;", element.text or ""):
            element.set("mathvariant", "normal")  # an upright letter: a single one is set italic
        element.text = html.unescape(element.text or "")
        element.tail = html.unescape(element.tail or "")
        if (variant := element.get("mathvariant")) in ALPHABETS:
            # Browsers know no variant but normal.
            element.text = "".join(_styled(character, variant) for character in element.text)
            del element.attrib["mathvariant"]
        for name in set(element.attrib) - MATH_ATTRIBUTES:
            del element.attrib[name]
    for element in tree.iter():
        if element.tag in ("math", "mrow", "mtd", "mstyle"):
            _space_functions(element)
    return ElementTree.tostring(tree, encoding="unicode", short_empty_elements=False)


_highlighted = cache(Highlight2HTML(pygments_lexer="ipython3"))


@cache
def _styled(character: str, variant: str) -> str:
    """A letter or digit in an alphabet of mathematics, as it is where that has none."""
    if (character, variant) == ("h", "italic"):
        return "\N{PLANCK CONSTANT}"
    name = re.sub("LATIN |GREEK |LETTER |LUNATE ", "", unicodedata.name(character, ""))
    for alphabet in ALPHABETS[variant]:
        with contextlib.suppress(KeyError):
            return unicodedata.lookup(f"{alphabet} {name}")
    return character


def _space_functions(element: ElementTree.Element) -> None:
    """`ln 2` is set as `ln2` without a space of our own, which TeX puts after an operator's name."""
    following = list(element)[1:]
    for at, (child, after) in reversed(list(enumerate(zip(element, following, strict=False), 1))):
        if child.tag == "mi" and len(child.text or "") > 1 and after.tag != "mo":
            element.insert(at, ElementTree.Element("mspace", width="0.167em"))


def inert_html(text: str) -> Markup:
    """HTML with nothing left but tables and text."""
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL | re.IGNORECASE)
    return Markup(bleach.clean(text, tags=TAGS, attributes=ATTRIBUTES, strip=True))


def _shown(output: nbformat.NotebookNode) -> str:
    """Which form of an output a page shows; empty for none."""
    if output.output_type == "error":
        return "refusal" if output.ename == "Refusal" else ""
    if output.output_type == "stream":
        return "stdout" if output.name == "stdout" else ""
    data = output.data
    if output.metadata.get("sensorbook") == "caption" or any("widget" in key for key in data):
        return ""
    forms = ("image/png", "text/html", "text/markdown", "text/latex", "text/plain")
    form = next((form for form in forms if form in data), "")
    return "" if form == "text/plain" and MIME in data else form


def _day(moment: str) -> str:
    """`2026-05-12T…` → `12 May 2026`."""
    then = datetime.fromisoformat(moment)
    return f"{then.day} {then:%B %Y}"
