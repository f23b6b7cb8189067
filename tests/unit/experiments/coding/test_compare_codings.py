"""The command that compares codings: files of ELAN and BORIS together, and clear messages."""

import json
from io import StringIO
from pathlib import Path

import pytest
from django.core.management import CommandError, call_command

from experiments.coding.boris import to_boris
from experiments.coding.eaf import to_eaf
from experiments.coding.scheme import CodedEvent, scheme_from

SCHEME = [
    {"code": "help", "name": "Asks for help", "kind": "point", "key": "h"},
    {"code": "lost", "name": "Seems lost", "kind": "interval", "key": "l"},
]
CODES = scheme_from(SCHEME).codes
DATE = "2026-03-04T12:00:00"
ANN = [CodedEvent("help", 2.2), CodedEvent("lost", 4.0, 8.0)]
BOB = [CodedEvent("help", 2.4), CodedEvent("help", 9.0), CodedEvent("lost", 6.0, 8.0)]


@pytest.fixture
def files(tmp_path) -> list[Path]:
    written = {
        "scheme.json": json.dumps(SCHEME).encode(),
        "ann.eaf": to_eaf(CODES, ANN, "ann", f"{DATE}+00:00"),
        "bob.boris": to_boris(CODES, {"S1": BOB}, "study", DATE),
    }
    for name, content in written.items():
        (tmp_path / name).write_bytes(content)
    return [tmp_path / name for name in written]


def run(*args: object, **options: object) -> str:
    out = StringIO()
    call_command("compare_codings", *(str(arg) for arg in args), stdout=out, **options)
    return out.getvalue()


def test_files_of_elan_and_boris_are_compared(files):
    output = run(*files, duration=10.0)
    # lost, ten bins of a second: 4 to 8 against 6 to 8; p_o = 0.8, p_e = 0.56.
    assert "ann.eaf and bob.boris: kappa 0.545" in output
    assert "events in both: 1, only in ann.eaf: 0, only in bob.boris: 1" in output
    assert "events of ann.eaf (rows) and bob.boris: kappa" in output
    assert run(*files, duration=10.0) == output


@pytest.mark.parametrize(
    ("options", "message"),
    [({"duration": 5.0}, "outside the session"), ({"bin": 0.0, "duration": 10.0}, "bin")],
)
def test_figures_that_do_not_fit_are_refused(files, options, message):
    with pytest.raises(CommandError, match=message):
        run(*files, **options)


def test_files_that_cannot_be_read_are_named(files, tmp_path):
    scheme, ann, bob = files
    with pytest.raises(CommandError, match="at least two coders"):
        run(scheme, ann)
    with pytest.raises(CommandError, match="No such file"):
        run(scheme, ann, tmp_path / "nothing.eaf")
    with pytest.raises(CommandError, match="not valid JSON"):
        run(ann, ann, bob)
    (tmp_path / "bad.eaf").write_bytes(b"<a>")
    with pytest.raises(CommandError, match=r"bad\.eaf: This is not valid XML"):
        run(scheme, ann, tmp_path / "bad.eaf")
