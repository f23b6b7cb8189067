"""The reference of the file formats of studies and questionnaires as pages of the site, rendered
from docs/reference/<name>.md.

Only the Markdown of these files is supported, which a test checks: headings, paragraphs, tables and
code blocks; code, emphasis and links in a line.
"""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.urls import reverse
from django.utils.html import escape
from django.utils.safestring import SafeString, mark_safe
from django.views.decorators.http import require_safe

FOLDER = Path(settings.BASE_DIR) / "docs" / "reference"
PAGES = ("studies", "questionnaires")
_INLINE = re.compile(
    r"`(?P<code>[^`]+)`|\[(?P<text>[^\]]+)\]\((?P<to>[^)]+)\)|\*\*(?P<strong>[^*]+)\*\*"
    r"|\*(?P<em>[^*\s][^*]*)\*"
)
_HEADING = re.compile(r"(#{1,4}) (.+)")


@require_safe
def reference(request: HttpRequest, name: str) -> HttpResponse:
    if name not in PAGES:
        raise Http404
    title, html = page_of(name)
    return render(request, "site/reference.html", {"title": title, "html": html})


@cache
def page_of(name: str) -> tuple[str, SafeString]:
    """Return the title and HTML of a page."""
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    found = _HEADING.match(text)
    html = "\n".join(_blocks(text))
    return found[2] if found else name, mark_safe(html)  # noqa: S308 -- all text is escaped


def _blocks(text: str) -> Iterator[str]:
    """Yield the HTML of each block; blank lines separate them, but not within code."""
    for n, part in enumerate(re.split(r"^```.*\n", text, flags=re.MULTILINE)):
        if n % 2:
            yield f"<pre><code>{escape(part)}</code></pre>"
        else:
            yield from (_block(block) for block in re.split(r"\n\s*\n", part.strip()) if block)


def _block(block: str) -> str:
    if found := _HEADING.fullmatch(block):
        level = len(found[1])
        return f"<h{level}>{_inline(found[2])}</h{level}>"
    if block.startswith("|"):
        return _table(block.splitlines())
    return f"<p>{_inline(' '.join(block.splitlines()))}</p>"


def _table(lines: list[str]) -> str:
    head, _rule, *rows = (_cells(line) for line in lines)
    top = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return (
        '<div class="prose__table" tabindex="0" role="region">'
        f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _cells(line: str) -> list[str]:
    """Return the cells of a row; a bar within code does not separate cells."""
    whole = re.sub(r"`[^`]*`", lambda found: found[0].replace("|", "\0"), line.strip())
    return [_inline(cell.replace("\0", "|").strip()) for cell in whole.strip("|").split("|")]


def _inline(text: str) -> str:
    html, at = [], 0
    for found in _INLINE.finditer(text):
        html += [escape(text[at : found.start()]), _marked(found)]
        at = found.end()
    return "".join((*html, escape(text[at:])))


def _marked(found: re.Match[str]) -> str:
    if found["code"]:
        return f"<code>{escape(found['code'])}</code>"
    if found["text"]:
        page = found["to"].removesuffix(".md")
        inner = _inline(found["text"])
        if page not in PAGES:  # a document that the site does not show
            return inner
        return f'<a href="{reverse("reference", args=[page])}">{inner}</a>'
    tag = "strong" if found["strong"] else "em"
    return f"<{tag}>{_inline(found[tag])}</{tag}>"
