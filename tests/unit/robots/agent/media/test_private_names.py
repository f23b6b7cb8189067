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


class Names(ast.NodeVisitor):
    """Collects the private names that one file touches and that are not its own."""

    def __init__(self, imported):
        self.imported, self.found = imported, set()
        self._bases = []  # of each class that the visit is in: what of it belongs to a library

    def visit_ClassDef(self, node):
        bases = [
            self.imported[base.id]
            for base in node.bases
            if isinstance(base, ast.Name) and base.id in self.imported
        ]
        self._bases.append([base for base in bases if inspect.isclass(base)])
        self.found |= {
            part.name
            for part in node.body
            if isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef)
            and self._inherited(part.name)
        }
        self.generic_visit(node)
        self._bases.pop()

    def visit_Attribute(self, node):
        if PRIVATE.match(node.attr) and (not is_own(node.value) or self._inherited(node.attr)):
            self.found.add(node.attr)
        self.generic_visit(node)

    def visit_Call(self, node):
        if isinstance(node.func, ast.Name) and node.func.id in ACCESSORS:
            name = node.args[1]
            assert isinstance(name, ast.Constant), (
                f"line {node.lineno}: a name that is put together cannot be found"
            )
            if PRIVATE.match(name.value):
                self.found.add(name.value)
        self.generic_visit(node)

    def visit_ImportFrom(self, node):
        if (node.module or "").partition(".")[0] in LIBRARIES:
            self.found |= {
                part
                for part in [*node.module.split("."), *(alias.name for alias in node.names)]
                if PRIVATE.match(part)
            }

    def visit_Import(self, node):
        for alias in node.names:
            if alias.name.partition(".")[0] in LIBRARIES:
                self.found |= {part for part in alias.name.split(".") if PRIVATE.match(part)}

    def _inherited(self, name):
        bases = self._bases[-1] if self._bases else []
        classes = [one for base in bases for one in base.__mro__[:-1]]
        return PRIVATE.match(name) and any(
            name in vars(one) or name in codes(one) for one in classes
        )


def codes(one):
    return getattr(getattr(one.__init__, "__code__", None), "co_names", ())


def is_own(value):
    return ast.unparse(value) in {"self", "cls", "super()"}


def imports(tree):
    """What a file has imported from the libraries, by the name that it uses."""
    return {
        alias.asname or alias.name: getattr(importlib.import_module(node.module), alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in LIBRARIES
        for alias in node.names
    }


def touched(text):
    tree = ast.parse(text)
    names = Names(imports(tree))
    names.visit(tree)
    return names.found


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
