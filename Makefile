# make demo    drive a simulated robot from a web page, on this machine    [PORT=8000] [LAN=1] [RESET=1]
# make check   style, types and the unit tests: a minute, for every change
# make test    set up what the tests need, and run everything that proves function
# make nightly whole stories, and every fault at every part: half an hour, each night
# make soak    what proves endurance: hours, before a release
# make lint    style, types, and the direction of imports
# make format  write Python and JavaScript in the style that make lint checks
# make bench   the benchmarks; results in benchmarks/results
# make screenshots    pictures of all pages, to be looked at, in var/screenshots
# make pictures    the pictures of README and documentation, in docs/img
# make docs    write the generated reference again
# make docs-site    the documentation as pages with search, in var/docs-site
# make messages    bring texts into the Spanish catalogue, and compile it
# make lock    resolve the dependencies again
# make dist    a release of the present commit in dist: wheel, source archive, components, checksums
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PHOTOGRAPHED := $(addprefix tests/integration/browser/,pages/test_accessibility.py visits/test_autonomy.py visits/test_slow_picture.py studies/test_replay.py drive_page/test_presence.py)
export PORT LAN RESET

.PHONY: demo check test nightly soak lint format bench docs docs-site messages lock dist setup setup-dev setup-ros2 setup-psychds test-packages screenshots pictures
.DEFAULT_GOAL := demo

demo: setup
	@exec $(BIN)/python manage.py demo

setup:
	@sh deploy/set_up.sh "$(PYTHON)" "$(VENV)" requirements.lock

setup-dev:
	@sh deploy/set_up.sh "$(PYTHON)" "$(VENV)" requirements-dev.lock

# ROS 2 for the tests of its adapter, 290 MB, in an environment of its own.
setup-ros2: test-packages
	@sh deploy/set_up_ros2.sh "$(PYTHON)" var/ros2

# The official validator of Psych-DS, for the nightly tests: it is in no package registry.
setup-psychds:
	@sh deploy/set_up_psychds.sh var/psychds

test-packages:
	@sh deploy/test_packages.sh

# ESLint, TypeScript's checker and Prettier, for the pages' scripts; npm is one of the tests' packages.
node_modules/installed: package-lock.json
	@command -v npm >/dev/null || { echo "npm is missing: install it with 'sudo apt install npm'." >&2; exit 1; }
	npm ci --ignore-scripts --no-audit --no-fund --loglevel=error
	@touch $@

test: setup-dev setup-ros2 node_modules/installed
	@BIN="$(BIN)" sh deploy/run_tests.sh test

check: setup-dev node_modules/installed
	@BIN="$(BIN)" sh deploy/run_tests.sh check

nightly: setup-dev setup-ros2 setup-psychds node_modules/installed
	@BIN="$(BIN)" sh deploy/run_tests.sh nightly

soak: setup-dev setup-ros2 node_modules/installed
	@BIN="$(BIN)" sh deploy/run_tests.sh soak

lint: setup-dev node_modules/installed
	@BIN="$(BIN)" sh deploy/run_tests.sh lint

format: setup-dev node_modules/installed
	@BIN="$(BIN)" sh deploy/run_tests.sh format

bench: setup-dev setup-ros2
	$(BIN)/python -m benchmarks

screenshots: setup-dev test-packages
	$(BIN)/python -m tests.support.browsers.screenshots
	mkdir -p var/screenshots/es
	SCREENSHOTS=var/screenshots $(BIN)/python -m pytest -q $(PHOTOGRAPHED)
	SCREENSHOTS=var/screenshots/es SCREENSHOTS_LANGUAGE=es $(BIN)/python -m pytest -q tests/integration/browser/pages/test_accessibility.py -k "strangers or visitors or step"

pictures: setup-dev test-packages
	DJANGO_SETTINGS_MODULE=tests.settings $(BIN)/python -m tests.support.browsers.pictures

docs: setup-dev
	$(BIN)/python -m docs.robot_api

docs-site: setup-dev
	$(BIN)/python -m sphinx -q -E -W --keep-going -c docs . var/docs-site
	@echo "Open var/docs-site/index.html."

messages: setup-dev
	@sh deploy/messages.sh $(BIN)/python

dist: setup-dev
	$(BIN)/python deploy/dist.py dist

lock:
	uv pip compile -q --universal --generate-hashes --no-header --no-annotate --python-version 3.11 --extra analysis pyproject.toml -o requirements.lock
	uv pip compile -q --universal --generate-hashes --no-header --no-annotate --python-version 3.11 --extra navigation pyproject.toml -o requirements-robot.lock
	uv pip compile -q --universal --generate-hashes --no-header --no-annotate --python-version 3.11 --extra analysis --extra postgres --extra redis pyproject.toml -o requirements-server.lock
	uv pip compile -q --universal --generate-hashes --no-header --no-annotate --python-version 3.11 --extra analysis --group dev pyproject.toml -o requirements-dev.lock
	uv pip compile -q --universal --generate-hashes --no-header --no-annotate --python-version 3.11 --group pyproject.toml:ros2 -o requirements-ros2.lock
	echo pip | uv pip compile -q --universal --generate-hashes --no-header --no-annotate --python-version 3.11 - -o deploy/pip.lock
	npm install -q --package-lock-only --omit-lockfile-registry-resolved --ignore-scripts --no-audit --no-fund
