"""What a site keeps of people is read by nobody else on its machine."""

import os
import stat
import subprocess
import sys

import pytest
from django.conf import settings as site

pytestmark = pytest.mark.skipif(os.name != "posix", reason="modes of files")
OTHERS = stat.S_IRWXG | stat.S_IRWXO
WRITE = """
import django, os
django.setup()
from django.core.management import call_command
from django.db import connection
call_command("migrate", "accounts", verbosity=0)
with connection.cursor() as cursor:
    cursor.execute("CREATE TABLE IF NOT EXISTS probe (n INTEGER)")
    cursor.execute("INSERT INTO probe VALUES (1)")
    folder = os.path.dirname(str(connection.settings_dict["NAME"]))
    for name in sorted(os.listdir(folder)):
        if "sqlite3" in name:
            print(name, oct(os.stat(os.path.join(folder, name)).st_mode & 0o777))
"""


def write(var):
    kept = {
        name: value
        for name, value in os.environ.items()
        if name in {"PATH", "HOME", "LANG", "VIRTUAL_ENV"}
    }
    environment = kept | {
        "VAR_DIR": str(var),
        "HTTP_ONLY": "1",
        "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
    }
    done = subprocess.run(
        ["/bin/sh", "-c", 'umask 022; exec "$@"', "sh", sys.executable, "-c", WRITE],
        cwd=site.BASE_DIR,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(line.split() for line in done.stdout.splitlines())


def test_the_database_and_what_sqlite_keeps_beside_it_are_the_owners_alone(tmp_path):
    var = tmp_path / "var"
    for _ in range(2):
        assert write(var) == dict.fromkeys(
            ("telepresence.sqlite3", "telepresence.sqlite3-shm", "telepresence.sqlite3-wal"),
            "0o600",
        )
    assert var.stat().st_mode & OTHERS == 0


def test_a_database_from_before_that_everybody_could_read_is_closed(tmp_path):
    var = tmp_path / "var"
    write(var)
    for file in var.glob("*.sqlite3*"):
        file.chmod(0o644)
    assert set(write(var).values()) == {"0o600"}
