#!/bin/sh
# Brings the texts of code and templates into the Spanish catalogue, and compiles it: messages.sh PYTHON. Needs gettext.
set -eu
catalogue=locale/es/LC_MESSAGES/django.po
"$1" manage.py makemessages -l es --no-obsolete --no-wrap --add-location=file -i .venv -i var -i tests -i node_modules
# Some versions of gettext wrap the lines that name files: joined, they look the same whoever ran this.
awk '/^#: / { files = files (files ? " " : "#: ") substr($0, 4); next } files { print files; files = "" } { print }' \
    "$catalogue" >"$catalogue.joined"
mv "$catalogue.joined" "$catalogue"
"$1" manage.py compilemessages -l es -i .venv -i node_modules
if grep -n "^#, fuzzy" "$catalogue"; then
    echo "Gettext has guessed these translations: correct each, and delete its '#, fuzzy' and '#|' lines." >&2
fi
