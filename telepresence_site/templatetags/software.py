"""`{% version %}`: the version of the site."""

from django import template

from telepresence import __version__

register = template.Library()


@register.simple_tag
def version() -> str:
    return __version__
