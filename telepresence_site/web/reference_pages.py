"""The reference of the file formats as pages of the site, for those who write a study or a
questionnaire: docs/reference/<name>.md, rendered.

Our own pages use little of Markdown: headings, paragraphs, tables, blocks of code; in a line code,
emphasis and links. That is all that is read here, and a test holds the pages to it.
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
    """Return the title of a page of the reference, and its HTML."""
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    found = _HEADING.match(text)
    html = "\n".join(_blocks(text))
    # every text of the file was escaped
    return found[2] if found else name, mark_safe(html)  # noqa: S308 -- as said


def _blocks(text: str) -> Iterator[str]:
    """Yield the HTML of each block: blank lines divide them, but for those within code."""
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
    """Return the cells of a row; a bar within code is part of it."""
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
        # what is no page of the site stands in the project's own folder of documents
        if page not in PAGES:
            return inner
        return f'<a href="{reverse("reference", args=[page])}">{inner}</a>'
    tag = "strong" if found["strong"] else "em"
    return f"<{tag}>{_inline(found[tag])}</{tag}>"
