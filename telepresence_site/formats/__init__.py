"""Formats of dates and times, in addition to Django's own for each language."""
