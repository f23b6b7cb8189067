"""Other users of the machine cannot read a site's data."""

import os
import stat
import sys

import pytest

from tests.support.programs.finished import run, site_environment

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
    environment = site_environment(var, HTTP_ONLY="1")
    done = run(sys.executable, "-c", WRITE, env=environment, umask=0o022)
    assert done.returncode == 0, done.stderr
    return dict(line.split() for line in done.stdout.splitlines())


def test_only_the_owner_can_read_the_sqlite_files(tmp_path):
    var = tmp_path / "var"
    for _ in range(2):
        files = [f"telepresence.sqlite3{end}" for end in ("", "-shm", "-wal")]
        assert write(var) == dict.fromkeys(files, "0o600")
    assert var.stat().st_mode & OTHERS == 0


def test_readable_database_of_an_earlier_version_becomes_private(tmp_path):
    var = tmp_path / "var"
    write(var)
    for file in var.glob("*.sqlite3*"):
        file.chmod(0o644)
    assert set(write(var).values()) == {"0o600"}
