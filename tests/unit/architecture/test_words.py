"""Names in the code are the terms of its fields. These words were a private language once, and do
not come back: beside each stands what the thing is called.
"""

import ast
import re
from pathlib import Path

import pytest

from tests.support.media.sources import PACKAGES, python_files, text_of
from tests.support.paths import ROOT

INSTEAD = {
    "believe": "what is set, such as set_turn_tls_context",
    "carrier": "transport router",
    "clerk": "Django shell",
    "climb": "bitrate adapter",
    "clockwork": "scheduler",
    "company": "peers",
    "draught": "random doors",
    "entrance": "connection context",
    "errand": "action",
    "fate": "fault, outcome",
    "herald": "announcer",
    "homecoming": "return to dock",
    "household": "network prefix",
    "in_parts": "iter_batches",
    "lateness": "jitter, staleness",
    "ledger": "sequence tracker, action history",
    "lettering": "bitmap font",
    "life_sign": "lock file",
    "mailbox": "send queue",
    "passers": "recently lost obstacles",
    "rendezvous": "broker discovery",
    "retold": "replay check",
    "roll_call": "last-seen batcher",
    "roster": "peer registry",
    "rung": "layer",
    "settling": "finalization",
    "side_by_side": "task group",
    "standing_orders": "desired state",
    "standings": "response statuses",
    "surroundings": "rolling obstacle map",
    "timekeeper": "scheduler",
    "tourist": "scripted visitor",
    "transcript": "record builder",
    "ways_out": "publisher",
    "whereabouts": "pose buffer, pose extrapolator",
}
BANNED = re.compile(rf"(?:^|_)({'|'.join(INSTEAD)})s?(?:_|$)")
# How long something takes to settle, in control and filtering, is a term of those fields.
ALLOWED = {"SETTLING", "settling", "settling_seconds"}


def snake(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().strip("_")


def names_in(source: str) -> set[str]:
    """Every name that the source gives to something of its own."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
                found.add(name)
            case ast.AsyncFunctionDef(name=name) | ast.arg(arg=name):
                found.add(name)
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                found.add(name)
    return {name for name in found if not name.startswith("test_")}


def banned_in(names: set[str]) -> dict[str, str]:
    matches = {name: BANNED.search(snake(name)) for name in names - ALLOWED}
    return {name: INSTEAD[match[1]] for name, match in matches.items() if match}


def may_have_banned_names(source: str) -> bool:
    """Tell whether a source has the letters of a banned word anywhere: few have."""
    letters = source.lower().replace("_", "")
    return any(word.replace("_", "") in letters for word in INSTEAD)


def names_of(path: Path) -> set[str]:
    source = text_of(path)
    inside = names_in(source) if may_have_banned_names(source) else set()
    return {path.stem, path.parent.name, *inside}


@pytest.mark.parametrize("package", [*PACKAGES, "benchmarks", "tests"])
def test_no_name_is_of_the_private_language(package):
    found = {}
    for path in python_files(package):
        if "migrations" in path.parts:
            continue
        banned = banned_in(names_of(path))
        found |= {f"{path.relative_to(ROOT)}: {name}": word for name, word in banned.items()}
    assert found == {}


def test_scripts_are_named_by_what_they_are():
    paths = [path for path in (ROOT / "static/js").rglob("*.js") if banned_in({path.stem})]
    assert [str(path.relative_to(ROOT)) for path in paths] == []


def test_the_list_finds_what_it_bans():
    source = "class RollCall:\n    def whereabouts(self, tourist): self._clockwork = in_parts = 1"
    assert may_have_banned_names(source)
    assert set(banned_in(names_in(source))) == {
        "RollCall",
        "whereabouts",
        "tourist",
        "_clockwork",
        "in_parts",
    }
