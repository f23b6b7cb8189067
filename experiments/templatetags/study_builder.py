"""Words of the study builder for its templates."""

from typing import Any

from django import template

from experiments import builder_words

register = template.Library()


@register.filter
def label(key: str) -> Any:
    """Return what a field is called."""
    return builder_words.label(key)


@register.filter
def hint(key: str) -> Any:
    """Return what is said below a field."""
    return builder_words.hint(key)


@register.filter
def word(value: str, key: str) -> Any:
    """Return what a choice of a field is called."""
    return builder_words.word(key, value)


@register.filter
def item(key: str) -> Any:
    """Return what one part of a list is called."""
    return builder_words.ITEMS.get(key, builder_words.label(key))
