"""Every command of the README, the tutorials and the API clients is run, or run by the test that is
named here: a command that this file does not know fails.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.finished import run
from tests.support.sessions.site import LOOPBACK, Site, free_port, running_site, wait_for

DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs/tutorials").glob("*.md")))
CLIENTS = ROOT / "docs/reference/clients.md"
PYTHON = re.compile(r"^(?:\.venv/bin/)?python3? ")
# Commands that other tests run: test_demo.py and test_set_up.py (the demo), test_deploy.py and
# test_containers.py (what a server is made of; no container runs in the tests), and those that
# write a setting.
ELSEWHERE = ("make demo", "podman build", "podman compose up", "cp deploy/", "echo ", "editor ")
ELSEWHERE += ("cd deploy", "sudo apt install", "git clone", "cd telepresence")
IN_A_CONTAINER = "podman compose exec web-1 python "
TOKEN, KEY, COOKIE = "TOKEN", "KEY", "COOKIE"  # what a reader replaces


def commands(document: Path) -> list[str]:
    """Return the lines of a document's shell blocks, without comments."""
    text = document.read_text("utf-8")
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    lines = (line.partition("  #")[0].strip() for block in blocks for line in block.splitlines())
    return [line for line in lines if line]


def with_ports(site: Site, robot_port: int, line: str) -> list[str]:
    """Return a documented command with this test's Python, site and robot, as a list of words."""
    line = line.replace("http://127.0.0.1:8000", site.url)
    line = line.replace("127.0.0.1:7601", f"{LOOPBACK}:{robot_port}")
    line = line.removeprefix(IN_A_CONTAINER)
    line = line.replace("/var/lib/telepresence/", f"{site.var}/").replace(
        "--out var/", f"--out {site.var}/"
    )
    return PYTHON.sub("", line).split()


def only(lines: list[str], words: str) -> str:
    """Return the one documented command that has some words."""
    (found,) = {line for line in lines if words in line}
    return found


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with running_site(tmp_path_factory.mktemp("site")) as running:
        running.start_robot("giraff", "--start", "corridor-centre")
        yield running


def test_every_documented_command_is_known_here():
    tried = Path(__file__).read_text("utf-8")
    lines = [line for document in (*DOCUMENTS, CLIENTS) for line in commands(document)]
    assert len(lines) > 20
    for line in lines:
        words = line.removeprefix(IN_A_CONTAINER).split()
        marks = [word for word in words if word.endswith(".py") or word.isidentifier()]
        is_known = line.startswith(ELSEWHERE) or any(f'"{mark}' in tried for mark in marks)
        assert is_known, f"no test runs: {line}"


def test_make_targets_of_the_documents_exist():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    text = " ".join(path.read_text("utf-8") for path in DOCUMENTS)
    named = set(re.findall(r"\bmake ([a-z-]+)(?=[`\s]*(?:[A-Z]+=\S+)?[`\n])", text))
    assert "demo" in named
    assert named <= set(targets)


@pytest.mark.nightly
def test_tutorial_of_the_first_robot_connects_a_robot(site):
    lines = commands(ROOT / "docs/tutorials/first-robot.md")
    port = free_port()
    site.start("my-simulator", with_ports(site, port, only(lines, "robots.simulator")))
    wait_for(lambda: site.listening(port), 20, "the robot of the tutorial")
    checked = site.run(*with_ports(site, port, only(lines, "--check")))
    assert checked.rstrip().endswith("All is well.")
    site.django(
        "from robots.models import FloorPlan, Robot;"
        "Robot.objects.create(name='my-robot', floor_plan=FloorPlan.objects.get(name='office'))"
    )
    made = site.run("manage.py", "enrol", "my-robot", "--server", site.url)
    words = with_ports(site, port, only(lines, "--enrol"))
    words[words.index(TOKEN)] = made.split()[-1]
    site.start("my-robot", words)
    wait_for(lambda: site.robot_is_online("my-robot"), 30, "the robot of the tutorial online")
    site.stop("my-robot")
    again = with_ports(site, port, only(lines, "--enrol"))[:-2]
    site.start("my-robot", again)
    wait_for(lambda: "broker_connected" in site.log("my-robot"), 30, "a start without a token")
    site.stop("my-robot")
    site.stop("my-simulator")


@pytest.mark.nightly
def test_tutorial_of_the_first_study_writes_dataset_and_figures(site):
    with site.robot("rhodon"):  # which the study has, too
        site.django(
            "from django.utils import timezone; from telepresence_site.demo.study import"
            " publish_study; publish_study(timezone.now())"
        )
    lines = commands(ROOT / "docs/tutorials/first-study.md")
    for command in ("export_study", "analyse_study"):
        assert "files" in site.run(*with_ports(site, 0, only(lines, command)), within=patient(200))
    assert (site.var / "my-dataset").is_dir()
    assert (site.var / "my-figures").is_dir()


@pytest.mark.nightly
def test_tutorial_of_the_first_server_repeats_the_guide_and_its_commands_run(site):
    lines = commands(ROOT / "docs/tutorials/first-server.md")
    guide = (ROOT / "docs/howto/run-in-containers.md").read_text("utf-8")
    inside = [line for line in lines if line.startswith(IN_A_CONTAINER)]
    for line in lines:
        if line.startswith(("podman build", "podman compose up", "cp ", "echo ", "cd ")):
            assert line in guide
    site.run(*with_ports(site, 0, only(inside, "check")), "--fail-level", "CRITICAL")
    site.run(*with_ports(site, 0, only(inside, "import_floorplan")))
    site.run(*with_ports(site, 0, only(inside, "backup")))
    assert (site.var / "backup.tar.gz").stat().st_size > 1000
    assert site.run("manage.py", *only(inside, "createsuperuser").split()[-1:], "--help")


@pytest.mark.parametrize(
    ("program", "name"), [(sys.executable, "robots.py"), ("node", "robots.mjs")]
)
def test_clients_of_the_json_api_list_and_stop_a_robot(site, program, name):
    lines = commands(CLIENTS)
    listing, acting = sorted((line for line in lines if name in line), key=len)
    key = site.run("manage.py", "api_key", "giraff", name).strip()
    listed = client(site, program, listing)
    assert re.search(r"^giraff +(available|stopped) +\d+ %", listed.stdout, re.MULTILINE), listed
    done = client(site, program, acting.replace("dock", "stop"), ROBOT_KEY=key)
    assert done.returncode == 0, done.stderr
    refused = client(site, program, acting, ROBOT_KEY="wrong")
    assert refused.returncode == 1
    assert refused.stderr.startswith("refused: ")


def client(site: Site, program: str, line: str, **more: str) -> subprocess.CompletedProcess[str]:
    words = [word for word in with_ports(site, 0, line) if "=" not in word]
    words = words[1:] if words[0] in {"node", "python3", ".venv/bin/python"} else words
    return run(program, *words, env=site.environment | more, timeout=patient(90))


def test_client_that_drives_turns_the_robot(site):
    line = only(commands(CLIENTS), "turn.py")
    done = client(site, sys.executable, line, SESSION=site.sign_in("program"))
    assert done.stdout == "giraff has turned.\n", done.stderr
    wait_for(lambda: site.sessions()[-1][2] == "ended", 20, "the end of the drive")
