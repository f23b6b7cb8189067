#!/bin/sh
# What is checked before a change lands: run_tests.sh format|lint|check|test|nightly|soak. BIN names the virtual environment's bin folder.
#   format        write Python and JavaScript as lint wants them
#   lint          style, types, also as Windows and the newest Python would have them, and the direction of imports
#   check         for every change: lint for this computer, and the unit lane without slow tests and with fewer examples
#   test          everything that proves function: lint for this computer, scripts, the unit, integration and timing lanes
#   nightly       whole stories, the same faults at every part and architecture, and types as elsewhere
#   soak          the unit lane with many more examples, and everything that proves endurance, before a release
set -eu
# Each lane is a process of its own: run_tests.sh lane STARTED LIMIT LOGS FUNCTION ARGUMENT.
if [ "${1:-}" = lane ]; then
    started=$2 limit=$3 logs=$4
else
    # A run that hangs is interrupted after so many minutes, so that it says what it had found.
    started=$(date +%s) limit=75 logs=$(mktemp -d)
fi
lanes=""
failed=""
formatted="static/js !static/js/protocol/messages.* tests/js eslint.config.js"
# A run that is ended early ends its lanes, with the servers and browsers of their tests, and shows how far they had come.
finish() {
    trap '' INT TERM HUP PIPE
    for lane in $lanes; do kill -INT "-$lane" 2>/dev/null || true; done
    wait
    show_unfinished || true
    rm -rf "$logs"
}
show_unfinished() {
    for log in "$logs"/*.running; do
        [ ! -f "$log" ] || { printf '\n-- %s, not finished\n' "$(basename "$log" .running)"; cat "$log"; }
    done
}
if [ "${1:-}" != lane ]; then
    trap finish EXIT
    trap 'exit 129' HUP
    trap 'exit 141' PIPE
fi
trap 'exit 130' INT
trap 'exit 143' TERM
step() { printf '\n== %s (%s s)\n' "$1" "$(($(date +%s) - started))"; }

# Nobody's process compiles the same files at every start, and the settings of somebody's site are not those of the tests'.
unset PYTHONDONTWRITEBYTECODE $(sed -n 's/^| \(`[^|]*`\) |.*/\1/p' docs/reference/settings.md | tr -d '`,')
cores=$(getconf _NPROCESSORS_ONLN)
pytest() {
    left=$((limit * 60 - $(date +%s) + started))
    code=0
    timeout --foreground --signal INT --kill-after 60 "$((left > 60 ? left : 60))" \
        "$BIN/python" -m pytest -q --durations 10 --durations-min 1 "$@" ${PYTEST_ARGS:-} || code=$?
    case "$code" in
        5) may_be_empty "$@" && return ;; # 5 says that no test was chosen
        124 | 137) echo "ended: the run has taken longer than $limit minutes" ;;
    esac
    : >"$logs/tested"
    return "$code"
}
# One part of a run may have no test that is marked so, or that somebody's PYTEST_ARGS ask for. All together may not.
may_be_empty() {
    case "${PYTEST_ARGS:+chosen} $*" in
        chosen* | *"-m nightly"* | *"-m soak"*) true ;;
        *) false ;;
    esac
}
side_by_side() { pytest --dist loadfile --no-loadscope-reorder -n "$@"; }
unit() {
    case "$1" in
        quick) side_by_side logical -m "not slow and not soak" --hypothesis-profile=quick tests/unit ;;
        thorough) side_by_side logical --hypothesis-profile=search tests/unit ;;
        *) side_by_side logical -m "not soak" tests/unit ;;
    esac
}
scripts() {
    node --test --test-reporter=dot $(find tests/js -name '*.test.js')
}
servers() {
    side_by_side "$cores" -m "$1" tests/integration --ignore tests/integration/browser --ignore "$adapters" \
        --ignore tests/integration/accounts --ignore tests/integration/experiments --ignore tests/integration/surveys
}
# These wait for robots that move in real time for five sixths of their time.
adapters=tests/integration/robots/agent/adapters
architectures() {
    side_by_side "$cores" -m "$1" "$adapters"
}
# A browser that shows live video and the robot that sends it take a core of their own.
browsers() {
    side_by_side "$((cores / 2 > 1 ? cores / 2 : 1))" -m "$1" tests/integration/browser/drive_page tests/integration/browser/visits
}
pages() {
    side_by_side "$((cores / 2 > 1 ? cores / 2 : 1))" -m "$1" tests/integration/browser/pages tests/integration/browser/studies
}
studies() {
    side_by_side "$cores" -m "$1" tests/integration/accounts tests/integration/experiments tests/integration/surveys
}
# Studies compute all the time, while the others wait for a robot or a picture: beside these they have what those leave. Linux
# shares its time among sessions (sched_autogroup) before it asks how nice a process is.
give_way() {
    [ "$(nice)" -ge 5 ] || renice -n 5 $$ >/dev/null
    [ ! -w /proc/$$/autogroup ] || echo 5 >/proc/$$/autogroup 2>/dev/null || true
}
# These wait for other programs more than half of their time.
timing_of_robots() {
    side_by_side 4 --dist worksteal -m "$1" tests/timing/robots
}
timing_of_browsers() {
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
    step "tsc"
    node_modules/.bin/tsc -p jsconfig.json --incremental --tsBuildInfoFile node_modules/.cache/tsc.json
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

# begin FUNCTION ARGUMENT: run it in a process group of its own. What a shell starts in the background ignores an interrupt
# unless told otherwise.
begin() {
    env --default-signal=INT setsid sh "$0" lane "$started" "$limit" "$logs" "$1" "$2" &
    lanes="$lanes $!"
}
# alone FUNCTION ARGUMENT: run it beside nothing else, and show what it says at once.
alone() {
    step "$(echo "$1" | tr _ ' ')"
    begin "$1" "$2"
    wait "$!" || failed="$failed $1"
    lanes=""
}
# together NAME FUNCTION ARGUMENT [FUNCTION ARGUMENT …]: run them side by side, and show what each has said when it ends.
together() {
    step "$1"
    shift
    left=""
    while [ $# -gt 0 ]; do
        begin "$1" "$2" >"$logs/$1.running" 2>&1
        left="$left $1:$!"
        shift 2
    done
    while [ -n "$left" ]; do
        sleep 1
        running=""
        for one in $left; do
            if kill -0 "${one#*:}" 2>/dev/null; then running="$running $one"; else ended "${one%%:*}" "${one#*:}"; fi
        done
        left=$running
    done
    lanes=""
}
ended() {
    wait "$2" || failed="$failed $1"
    printf '\n-- %s, ended after %s s\n' "$1" "$(($(date +%s) - started))"
    mv "$logs/$1.running" "$logs/shown"
    cat "$logs/shown"
}
end_if_failed() {
    [ -z "$failed" ] || { echo "failed:$failed" >&2; exit 1; }
}

integration() {
    together "integration" architectures "$1" browsers "$1" pages "$1" servers "$1" studies "$1"
    together "timing: beside no other lane" timing_of_robots "$1" timing_of_browsers "$1"
}

case "${1:-test}" in
    lane)
        [ "$5" != studies ] || give_way
        "$5" "$6"
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
        together "style, types, scripts and the unit lane" lint "" scripts "" unit ""
        end_if_failed
        integration "not nightly and not soak"
        ;;
    nightly)
        alone other_platforms ""
        integration "nightly and not soak"
        ;;
    soak)
        step "soak: this takes hours, and prints what each part took"
        limit=$((36 * 60))
        export PYTEST_ARGS="--timeout 0 ${PYTEST_ARGS:-}"
        alone unit thorough
        alone servers soak
        alone architectures soak
        alone browsers soak
        alone pages soak
        alone studies soak
        alone timing_of_robots soak
        alone timing_of_browsers soak
        ;;
    *)
        echo "run_tests.sh format|lint|check|test|nightly|soak, not $1" >&2
        exit 2
        ;;
esac
end_if_failed
case "${1:-test}" in
    format | lint) ;;
    *) [ -e "$logs/tested" ] || { echo "No test was chosen: look at PYTEST_ARGS." >&2; exit 1; } ;;
esac
step "done"
