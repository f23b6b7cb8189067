"""HTML texts of other survey systems as plain text. Paragraphs, list entries and table rows become
lines; tags that cannot be shown as text, such as a picture, are returned for the report.
"""

import re
from dataclasses import dataclass
from html.parser import HTMLParser

_LINES = {
    *("address", "article", "aside", "blockquote", "br", "center", "dd", "div", "dl", "dt"),
    *("fieldset", "figure", "footer", "form", "h1", "h2", "h3", "h4", "h5", "h6", "header", "hr"),
    *("li", "main", "ol", "p", "pre", "section", "table", "tr", "ul"),
}
_UNSEEN = frozenset({"script", "style", "template", "title", "head", "noscript"})
_MEDIA = {
    *("audio", "canvas", "embed", "iframe", "img", "input", "object", "select", "svg"),
    *("textarea", "video"),
}
_BEFORE = {"td": " ", "th": " ", "li": "- "}
# Placeholders of earlier answers and other values: ${q://QID1/…} and ${e://Field/…} of Qualtrics,
# {code.shown} and {TOKEN:FIRSTNAME} of LimeSurvey, [field] of REDCap.
PIPED = {
    "qualtrics": re.compile(r"\$\{[a-z]+://[^}]*\}"),
    "limesurvey": re.compile(r"\{[A-Za-z][^{}\s][^{}]*\}"),
    "redcap": re.compile(r"\[[a-z][a-z0-9_:-]*\](?:\[[a-z0-9_:-]+\])*"),
}

_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)


@dataclass(frozen=True)
class PlainText:
    """A text without markup, and the tags of what it cannot show, sorted."""

    text: str
    lost: tuple[str, ...] = ()


class _TextParser(HTMLParser):
    def __init__(self, *, keeps_lines: bool) -> None:
        super().__init__(convert_charrefs=True)
        self.parts: list[str] = []
        self.lost: set[str] = set()
        self._keeps_lines = keeps_lines
        self._unseen = 0
        self._address = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._unseen += tag in _UNSEEN
        if tag in _MEDIA or tag == "script":
            self.lost.add(tag)
        if tag in _MEDIA:
            self.parts.append(dict(attrs).get("alt") or "")
        self.parts.append("\n" * (tag in _LINES) + _BEFORE.get(tag, ""))
        if tag == "a":
            self._address = dict(attrs).get("href") or ""

    def handle_endtag(self, tag: str) -> None:
        if tag in _UNSEEN:
            self._unseen = max(self._unseen - 1, 0)
        if tag in _LINES:
            self.parts.append("\n")
        if tag == "a" and self._address.startswith(("http://", "https://", "mailto:")):
            if self._address not in "".join(self.parts[-1:]):
                self.parts.append(f" ({self._address})")
            self._address = ""

    def handle_data(self, data: str) -> None:
        if not self._unseen:
            self.parts.append(data if self._keeps_lines else re.sub(r"\s+", " ", data))


def plain(html: str, *, keeps_lines: bool = False) -> PlainText:
    """Return a text without markup; unless `keeps_lines`, its line breaks become spaces."""
    if "<" not in html and "&" not in html:
        text = html if keeps_lines else re.sub(r"\s+", " ", html)
        return PlainText(_tidy(text))
    reader = _TextParser(keeps_lines=keeps_lines)
    try:
        reader.feed(_closed(html))
        reader.close()
    except AssertionError:
        # html.parser raises it for marked sections that it does not know, "<![x[".
        return PlainText(_tidy(re.sub(r"<[^>]*>", " ", html)))
    return PlainText(_tidy("".join(reader.parts)), tuple(sorted(reader.lost)))


def _closed(html: str) -> str:
    """Return markup without comments, and with every "<" after the last ">" as a character:
    html.parser searches to the end of the text for the end of each that is not closed.
    """
    marked, end, rest = _COMMENT.sub(" ", html).rpartition(">")
    return f"{marked}{end}{rest.replace('<', '&lt;')}"


def _tidy(text: str) -> str:
    """Return a text without empty lines, outer blanks, and control characters (for PostgreSQL)."""
    lines = (re.sub(r"[\s\x00-\x1f\u00a0]+", " ", line).strip() for line in text.splitlines())
    return "\n".join(line for line in lines if line not in {"", "-"})
