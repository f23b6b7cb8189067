"""A function in a process of its own: its answer, its refusals, and its limits."""

import os
import time

import pytest
from django.utils.translation import gettext, override

from robots.files import limited_process
from robots.files.limited_process import ChildLimits, ImportRefusedError, run_limited


class NoGoodError(Exception):
    problems = ("This is wrong.", "So is that.")


def doubled(data: bytes, names: list[str]) -> dict:
    return {"data": data * 2, "names": names}


def refuse() -> None:
    raise NoGoodError


def fail() -> None:
    raise KeyError("gone")


def use_memory(size: int) -> int:
    return len(bytearray(size))


def use_processor() -> None:
    while True:
        pass


def sleep() -> None:
    time.sleep(60.0)


def nest() -> int:
    return nest() + 1


def overflow_stack() -> None:
    os.kill(os.getpid(), 11)


def environment() -> list[str]:
    return sorted(os.environ)


def translated() -> str:
    return gettext("Log in")


def test_plain_data_is_returned():
    assert run_limited(doubled, b"\x00a", ["é"]) == {"data": b"\x00a\x00a", "names": ["é"]}


def test_refusal_is_raised_with_its_sentences():
    with pytest.raises(ImportRefusedError) as refused:
        run_limited(refuse)
    assert refused.value.problems == ["This is wrong.", "So is that."]


def test_other_failure_is_raised_with_its_traceback():
    with pytest.raises(RuntimeError, match="KeyError: 'gone'"):
        run_limited(fail)


@pytest.mark.parametrize(
    ("function", "arguments", "limits"),
    [
        (use_memory, [2 * 1024**3], ChildLimits()),
        (use_processor, [], ChildLimits(processor=1)),
        (sleep, [], ChildLimits(elapsed=1.0)),
        (nest, [], ChildLimits()),
        (overflow_stack, [], ChildLimits()),
    ],
)
def test_process_that_reaches_a_limit_is_refused(function, arguments, limits):
    with pytest.raises(ImportRefusedError, match="too much memory or time"):
        run_limited(function, *arguments, limits=limits)


@pytest.mark.parametrize("megabytes", [1, 30])
def test_limit_that_is_reached_before_the_file_is_read_is_named(megabytes):
    with pytest.raises(ImportRefusedError, match="too much memory or time"):
        run_limited(use_memory, 200 * 1024**2, limits=ChildLimits(memory=megabytes * 1024**2))


def test_library_that_cannot_be_loaded_is_named(monkeypatch):
    monkeypatch.setattr(doubled, "__module__", "robots.files.not_there")
    with pytest.raises(ImportRefusedError, match="cannot read such files just now"):
        run_limited(doubled, b"", [])


def test_import_that_waited_too_long_for_another_is_refused_with_the_reason():
    refused = pytest.raises(ImportRefusedError, match="Another import is running")
    with limited_process._one_at_a_time, refused:
        run_limited(doubled, b"", [], limits=ChildLimits(elapsed=0.1))


def test_child_gets_no_secrets_from_the_environment(monkeypatch):
    monkeypatch.setenv("SECRET_KEY", "secret")
    monkeypatch.setenv("DATABASE_URL", "secret")
    assert {"SECRET_KEY", "DATABASE_URL"}.isdisjoint(run_limited(environment))


def test_child_uses_the_language_of_the_user():
    with override("es"):
        assert run_limited(translated) == gettext("Log in") != "Log in"
