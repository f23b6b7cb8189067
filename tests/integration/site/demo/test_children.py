"""Parts that are started together: each is waited for in turn, and any that ends is named."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from telepresence_site.children import Children, DemoPart, StartFailed

LIVE = "import time; time.sleep(600)"


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Children]:
    family = Children(tmp_path / "log", dict(os.environ))
    yield family
    family.stop()


def touching(path: Path) -> list[str]:
    return ["-c", f"import pathlib; pathlib.Path({str(path)!r}).touch(); {LIVE}"]


def test_part_that_waits_for_a_later_one_finds_it(children, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    waiting = [
        "-c",
        f"import pathlib, time\nwhile not pathlib.Path({str(second)!r}).exists():"
        " time.sleep(0.01)\n" + touching(first)[1],
    ]
    steps = []

    @contextlib.contextmanager
    def step(name: str) -> Iterator[None]:
        yield
        steps.append(name)

    parts = [
        DemoPart("first", waiting, lambda _child: first.exists()),
        DemoPart("second", touching(second), lambda _child: second.exists()),
    ]
    children.start_together(parts, within=60, step=step)
    assert steps == ["first", "second"]
    assert [child.name for child in children.running] == ["first", "second"]


def test_part_that_ends_is_named_during_the_start_of_another(children):
    fails = ["-c", "print('port taken'); raise SystemExit(1)"]
    parts = [
        DemoPart("broker", ["-c", LIVE], lambda _child: False),
        DemoPart("web server", fails, lambda _child: True),
    ]
    with pytest.raises(StartFailed, match=r"The web server ended at once: port taken"):
        children.start_together(parts, within=60)


def test_part_that_is_never_ready_is_named_with_its_last_lines(children):
    broker = DemoPart("broker", ["-c", LIVE], lambda _child: False)
    with pytest.raises(StartFailed, match="The broker was not ready in time"):
        children.start_together([broker], within=0.2)
