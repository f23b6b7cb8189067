"""A sandbox whose parts do not all live to its end."""

from pathlib import Path

import pytest

from experiments.shipped import shipped
from telepresence_site.demo.children import StartFailed
from telepresence_site.rehearsing import sandbox
from tests.support.site import wait_for


def test_a_part_that_ends_meanwhile_fails_the_play_with_its_last_words(tmp_path, settings, monkeypatch):
    settings.VAR_DIR = tmp_path
    started = []

    def start(children, _definition, _sites):
        started.append(children)
        children.start("web server", ["-c", "print('no memory left'); raise SystemExit(3)"])
        return "http://127.0.0.1:1"

    monkeypatch.setattr(sandbox, "_start", start)
    with pytest.raises(StartFailed, match=r"The web server ended meanwhile \(3\): no memory left"), sandbox.running(shipped()["exploration"], Path()):
        wait_for(started[0].ended, 20, "the end of the child")
    assert started[0].running == []
