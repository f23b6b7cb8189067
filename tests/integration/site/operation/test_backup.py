"""A backup restores everything, with both databases; a damaged one restores nothing."""

import gzip
import io
import json
import os
import tarfile
from pathlib import Path

import pytest
from django.core.management import CommandError, call_command

from robots.files.limited_process import ChildLimits
from telepresence_site.ops.backup import archive
from telepresence_site.ops.backup.archive import BackupError
from tests.support.django_shell import DjangoShell
from tests.support.paths import ROOT
from tests.support.programs.finished import site_environment
from tests.support.programs.postgres import running_postgres

FILES = {
    "secrets/secret_key": "key-of-the-site",
    "credentials/giraff.toml": "token",
    "media/a/b.bin": "x" * 100_000,
}
MB = 1024**2
FACTS = {"made_at": "now", "engine": "sqlite", "migrations": [], "key": ""}
COMMAND = """
from django.core.management import CommandError, call_command
try:
    call_command(*{arguments!r})
except CommandError as error:
    print("refused:", error)
"""
FILL = (
    "from accounts.models import User; from robots.models import *; u ="
    " User.objects.create_user('ada', password='seven green kettles');"
    " Robot.objects.create(name='giraff', title='Girafá', owner=u);"
    " RobotPresence.objects.update(report={'a': [1, None]});"
    " FloorPlan.objects.create(name='p', title='P', resolution=0.05, origin_x=0, origin_y=0,"
    " width=1, height=1, image=bytes(range(256)))"
)
SHOW = (
    "from accounts.models import User; from robots.models import *; r = Robot.objects.get();"
    " print(r.pk, r.title, r.presence.report, r.owner.check_password('seven green kettles'),"
    " bytes(FloorPlan.objects.get().image) == bytes(range(256)))"
)


class Site:
    """Commands on a VAR_DIR and a database of their own, in one process."""

    def __init__(self, var, database):
        self.var = var
        settings = {"DATABASE_URL": database, "HTTP_ONLY": "1", "LOG_LEVEL": "WARNING"}
        self.django_shell = DjangoShell(ROOT, site_environment(var, **settings))
        self.django_shell.ask("pass")  # makes its secret key, which ours replaces

    def call(self, *arguments):
        return self.django_shell.ask(COMMAND.format(arguments=arguments)).strip()

    def fill(self):
        for name, text in FILES.items():
            (self.var / name).parent.mkdir(parents=True, exist_ok=True)
            (self.var / name).write_text(text)
        self.call("migrate", "-v", "0")
        self.django_shell.ask(FILL)

    def show(self):
        return self.django_shell.ask(SHOW), {name: (self.var / name).read_text() for name in FILES}


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def databases(request):
    """Two empty ones."""
    if request.param == "sqlite":
        yield "", ""
        return
    with running_postgres() as server:
        import psycopg

        with psycopg.connect(server.url, autocommit=True) as connection:
            connection.execute("CREATE DATABASE second")
        yield server.url, f"{server.url.rpartition('/')[0]}/second"


@pytest.fixture
def sites(tmp_path, databases):
    sites = [
        Site(tmp_path / name, database)
        for name, database in zip(("first", "second"), databases, strict=True)
    ]
    yield sites
    for each in sites:
        each.django_shell.close()


@pytest.mark.nightly
def test_backup_is_restored_without_overwriting_anything(tmp_path, sites):
    first, second = sites
    file = str(tmp_path / "backup.tar.gz")
    first.fill()
    assert "4 files" in first.call("backup", file)
    assert Path(file).stat().st_mode & 0o077 == 0
    assert "already exists" in first.call("backup", file)
    assert "database is not empty" in first.call("restore", file)
    assert "is sound" in second.call("restore", "--check", file)
    assert "is restored" in second.call("restore", file)
    assert second.show() == first.show()
    assert (second.var / "secrets/secret_key").stat().st_mode & 0o077 == 0
    assert second.call("migrate", "--check", "-v", "0") == ""
    assert not [*second.var.glob("backup-*"), *second.var.glob("restore-*")]


NOTE = "from accounts import audit; audit.note({act!r}, robot='giraff', role='screen')"
ACTS = "from accounts.models import *; print(*AuditEntry.objects.values_list('act', flat=True))"


@pytest.mark.nightly
def test_interventions_since_an_older_backup_are_merged_into_the_restored_site(tmp_path, sites):
    first, second = sites
    file, log = str(tmp_path / "backup.tar.gz"), str(tmp_path / "log.jsonl")
    first.fill()
    first.django_shell.ask(NOTE.format(act="stopped"))
    first.call("backup", file)
    first.django_shell.ask(NOTE.format(act="estop"))
    assert first.call("interventions", log) == "2 entries written."
    second.call("restore", file)
    assert second.django_shell.ask(ACTS).split() == ["stopped"]
    assert second.call("interventions", log, "--merge") == "1 entries added."
    assert second.django_shell.ask(ACTS).split() == ["estop", "stopped"]


@pytest.fixture
def backup(tmp_path):
    (tmp_path / "a").write_bytes(b"a" * 3000)
    (tmp_path / "b").write_bytes(os.urandom(3000))
    members = [("x/a", tmp_path / "a"), ("x/b", tmp_path / "b")]
    archive.write(tmp_path / "backup.tar.gz", members, FACTS)
    return tmp_path / "backup.tar.gz"


def opened(source, tmp_path, largest=archive.GB):
    return archive.unpack(str(source), str(tmp_path / "out"), largest)


def test_archive_is_read_as_it_was_written(backup, tmp_path):
    manifest = opened(backup, tmp_path)
    assert manifest["made_at"] == "now"
    assert (tmp_path / "out/x/b").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.9])
def test_truncated_archive_is_refused(backup, tmp_path, share):
    data = backup.read_bytes()
    backup.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(BackupError, match=r"backup\.tar\.gz"):
        opened(backup, tmp_path)


@pytest.mark.parametrize("place", [0.3, 0.6, 0.9])
def test_changed_byte_is_found(backup, tmp_path, place):
    data = bytearray(gzip.decompress(backup.read_bytes()))
    data[int(2000 + place * 5000)] ^= 1
    backup.write_bytes(gzip.compress(bytes(data)))
    with pytest.raises(BackupError):
        opened(backup, tmp_path)


def forged(path, members, manifest=True, document=None):
    with tarfile.open(path, "w:gz") as made:
        for info, content in members:
            info.size = len(content)
            made.addfile(info, io.BytesIO(content))
        if manifest:
            content = document or json.dumps({"format": 1, **FACTS, "files": {}}).encode()
            info = tarfile.TarInfo("manifest.json")
            info.size = len(content)
            made.addfile(info, io.BytesIO(content))
    return path


def link(name):
    info = tarfile.TarInfo(name)
    info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
    return info


OUTSIDE = [*map(tarfile.TarInfo, ("../evil", "/etc/evil", "a/../../evil")), link("media/x")]


@pytest.mark.parametrize("info", OUTSIDE, ids=lambda info: info.name)
def test_paths_outside_of_the_backup_are_refused(tmp_path, info):
    with pytest.raises(BackupError, match=r"points outside its folder|is not a file"):
        opened(forged(tmp_path / "f", [(info, b"")]), tmp_path)


def test_files_that_the_manifest_does_not_name_are_refused(tmp_path):
    with pytest.raises(BackupError, match="media/x is not what was written"):
        opened(forged(tmp_path / "f", [(tarfile.TarInfo("media/x"), b"x")]), tmp_path)


def test_archive_without_a_manifest_is_refused(tmp_path):
    file = forged(tmp_path / "f", [(tarfile.TarInfo("media/x"), b"x")], manifest=False)
    with pytest.raises(BackupError, match="no manifest"):
        opened(file, tmp_path)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (b"[]", "Expected `object`, got `array`"),
        (b"[" * 100_000, "recursion"),
        (b"{", "truncated"),
        (b"\xff", "manifest of"),
        (b'{"format": 2}', "has format 2; this version reads 1"),
        (b'{"format": 1}', "missing required field `made_at`"),
        (json.dumps({"format": 1, **FACTS, "files": []}).encode(), "at `\\$.files`"),
        (json.dumps({"format": 1, **FACTS, "files": {"a": 1}}).encode(), "at `\\$.files"),
    ],
    ids=["list", "nested", "truncated", "bytes", "newer", "lacking", "files", "file"],
)
def test_restore_of_a_broken_manifest_is_refused_with_the_reason(tmp_path, document, words):
    file = forged(tmp_path / "backup.tar.gz", [], document=document)
    with pytest.raises(CommandError, match=words) as refused:
        call_command("restore", "--check", str(file))
    assert "backup.tar.gz" in str(refused.value)


def test_restore_of_too_large_a_backup_stops_before_it_is_unpacked(tmp_path, settings):
    settings.VAR_DIR = tmp_path / "var"
    settings.VAR_DIR.mkdir()
    file = forged(tmp_path / "bomb", [(tarfile.TarInfo("media/x"), bytes(50_000_000))])
    assert file.stat().st_size < 100_000
    with pytest.raises(CommandError, match=r"more than 0\.01 GB.*--largest-gb"):
        call_command("restore", "--check", "--largest-gb", "0.01", str(file))
    with pytest.raises(CommandError, match="media/x is not what was written"):
        call_command("restore", "--check", str(file))


def test_restore_leaves_room_on_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr("telepresence_site.ops.backup.whole.RESERVE", 10**18)
    file = forged(tmp_path / "backup", [(tarfile.TarInfo("media/x"), b"x")])
    with pytest.raises(CommandError, match="more than 0 GB"):
        call_command("restore", "--check", str(file))


def test_header_that_needs_too_much_memory_is_refused(tmp_path, monkeypatch):
    limits = ChildLimits(memory=300 * MB)
    monkeypatch.setattr("telepresence_site.ops.backup.whole.UNPACKING", limits)
    header = tarfile.TarInfo("x")
    header.type, header.size = tarfile.XHDTYPE, 400 * MB
    with gzip.open(tmp_path / "bomb", "wb", compresslevel=1) as file:
        file.write(header.tobuf())
        for _ in range(400):
            file.write(bytes(MB))
    with pytest.raises(CommandError, match="too much memory"):
        call_command("restore", "--check", str(tmp_path / "bomb"))


def test_failed_backup_leaves_no_files(tmp_path):
    with pytest.raises(BackupError):
        archive.write(tmp_path / "backup", [("x", tmp_path / "missing")], {})
    assert list(tmp_path.iterdir()) == []


def test_backup_of_newer_code_or_of_another_engine_is_refused(monkeypatch):
    from telepresence_site.ops.backup.whole import _check_fits

    manifest = {"engine": "sqlite", "files": {}, "key": ""}
    manifest["migrations"] = ["robots.9999_of_tomorrow"]
    with pytest.raises(BackupError, match="one migration unknown here"):
        _check_fits(manifest)
    with pytest.raises(BackupError, match="of a postgresql database"):
        _check_fits({**manifest, "engine": "postgresql"})
    assert _check_fits({**manifest, "migrations": ["robots.0017_presence_and_credentials"]}) == [
        "The backup is from an older version: run manage.py migrate.",
        (
            "SECRET_KEY differs from that of the backup: everybody has to log in again, and "
            "links that were sent no longer work."
        ),
    ]
