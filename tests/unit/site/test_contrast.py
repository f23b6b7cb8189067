"""The colours of static/css/_global.css against WCAG 2.2 AA."""

import re

import pytest

from tests.support.paths import ROOT

SHEET = (ROOT / "static" / "css" / "_global.css").read_text()
COLOUR = re.compile(r"(--[\w-]+): (?:light-dark\()?(#[0-9a-f]{6})(?:, (#[0-9a-f]{6})\))?;")
TEXT = {
    "ink": ("paper", "surface", "sunken", "brand-soft", "ok-soft", "busy-soft", "danger-soft"),
    "ink-2": ("paper", "surface", "sunken"),
    "brand": ("paper", "surface", "sunken", "brand-soft"),
    "brand-hover": ("paper", "surface", "sunken"),
    "on-brand": ("brand", "brand-hover"),
    "on-action": ("action", "action-hover"),
    "on-stop": ("stop", "stop-hover"),
    "ok": ("ok-soft", "surface", "paper"),
    "busy": ("busy-soft", "surface", "paper"),
    "off": ("off-soft", "surface", "paper"),
    "danger": ("danger-soft", "surface", "paper"),
}
GRAPHICS = {
    "line-strong": ("paper", "surface", "sunken"),
    "focus": ("paper", "surface", "sunken", "brand-soft"),
    "path": ("paper", "surface", "sunken"),
    "stop": ("paper", "surface"),
}
PAIRS = [(front, back, 4.5) for front, backs in TEXT.items() for back in backs]
PAIRS += [(front, back, 3.0) for front, backs in GRAPHICS.items() for back in backs]

LIGHT = {name: light for name, light, _dark in COLOUR.findall(SHEET)}
DARK = {name: dark or light for name, light, dark in COLOUR.findall(SHEET)}


def luminance(colour: str) -> float:
    """WCAG 2.2, relative luminance."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    r, g, b = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def test_black_on_white_is_21_to_1():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize(("front", "back", "least"), PAIRS, ids=str)
def test_adjacent_colours_have_enough_contrast(theme, front, back, least):
    assert contrast(theme[f"--{front}"], theme[f"--{back}"]) >= least
