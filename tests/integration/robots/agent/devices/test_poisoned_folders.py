"""PyAV's libraries were built to read folders under /tmp, which any user could create: the product
must not read them.

The tests run in a mount namespace with its own /tmp, where each read changes a file's access time.
"""

import os
import re
import sys
import textwrap

import pytest

from tests.support.agents.simulators import ROOT
from tests.support.programs.finished import run
from tests.support.programs.sound_server import environment_of

POISONED = ("/tmp/vendor/etc/gnutls/config", "/tmp/vendor/share/alsa/alsa.conf")
LOADS_AV = re.compile(r"^\s*(import|from) (av|aiortc)\b", re.MULTILINE)
# The project itself may be under /tmp: keep it open while the new /tmp is mounted.
SCRIPT = r"""
mount --bind "$KEPT" /mnt
mount -t tmpfs -o strictatime none /tmp
mkdir -p "$KEPT"
mount --bind /mnt "$KEPT"
cd "$KEPT"
mkdir -p /tmp/vendor/etc/gnutls /tmp/vendor/share/alsa
echo '[overrides]' > /tmp/vendor/etc/gnutls/config
echo 'pcm.default { type null }' > /tmp/vendor/share/alsa/alsa.conf
touch -a -d @1 /tmp/vendor/etc/gnutls/config /tmp/vendor/share/alsa/alsa.conf
"$@" >/dev/null 2>/tmp/said </dev/null
for file in /tmp/vendor/etc/gnutls/config /tmp/vendor/share/alsa/alsa.conf; do
    [ "$(stat -c %X "$file")" = 1 ] || echo "$file"
done
[ -s /tmp/said ] && cat /tmp/said >&2
exit 0
"""
SOUNDS = """
    from robots.agent.config import load
    from robots.agent.devices.equipment import equipment_of
    from robots.agent.adapters import registry

    words = {"robot": "giraff", "mqtt_url": "mqtt://127.0.0.1:1"}
    words |= {"microphone": "alsa:default", "loudspeaker": "alsa:default"}
    found = equipment_of(registry.create("moos", "giraff"), load(words, {}))
    for device, use in (
        (found.audio, lambda it: it.read(1.0)),
        (found.outputs[0], lambda it: it.play(__import__("numpy").zeros(960, "int16"))),
    ):
        device.start()
        try:
            use(device)
        except Exception as error:
            print(error)
        device.stop()
"""


def read_by(tmp_path, *command: str) -> list[str]:
    """Return the poisoned files that a command of the project has read."""
    home = tmp_path / "home"
    (home / "run").mkdir(parents=True)
    own = {"PYTHONPATH": str(ROOT), "DJANGO_SETTINGS_MODULE": "tests.settings", "KEPT": str(ROOT)}
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    inside = ("unshare", "--mount", *user, "sh", "-eu", "-c", SCRIPT, "sh")
    return run(*inside, *command, env=environment_of(home) | own, check=True).stdout.split()


def python(source: str) -> tuple[str, ...]:
    return (sys.executable, "-c", textwrap.dedent(source))


def test_pyav_alone_reads_both_files(tmp_path):
    source = """
        import av
        try:
            av.open("default", format="alsa")
        except OSError:
            pass
    """
    assert read_by(tmp_path, *python(source)) == list(POISONED)


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(
            python(
                "import sys, numpy, robots.world.grid as grid\n"
                "grid.encode_png(numpy.zeros((2, 2), 'uint8'))\n"
                "assert 'av' in sys.modules"
            ),
            id="a plan, as the server reads it",
        ),
        pytest.param(
            python("import robots.agent.media.side, sys; assert 'aiortc' in sys.modules"),
            id="aiortc",
        ),
        pytest.param((sys.executable, "manage.py", "check"), id="the site"),
        pytest.param((sys.executable, "manage.py", "run_robot", "--help"), id="run_robot"),
        pytest.param((sys.executable, "-m", "robots.agent", "--help"), id="the agent alone"),
        pytest.param((sys.executable, "-m", "robots.simulator", "--help"), id="the simulator"),
        pytest.param(python(SOUNDS), id="microphone and loudspeaker"),
    ],
)
def test_no_process_of_the_product_reads_them(tmp_path, command):
    assert read_by(tmp_path, *command) == []


def test_only_the_package_robots_loads_av():
    """There, `robots/__init__.py` is imported before it."""
    others = {".venv", "tests", "benchmarks", "var", "node_modules"}
    sources = [
        path
        for folder in ROOT.iterdir()
        if folder.is_dir() and folder.name not in others
        for path in folder.rglob("*.py")
    ]
    loading = [path.relative_to(ROOT) for path in sources if LOADS_AV.search(path.read_text())]
    assert [str(path) for path in loading if path.parts[0] != "robots"] == []
    assert loading, "the pattern finds nothing"
