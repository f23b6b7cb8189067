"""Words of the study builder for its templates."""

from typing import Any

from django import template

from experiments.builder import labels

register = template.Library()


@register.filter
def label(key: str) -> Any:
    """Return what a field is called."""
    return labels.label(key)


@register.filter
def hint(key: str) -> Any:
    """Return what is said below a field."""
    return labels.hint(key)


@register.filter
def word(value: str, key: str) -> Any:
    """Return what a choice of a field is called."""
    return labels.word(key, value)


@register.filter
def item(key: str) -> Any:
    """Return what one part of a list is called."""
    return labels.ITEMS.get(key, labels.label(key))
