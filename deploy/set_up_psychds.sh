#!/bin/sh
# The official validator of Psych-DS for the tests, as the R package psychds bundles it: set_up_psychds.sh FOLDER. It is in
# no package registry, so that a computer without a way to its repository is left without it, and the tests say so.
set -eu
commit=248772d1938cd7bf5c2e72b9afa34cb01f162443
folder="$1"
[ "$(cat "$folder/commit" 2>/dev/null)" = "$commit" ] && exit 0
rm -rf "$folder"
if ! { git init -q "$folder" && git -C "$folder" fetch -q --depth 1 https://github.com/psych-ds/psychds-r "$commit" \
    && git -C "$folder" checkout -q FETCH_HEAD -- inst/shiny/www; } 2>"$folder.log"; then
    rm -rf "$folder"
    echo "  the validator of Psych-DS could not be fetched: $(tail -n 1 "$folder.log")" >&2
    exit 0
fi
echo "$commit" >"$folder/commit"
