"""The reference of the file formats of studies and questionnaires as pages of the site, rendered
from docs/reference/<name>.md.
"""

from functools import cache
from pathlib import Path

from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.urls import reverse
from django.utils.safestring import SafeString, mark_safe
from django.views.decorators.http import require_safe

FOLDER = Path(settings.BASE_DIR) / "docs" / "reference"
PAGES = ("studies", "questionnaires")


@require_safe
def reference(request: HttpRequest, name: str) -> HttpResponse:
    if name not in PAGES:
        raise Http404
    title, html = page_of(name)
    return render(request, "site/reference.html", {"title": title, "html": html})


@cache
def page_of(name: str) -> tuple[str, SafeString]:
    """Return the title and HTML of a page."""
    import mistune  # noqa: PLC0415 -- robots' computers lack it

    class Renderer(mistune.HTMLRenderer):
        def link(self, text: str, url: str, title: str | None = None) -> str:
            page = url.removesuffix(".md")
            if page not in PAGES:  # a document that the site does not show
                return text
            return super().link(text, reverse("reference", args=[page]), title)

        def table(self, text: str) -> str:
            attributes = 'class="prose__table" tabindex="0" role="region"'
            return f"<div {attributes}><table>{text}</table></div>"

        def table_cell(self, text: str, align: str | None = None, head: bool = False) -> str:
            return f'<th scope="col">{text}</th>' if head else f"<td>{text}</td>"

    markdown = mistune.create_markdown(renderer=Renderer(), plugins=["table"])
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    title = text.partition("\n")[0].removeprefix("# ")
    return title, mark_safe(markdown(text))  # noqa: S308 -- Renderer escapes HTML
