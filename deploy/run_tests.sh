#!/bin/sh
# Everything that is checked before a change lands: run_tests.sh [lint]. BIN names the virtual environment's bin folder.
set -eu
started=$(date +%s)
step() { printf '\n== %s (%s s)\n' "$1" "$(($(date +%s) - started))"; }
step "ruff"
"$BIN/ruff" check .
"$BIN/ruff" format --check .
step "mypy"
"$BIN/mypy"
step "mypy: the agent as Windows and the newest Python would have it"
"$BIN/mypy" --platform win32 --python-version 3.13 robots/api robots/agent
step "import-linter"
"$BIN/lint-imports" --no-cache
step "eslint"
node_modules/.bin/eslint .
[ "${1:-}" = lint ] && exit 0
step "node --test"
node --test --test-reporter=dot tests/js/
step "pytest: what computes, on every core"
"$BIN/python" -m pytest -q -n logical --dist loadfile --no-loadscope-reorder -m "not alone" ${PYTEST_ARGS:-}
step "pytest: what needs the computer for itself"
"$BIN/python" -m pytest -q -m alone ${PYTEST_ARGS:-}
step "done"
