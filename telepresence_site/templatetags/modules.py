"""`{% modulepreload %}` and `{% modulepreload_later %}`: a browser fetches a page's modules at once
and not one after the other.
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
    """Return links for an entry and the modules that it imports, without those of the entry
    `beside`.
    """
    loaded = set(modules_of(beside)) if beside else set()
    return _links(name for name in modules_of(entry) if name not in loaded)


@register.simple_tag
def modulepreload_later(importer: str, beside: str) -> SafeString:
    """Return links for what a module imports dynamically, without the modules of the entry
    `beside`.
    """
    return _links(later_modules_of(importer, beside))


def _links(names: Iterable[str]) -> SafeString:
    # Low priority: the browser paints nothing without the style sheets.
    link = '<link rel="modulepreload" fetchpriority="low" href="{}">'
    return format_html_join("\n  ", link, ((static(name),) for name in names))
