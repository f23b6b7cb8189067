#!/bin/sh
# Brings the texts of code and templates into the Spanish catalogue, and compiles it: messages.sh PYTHON. Needs gettext.
set -eu
catalogue=locale/es/LC_MESSAGES/django.po
# Gettext does not read tables: the texts of each (surveys/document_forms/guide.py, word_table) are in a module beside it meanwhile.
trap 'find experiments surveys -name "*.csv.py" -delete' EXIT
"$1" - <<'MODULES'
import csv
from pathlib import Path

for table in [*Path("experiments").rglob("*.csv"), *Path("surveys").rglob("*.csv")]:
    with table.open(encoding="utf-8", newline="") as file:
        cells = [cell for row in csv.DictReader(file) for cell in row.items()]
    texts = [text for column, text in cells if column in {"words", "label", "item", "hint"} and text]
    if texts:
        table.with_suffix(".csv.py").write_text("".join(f"_({text!r})\n" for text in texts), encoding="utf-8")
MODULES
"$1" manage.py makemessages -l es --no-obsolete --no-wrap --add-location=file -i .venv -i var -i tests -i node_modules
# Some versions of gettext wrap the lines that name files: joined, they look the same whoever ran this.
awk '/^#: / { gsub(/\.csv\.py/, ".csv"); files = files (files ? " " : "#: ") substr($0, 4); next } files { print files; files = "" } { print }' \
    "$catalogue" >"$catalogue.joined"
mv "$catalogue.joined" "$catalogue"
"$1" manage.py compilemessages -l es -i .venv -i node_modules
if grep -n "^#, fuzzy" "$catalogue"; then
    echo "Gettext has guessed these translations: correct each, and delete its '#, fuzzy' and '#|' lines." >&2
fi
