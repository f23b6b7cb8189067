"""`{% modulepreload %}` and `{% modulepreload_later %}`: have a browser fetch a page's modules at
once and not one after the other.
"""

from collections.abc import Iterable

from django import template
from django.templatetags.static import static
from django.utils.html import format_html_join
from django.utils.safestring import SafeString

from telepresence_site.web.module_graph import later_modules_of, modules_of

register = template.Library()


@register.simple_tag
def modulepreload(entry: str, beside: str = "") -> SafeString:
    """Return a link for an entry and for each module that it imports, but for those that the page
    has by another entry, `beside`.
    """
    there = set(modules_of(beside)) if beside else set()
    return _links(name for name in modules_of(entry) if name not in there)


@register.simple_tag
def modulepreload_later(importer: str, beside: str) -> SafeString:
    """Return a link for each module that a module imports while it runs, and for what these need,
    but for those that the page has by an entry, `beside`.
    """
    return _links(later_modules_of(importer, beside))


def _links(names: Iterable[str]) -> SafeString:
    # Style sheets go first: nothing is painted without them.
    link = '<link rel="modulepreload" fetchpriority="low" href="{}">'
    return format_html_join("\n  ", link, ((static(name),) for name in names))
