"""A site's secret, made by the process that starts first."""

import os
import stat
import threading

import pytest

from telepresence_site.environment import kept_secret


def test_process_that_starts_while_the_secret_is_written_reads_all_of_it(tmp_path, monkeypatch):
    path, found = tmp_path / "secrets" / "secret_key", []
    fdopen = os.fdopen

    def start_another(*args, **options):
        monkeypatch.setattr(os, "fdopen", fdopen)
        other = threading.Thread(target=lambda: found.append(kept_secret(path)))
        other.start()
        other.join()
        return fdopen(*args, **options)

    monkeypatch.setattr(os, "fdopen", start_another)
    found.append(kept_secret(path))
    assert len(set(found)) == 1
    assert len(found[0]) >= 48
    assert path.read_text() == found[0]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [file.name for file in path.parent.iterdir()] == ["secret_key"]


def test_empty_secret_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "secret_key"
    path.touch()
    with pytest.raises(ValueError, match=r"secret_key is empty\. Delete it"):
        kept_secret(path)
