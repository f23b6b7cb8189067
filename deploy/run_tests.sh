#!/bin/sh
# What is checked before a change lands: run_tests.sh format|lint|check|integration|test|nightly|soak. BIN names the virtual environment's bin folder.
#   format        write Python and JavaScript as lint wants them
#   lint          style, types, and the direction of imports
#   check         lint and the unit lane, for every change: without slow tests, and with fewer examples
#   integration   the integration lane and the timing lane: what make test runs after check
#   test          everything that proves function
#   nightly       whole stories, and the same faults at every part and architecture
#   soak          the unit lane with many more examples, and everything that proves endurance, before a release
set -eu
started=${RUN_STARTED:-$(date +%s)}
logs=${LOGS:-$(mktemp -d)}
lanes=""
formatted="static/js tests/js eslint.config.js"
# A run that is ended early ends its lanes, with the servers and browsers of their tests, and shows how far they had come.
finish() {
    trap '' INT TERM
    for lane in $lanes; do kill -INT "-$lane" 2>/dev/null || true; done
    wait
    for log in "$logs"/*.running; do
        [ ! -f "$log" ] || { printf '\n-- %s, not finished\n' "$(basename "$log")"; tail -n 60 "$log"; }
    done
    rm -rf "$logs"
}
[ "${1:-}" = lane ] || trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
step() { printf '\n== %s (%s s)\n' "$1" "$(($(date +%s) - started))"; }

# Nobody's process compiles the same files at every start.
unset PYTHONDONTWRITEBYTECODE
cores=$(getconf _NPROCESSORS_ONLN)
# A run that hangs is interrupted after so many minutes, so that it says what it had found.
limit=75
# 5 says that the arguments chose no test: with -k, or where nothing is marked so.
pytest() {
    left=$((limit * 60 - $(date +%s) + started))
    timeout --foreground --signal INT --kill-after 60 "$((left > 60 ? left : 60))" \
        "$BIN/python" -m pytest -q --durations 10 --durations-min 1 "$@" ${PYTEST_ARGS:-} && return
    code=$?
    [ "$code" -eq 124 ] && echo "ended: the run has taken longer than $limit minutes"
    [ "$code" -eq 5 ]
}
side_by_side() { pytest --dist loadfile --no-loadscope-reorder -n "$@"; }
unit() {
    if [ "$1" = quick ]; then set -- -m "not slow" --hypothesis-profile=quick; else set --; fi
    side_by_side logical "$@" tests/unit
}
scripts() {
    node --test --test-reporter=dot tests/js/
}
# These wait for robots and servers most of their time.
servers() {
    side_by_side "$((cores * 3 / 2))" -m "$1" tests/integration --ignore tests/integration/browser \
        --ignore tests/integration/accounts --ignore tests/integration/experiments --ignore tests/integration/surveys
}
# A browser that shows live video and the robot that sends it take a core of their own.
browsers() {
    side_by_side "$((cores / 2 > 1 ? cores / 2 : 1))" -m "$1" tests/integration/browser
}
studies() {
    side_by_side "$cores" -m "$1" tests/integration/accounts tests/integration/experiments tests/integration/surveys
}
# Studies compute all the time, while the others wait for a robot or a picture: beside these they have what those leave. Linux
# shares its time among sessions (sched_autogroup) before it asks how nice a process is.
give_way() {
    renice -n 5 $$ >/dev/null
    [ ! -w /proc/$$/autogroup ] || echo 5 >/proc/$$/autogroup
}
# Of these, what waits for other programs has room for three others beside it, and a browser has not.
timing() {
    side_by_side 4 --dist worksteal -m "$1" tests/timing/robots
    pytest -m "$1" tests/timing/browser
}

format() {
    "$BIN/ruff" format .
    node_modules/.bin/prettier --log-level warn --write $formatted
}

lint() {
    step "ruff"
    "$BIN/ruff" check .
    "$BIN/ruff" format --check .
    step "eslint"
    node_modules/.bin/eslint .
    step "prettier"
    node_modules/.bin/prettier --cache --log-level warn --check $formatted
    step "import-linter"
    "$BIN/lint-imports" --no-cache
    step "mypy"
    "$BIN/mypy"
}
# What hardly any change breaks, and takes as long as the types of all code.
other_platforms() {
    step "mypy: the agent as Windows and the newest Python would have it"
    "$BIN/mypy" --platform win32 --python-version 3.13 robots/api robots/agent
}

# together NAME FUNCTION ARGUMENT [FUNCTION ARGUMENT …]: run them side by side, each in a process group of its own, then show
# what each said. Fails when one did.
together() {
    step "$1"
    shift
    waited=""
    while [ $# -gt 0 ]; do
        # What a shell starts in the background ignores an interrupt unless told otherwise.
        RUN_STARTED=$started LOGS=$logs env --default-signal=INT setsid sh "$0" lane "$1" "$2" >"$logs/$1.running" 2>&1 &
        waited="$waited $1:$!"
        lanes="$lanes $!"
        shift 2
    done
    failed=""
    for one in $waited; do
        wait "${one#*:}" || failed="$failed ${one%%:*}"
        printf '\n-- %s (%s s)\n' "${one%%:*}" "$(($(date +%s) - started))"
        mv "$logs/${one%%:*}.running" "$logs/shown"
        cat "$logs/shown"
    done
    lanes=""
    [ -z "$failed" ] || { echo "failed:$failed" >&2; exit 1; }
}

integration() {
    together "integration" servers "$1" browsers "$1" studies "$1"
    step "timing: beside no other lane"
    timing "$1"
}

case "${1:-test}" in
    lane)
        [ "$2" != studies ] || give_way
        "$2" "$3"
        exit
        ;;
    format) format ;;
    lint)
        lint
        other_platforms
        ;;
    check)
        together "style, types and the unit lane" lint "" unit quick
        ;;
    test)
        together "style, types and the unit lane" lint "" scripts "" unit ""
        integration "not nightly and not soak"
        ;;
    integration) integration "not nightly and not soak" ;;
    nightly)
        other_platforms
        integration "nightly and not soak"
        ;;
    soak)
        step "soak: this takes hours, and prints what each part took"
        limit=$((36 * 60))
        export PYTEST_ARGS="--timeout 0 ${PYTEST_ARGS:-}"
        side_by_side logical --hypothesis-profile=search tests/unit
        servers soak
        browsers soak
        studies soak
        timing soak
        ;;
esac
step "done"
