"""How tests read pages and figures."""

import base64
import hashlib
import re
from html.parser import HTMLParser
from urllib.parse import unquote_to_bytes

from ehsa_ctrl.report.style import style

VOID = {"meta", "br", "wbr", "link", "img", "hr", "input"}
#: Attributes by which a page loads something.
LOADS = {"src", "srcset", "href", "xlink:href", "data", "action", "poster"}
#: All that a page of ours is made of.
TAGS = {
    "html", "head", "meta", "title", "style", "body", "main", "header", "section", "article", "h1", "h2", "h3", "h4",
    "h5", "p", "ul", "ol", "li", "dl", "dt", "dd", "a", "span", "small", "br", "wbr", "div", "table", "caption",
    "thead", "tbody", "tr", "th", "td", "figure", "figcaption", "img", "pre", "code", "strong",
    "details", "summary", "script",
}  # fmt: skip


class Page(HTMLParser):
    """Tags, ids, links and tables of a page; remembers what is not closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.wrong, self.tags, self.words = [], [], [], []
        self.tables, self.cell = [], None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("th", "td"):
            self.tables[-1][-1].append("")
            self.cell = tag

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append((tag, self.getpos()))
        if tag in ("th", "td"):
            self.cell = None

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.words.append(data)
        if self.cell:
            self.tables[-1][-1][-1] += data

    def with_tag(self, *names):
        return [attributes for tag, attributes in self.tags if tag in names]

    def table(self, *heads):
        """Rows of the first table whose head begins so."""
        return next(rows[1:] for rows in self.tables if tuple(rows[0][: len(heads)]) == heads)


def sound(text):
    """Fail unless a page is well formed and said in words, links lead somewhere in it, and it loads nothing."""
    page = Page(text)
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    targets = re.findall(r'(?:xlink:)?href="#([^"]+)"|url\(#([^)]+)\)', text)

    assert page.wrong == [] and page.open == []
    assert page.with_tag("html")[0]["lang"] == "en"
    assert any(attributes.get("name") == "viewport" for attributes in page.with_tag("meta"))
    assert len(ids) == len(set(ids))
    assert {one or other for one, other in targets} <= set(ids)
    assert all(attributes.get("scope") in ("col", "row") for attributes in page.with_tag("th"))
    assert len(page.with_tag("caption")) == len(page.with_tag("table"))
    assert all(len(row) == len(rows[0]) for rows in page.tables for row in rows)
    assert all(len(attributes["alt"]) > 60 for attributes in page.with_tag("img"))
    loads_nothing(text)


def loads_nothing(text):
    """Fail unless a page runs nothing and loads nothing from outside, and forbids it to itself.

    A figure is within the page, as an <img>; links lead within the page or to a file beside it.
    """
    page = Page(text)
    styles = re.findall(r"<style>(.*?)</style>", text, flags=re.DOTALL)
    # A data block is not run; it needs no hash, and must not end early.
    scripts = re.findall(r"<script>(.*?)</script>", text, flags=re.DOTALL)
    assert page.with_tag("script").count({"type": "application/json"}) == len(page.with_tag("script")) - len(scripts)
    runs, looks = (" ".join(map(_digest, found)) for found in (scripts, styles))
    policies = [meta["content"] for meta in page.with_tag("meta") if meta.get("http-equiv")]

    assert policies == [
        f"default-src 'none'; script-src {runs}; style-src {looks}; img-src data:; base-uri 'none'; form-action 'none'"
    ]
    assert text.index("Content-Security-Policy") < text.index("<style>")
    assert not any(word in style for style in styles for word in ("@import", "url("))
    for tag, attributes in page.tags:
        assert tag in TAGS, tag
        assert not {name for name in attributes if name.startswith("on") or name == "style"}, (tag, attributes)
        for name, value in attributes.items():
            if name in LOADS:
                wanted = r"data:image/(svg\+xml|png|webp)(;base64)?,.*" if tag == "img" else r"#.*|[\w./%~-]+"
                assert re.fullmatch(wanted, value), (tag, name, value[:80])


def _digest(text):
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def figures(text):
    """The files that the pictures of a page hold."""
    found = []
    for attributes in Page(text).with_tag("img"):
        head, content = attributes["src"].split(",", 1)
        found.append(base64.b64decode(content) if head.endswith("base64") else unquote_to_bytes(content))
    return found


def axes_of(figure, name):
    """The axes of a name in the figure's mosaic."""
    (found,) = [ax for ax in figure.axes if ax.get_label() == name]
    return found


def whole_and_detail(figure):
    """Panels of the whole log and of the detail, by the words of their signals."""
    sides = [[ax for ax in figure.axes if ax.get_label().endswith(f" {side}")] for side in ("whole", "detail")]
    names = [ax.get_ylabel().split("\n")[0] for ax in sides[0]]
    return tuple(dict(zip(names, side, strict=True)) for side in sides)


def words_are_apart(figure):
    """Fail unless all words lie on the sheet and none overlap."""
    with style():
        # Axis labels find their place when they are drawn.
        figure.draw_without_rendering()
        renderer = figure._get_renderer()
        boxes = [figure._suptitle.get_window_extent(renderer)]
        for ax in figure.axes:
            words = [ax.get_legend(), *ax.texts, ax.title, ax._left_title, ax._right_title]
            if ax.axison:
                low, high = sorted(ax.get_ylim())
                ticks = zip(ax.get_yticks(), ax.get_yticklabels(), strict=True)
                words += [ax.yaxis.label, ax.xaxis.label, *(label for at, label in ticks if low <= at <= high)]
                low, high = sorted(ax.get_xlim())
                level = [label for label in ax.get_xticklabels() if label.get_rotation() == 0]
                words += [label for label in level if low <= label.get_position()[0] <= high]
            boxes += [
                item.get_window_extent(renderer)
                for item in words
                if item is not None and item.get_visible() and (not hasattr(item, "get_text") or item.get_text())
            ]
    sheet = figure.bbox
    boxes = [box for box in boxes if box.width * box.height > 0]

    for box in boxes:
        assert box.x0 >= sheet.x0 - 1 and box.x1 <= sheet.x1 + 1, box
        assert box.y0 >= sheet.y0 - 1 and box.y1 <= sheet.y1 + 1, box
    # Two pixels at 100 dpi: a box has room for letters that its words don't have.
    for index, one in enumerate(boxes):
        for other in boxes[index + 1 :]:
            wide = min(one.x1, other.x1) - max(one.x0, other.x0)
            high = min(one.y1, other.y1) - max(one.y0, other.y0)
            assert not (wide > 2 and high > 2), (one, other)
