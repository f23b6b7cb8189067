"""`check` looks for each private name of aiortc, aioice, pylibsrtp and av that media code uses."""

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest

from robots.agent import media
from robots.agent.media.webrtc import aiortc_hooks
from robots.agent.media.webrtc.aiortc_hooks import PRIVATE_NAMES, UnsupportedAiortcError, check

FOLDER = Path(media.__file__).parent
LIBRARIES = {"aiortc", "aioice", "pylibsrtp", "av"}
PRIVATE = re.compile(r"_(?!_)\w*[A-Za-z]\w*$")
ACCESSORS = {"getattr", "setattr", "delattr", "hasattr"}


def touched(text):
    """Return the private names that a file touches and that are not its own."""
    tree = ast.parse(text)
    imported, found = imports(tree), set()
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=value, attr=name) if not is_own(value):
                found.add(name)
            case ast.Call(func=ast.Name(id=accessor), args=[_, name, *_]) if accessor in ACCESSORS:
                assert isinstance(name, ast.Constant), (
                    f"line {node.lineno}: a name that is put together cannot be found"
                )
                found.add(name.value)
            case ast.ImportFrom(module=module, names=names) if is_library(module):
                found |= {*module.split("."), *(alias.name for alias in names)}
            case ast.Import(names=names):
                modules = [alias.name for alias in names if is_library(alias.name)]
                found |= {part for module in modules for part in module.split(".")}
            case ast.ClassDef(bases=bases):
                own = {getattr(part, "attr", getattr(part, "name", "")) for part in ast.walk(node)}
                found |= own & inherited(imported[b.id] for b in bases if is_name(b, imported))
    return {name for name in found if PRIVATE.match(name)}


def inherited(bases):
    """Return the names that instances have of a library's classes."""
    classes = [one for base in bases if inspect.isclass(base) for one in base.__mro__[:-1]]
    codes = [getattr(one.__init__, "__code__", None) for one in classes]
    return {name for one in classes for name in vars(one)} | {
        name for code in codes for name in getattr(code, "co_names", ())
    }


def is_name(node, names):
    return isinstance(node, ast.Name) and node.id in names


def is_own(value):
    return ast.unparse(value) in {"self", "cls", "super()"}


def is_library(module):
    return (module or "").partition(".")[0] in LIBRARIES


def imports(tree):
    """What a file has imported from the libraries, by the name that it uses."""
    return {
        alias.asname or alias.name: getattr(importlib.import_module(node.module), alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and is_library(node.module)
        for alias in node.names
    }


CHECKED = {name for names in PRIVATE_NAMES.values() for name in names}


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.name)
def test_check_looks_for_every_private_name_that_the_media_code_touches(path):
    assert touched(path.read_text()) - CHECKED == set()


def test_check_looks_for_no_unused_name():
    used = set().union(*(touched(path.read_text()) for path in FOLDER.rglob("*.py")))
    assert {name for name in CHECKED if name.startswith("_")} - used == set()


@pytest.mark.parametrize(
    ("owner", "name"),
    [(owner, name) for owner, names in PRIVATE_NAMES.items() for name in names],
    ids=lambda part: getattr(part, "__name__", part),
)
def test_a_release_that_lacks_a_name_is_refused_by_that_name(monkeypatch, owner, name):
    check()

    class Newer:
        def __init__(self):
            pass

    for other in PRIVATE_NAMES[owner]:
        if other != name:
            setattr(Newer, other, None)
    monkeypatch.setattr(aiortc_hooks, "PRIVATE_NAMES", {Newer: PRIVATE_NAMES[owner]})
    with pytest.raises(UnsupportedAiortcError, match=rf"lacks Newer\.{name}$"):
        check()
