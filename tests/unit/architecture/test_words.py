"""Names in the code and events in the log are the terms of their fields. These words were a private
language once; each has the term that replaced it.
"""

import ast
import re
from pathlib import Path

import pytest

from tests.support.media.sources import PACKAGES, python_files, scripts, text_of
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
    "land": "answer, acknowledge",
    "lent": "assigned",
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
# These are terms of tests, where a visitor hears and is told things.
IN_PRODUCT = {
    "heard": "received",
    "mind": "navigation node",
    "nobody": "without …, none",
    "said": "sent, reported, text",
    "somebody": "visitor, driver",
    "told": "published, reported",
    "whoever": "driver, visitor",
}
# How long something takes to settle, in control and filtering, is a term of those fields.
ALLOWED = {"SETTLING", "settling", "settling_seconds"}
ALLOWED_IN_SCRIPTS = {"Surroundings", "fate", "newFate"}
BROKER = ROOT / "robots/broker"
DECLARED = re.compile(
    r"\b(?:const|let|function|class)\s+(\w+)|^ +(?:async |static |get |#)*(\w+)\(.*\) \{$",
    re.MULTILINE,
)


def snake(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().strip("_")


def names_in(source: str) -> set[str]:
    """Every name that the source gives to something of its own, and the events that it logs."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
                found.add(name)
            case ast.AsyncFunctionDef(name=name) | ast.arg(arg=name):
                found.add(name)
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                found.add(name)
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id="log")),
                args=[ast.Constant(value=str(event)), *_],
            ):
                found.add(event)
    return {name for name in found if not name.startswith("test_")}


def names_in_script(source: str) -> set[str]:
    return {one or other for one, other in DECLARED.findall(source)} - ALLOWED_IN_SCRIPTS


def banned_in(names: set[str], words: dict[str, str] = INSTEAD) -> dict[str, str]:
    banned = re.compile(rf"(?:^|_)({'|'.join(words)})s?(?:_|$)")
    matches = {name: banned.search(snake(name)) for name in names - ALLOWED}
    return {name: words[match[1]] for name, match in matches.items() if match}


def may_have_banned_names(source: str, words: dict[str, str] = INSTEAD) -> bool:
    """Tell whether a source has the letters of a banned word anywhere: few have."""
    letters = source.lower().replace("_", "")
    return any(word.replace("_", "") in letters for word in words)


def names_of(path: Path, words: dict[str, str]) -> set[str]:
    source = text_of(path)
    inside = names_in(source) if may_have_banned_names(source, words) else set()
    return {path.stem, path.parent.name, *inside}


@pytest.mark.parametrize("package", [*PACKAGES, "benchmarks", "deploy", "docs", "tests"])
def test_no_name_is_of_the_private_language(package):
    found = {}
    for path in python_files(package):
        if "migrations" in path.parts:
            continue
        words = INSTEAD | IN_PRODUCT if is_product(path) else INSTEAD
        banned = banned_in(names_of(path, words), words)
        found |= {f"{path.relative_to(ROOT)}: {name}": word for name, word in banned.items()}
    assert found == {}


def is_product(path: Path) -> bool:
    return path.relative_to(ROOT).parts[0] in PACKAGES and BROKER not in path.parents


def test_no_name_in_a_script_is_of_the_private_language():
    found = {
        f"{path.relative_to(ROOT)}: {name}": word
        for path in scripts("static/js")
        for name, word in banned_in({path.stem, *names_in_script(text_of(path))}).items()
    }
    assert found == {}


@pytest.mark.parametrize(
    ("source", "banned"),
    [
        ("class RollCall: pass", {"RollCall"}),
        ("def whereabouts(tourist): pass", {"whereabouts", "tourist"}),
        ("self._clockwork = in_parts = 1", {"_clockwork", "in_parts"}),
        ("heard, told = 1, 2", {"heard", "told"}),
        ('log.info("nobody_drives", way=1)', {"nobody_drives"}),
        ("untold = SETTLING = 1", set()),
        ("def test_told(): pass", set()),
    ],
)
def test_the_list_finds_what_it_bans(source, banned):
    words = INSTEAD | IN_PRODUCT
    assert may_have_banned_names(source, words)
    assert set(banned_in(names_in(source), words)) == banned


def test_names_in_scripts_are_found():
    source = "const herald = 1;\nclass RollCall {\n  async tourist(a) {\n  }\n}\n"
    assert set(banned_in(names_in_script(source))) == {"herald", "RollCall", "tourist"}
