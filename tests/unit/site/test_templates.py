"""Templates have no inline code or styles and no text that gettext misses; the Spanish catalogue is
complete.
"""

import ast
import gettext
import re
from functools import cache
from pathlib import Path

import pytest

from tests.support.paths import ROOT

TEMPLATES = sorted((ROOT / "templates").rglob("*.html"))
CATALOGUE = ROOT / "locale" / "es" / "LC_MESSAGES"

TAG = re.compile(r"\{%.*?%\}|\{\{.*?\}\}|\{#.*?#\}", re.DOTALL)


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


@cache
def po_entries() -> tuple[dict[str, str], ...]:
    """Return the entries of the Spanish catalogue: keywords to text, `flags` to the flag line."""
    entries = []
    for block in (CATALOGUE / "django.po").read_text().split("\n\n"):
        entry: dict[str, str] = {"flags": ""}
        key = ""
        for line in block.splitlines():
            if line.startswith("#,"):
                entry["flags"] = line
            elif match := re.match(r'(msg\w+(?:\[\d\])?) "(.*)"$', line):
                key = match[1]
                entry[key] = ast.literal_eval(f'"{match[2]}"')
            elif line.startswith('"'):
                entry[key] += ast.literal_eval(line)
        if entry.get("msgid"):
            entries.append(entry)
    return tuple(entries)


@pytest.mark.parametrize("path", TEMPLATES, ids=name)
def test_no_template_has_inline_code_or_styles(path):
    text = path.read_text()
    assert not re.search(r"<[^>]*\son\w+\s*=", TAG.sub("", text)), "an inline handler"
    assert not re.search(r"<[^>]*\sstyle\s*=", TAG.sub("", text)), "an inline style"
    assert "javascript:" not in text
    assert "<style" not in text
    for script in re.findall(r"<script\b([^>]*)>", TAG.sub("x", text)):
        assert "src=" in script, "an inline script"


@pytest.mark.parametrize("path", TEMPLATES, ids=name)
def test_every_word_of_a_template_can_be_translated(path):
    bare = re.sub(
        r"\{%\s*blocktranslate.*?endblocktranslate\s*%\}", "", path.read_text(), flags=re.DOTALL
    )
    bare = re.sub(
        r"<(script|code|pre)\b.*?</\1>|<!--.*?-->|\{\w+\}", "", TAG.sub("", bare), flags=re.DOTALL
    )
    words = [text for text in re.findall(r">([^<]+)<", bare) if re.search(r"[A-Za-z]{2}", text)]
    attributes = [
        value
        for value in re.findall(r"\b(?:alt|title|aria-label|placeholder)=\"([^\"]*)\"", bare)
        if re.search(r"[A-Za-z]{2}", value)
    ]
    assert not words + attributes


def test_the_spanish_catalogue_has_no_gap_and_no_guess():
    entries = po_entries()
    assert len(entries) > 200
    for entry in entries:
        assert "fuzzy" not in entry["flags"], entry["msgid"]
        assert all(text for key, text in entry.items() if key.startswith("msgstr")), entry["msgid"]


def test_the_compiled_catalogue_is_the_written_one():
    with (CATALOGUE / "django.mo").open("rb") as file:
        known = gettext.GNUTranslations(file)._catalog
    for entry in po_entries():
        single = entry.get("msgstr", entry.get("msgstr[0]"))
        key = f"{entry['msgctxt']}\x04{entry['msgid']}" if "msgctxt" in entry else entry["msgid"]
        assert known.get(key, known.get((key, 0))) == single


def test_a_translation_names_the_same_values_as_its_original():
    placeholder = re.compile(r"%\(\w+\)[sd]|%%|\{\w*\}")
    for entry in po_entries():
        for key, text in entry.items():
            if key.startswith("msgstr"):
                original = entry["msgid_plural" if key in {"msgstr[1]", "msgstr[2]"} else "msgid"]
                assert sorted(placeholder.findall(text)) == sorted(placeholder.findall(original)), (
                    original
                )
