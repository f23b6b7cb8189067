"""`{% icon "eye" %}`: an icon of templates/components/icons.svg, drawn in lines on 24 by 24 units.

It becomes a part of the page, since style sheets do not reach into `<use>`.
"""

import re
from functools import cache

from django import template
from django.conf import settings
from django.utils.html import format_html
from django.utils.safestring import SafeString, mark_safe

register = template.Library()


@register.simple_tag
def icon(name: str, css_class: str = "reading__icon") -> SafeString:
    svg = '<svg class="{}" viewBox="0 0 24 24" aria-hidden="true">{}</svg>'
    return format_html(svg, css_class, mark_safe(_icons()[name]))  # noqa: S308 -- a file of ours


@cache
def _icons() -> dict[str, str]:
    text = (settings.BASE_DIR / "templates" / "components" / "icons.svg").read_text()
    return dict(re.findall(r'<symbol id="(\w+)">(.*)</symbol>', text))
