"""Comments and docstrings mention only files, classes and functions that exist.

A file is found by its path or its name, a name in backticks by each of its parts, and so is a word
in CamelCase. A name exists where any code, template, style or message has it.
"""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.support.media.sources import PACKAGES, code, notes, python_files, scripts
from tests.support.paths import ROOT

# Files of other projects, by the folder or name that comments have.
OTHERS_FOLDERS = {
    "actionlib",
    "boris",
    "daphne",
    "internal",
    "overview",
    "providers",
    "resources",
    "rosapi",
    "rosbridge_library",
    "rosbridge_server",
    "rospy",
}
OTHERS_FILES = {"send_action_goal.py", "websocket_handler.py", "websockets.html"}
FOLDERS = ("accounts", "benchmarks", "deploy", "docs", "experiments", "locale", "robots")
FOLDERS += ("sessions", "static", "surveys", "telepresence_site", "templates", "tests")
WORD = re.compile(r"\w+")
# Names of other projects, of browsers and of protocols.
OTHERS_NAMES = frozenset(
    WORD.findall(
        """
        _ceiling _transmit a_b ActionClient ApplicationCommunicator AsPredicted attitude
        AutoDocking buildXMLFromQuery bulk_update CloseEvent cmd_vel_timeout compiled_metadata
        completion_codes ConfigMap DeSimone external_study_url Float32Array GamepadButton GnuTLS
        IncomingQueue InvalidServiceException JetStream KeyboardEvent KnownPeers LaTeX
        ListenAddress MediaDevices MessagePack MouseEvent MultiPublisher NonexistentFieldException
        ObjectIds OpenBLAS PerformanceObserver PipeWire PointerEvent ProcessClient
        ProcessParticleFilter PublisherManager PulseAudio PyAV randomUUID RegExp RegManager
        ResolveScope SendGoal SpeechSynthesis surveyGetXMLStructure ThreadedCommServer
        TypeConflictException TypeScript Uint32Array WakeLock WaterButler WebSocketProtocol
        world_from_robot
        """
    )
)
FILE = re.compile(r"(?<![\w./:{-])((?:[\w-]+/)*[\w-]+\.(?:py|js|html|css|md))\b")
TICKED = re.compile(r"`([^`\s]+)`")
NAME = re.compile(r"\.?_?[A-Za-z]\w*(?:\.\w+)*(?:\(\))?")
TYPEDEF = re.compile(r"@typedef [^@]*?\} ([A-Z]\w+)")
CAMEL = re.compile(r"(?<![\w./-])[A-Z][a-z0-9]+(?:[A-Z][a-z0-9]*)+(?![\w/-])")


@cache
def sources() -> tuple[Path, ...]:
    folders = (*PACKAGES, "benchmarks", "deploy", "docs", "tests")
    python = [path for folder in folders for path in python_files(folder)]
    mine = [path for path in python if "migrations" not in path.parts and path != Path(__file__)]
    return *mine, *scripts("static/js"), *scripts("tests/js")


@cache
def paths() -> frozenset[str]:
    """Return the paths of files, and all their endings: `a/b.py` and `b.py`."""
    kinds = {".py", ".js", ".html", ".css", ".md"}
    found = {path for folder in FOLDERS for path in (ROOT / folder).rglob("*")} | set(
        ROOT.glob("*")
    )
    parts = [path.relative_to(ROOT).parts for path in found if path.suffix in kinds]
    return frozenset("/".join(part[start:]) for part in parts for start in range(len(part)))


@cache
def names() -> frozenset[str]:
    """Return every word of the code, of templates, of styles and of settings."""
    others = [path for kind in ("html", "txt") for path in (ROOT / "templates").rglob(f"*.{kind}")]
    others += [*(ROOT / "static").rglob("*.css"), *(ROOT / "static").rglob("*.d.ts")]
    others += [ROOT / "pyproject.toml", *(ROOT / "tests/golden").glob("*.json")]
    others += [*(ROOT / "experiments").rglob("*.csv"), *(ROOT / "experiments").rglob("*.json")]
    others += [path for path in (ROOT / "deploy").rglob("*") if path.is_file()]
    texts = [code(path) for path in sources()] + [path.read_text("utf-8") for path in others]
    texts += [name for path in scripts("static/js") for name in typedefs(path)]
    return frozenset(word for text in texts for word in WORD.findall(text))


def typedefs(path: Path) -> list[str]:
    return [name for note in notes(path) for name in TYPEDEF.findall(note)]


def stale(note: str) -> Iterator[str]:
    """Yield what a comment or docstring mentions and no code has."""
    for file in FILE.findall(note):
        if file.partition("/")[0] not in OTHERS_FOLDERS and file not in paths() | OTHERS_FILES:
            yield file
    for ticked in TICKED.findall(note):
        if NAME.fullmatch(ticked) and not _exist(WORD.findall(ticked)):
            yield ticked
    # JSDoc has types in braces, which TypeScript checks
    plain = re.sub(r"`[^`]*`|\{[^}]*\}", "", note)
    yield from (word for word in CAMEL.findall(plain) if not _exist([word]))


def _exist(words: list[str]) -> bool:
    return all(word in names() or word in OTHERS_NAMES for word in words)


def test_comments_mention_what_exists():
    found = [
        f"{path.relative_to(ROOT)}: {mention}"
        for path in sources()
        for note in notes(path)
        for mention in stale(note)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("note", "expected"),
    [
        ("See kernel.py and safety/kernel.py.", []),
        ("See robots/agent/safety/kernel.py, `Kernel.tick`, and rospy/impl/registration.py.", []),
        ("See robots/agent/safety/latch.py.", ["robots/agent/safety/latch.py"]),
        ("See slow_pace.py.", ["slow_pace.py"]),
        ("Calls `turn_the_wheels()`.", ["turn_the_wheels()"]),
        ("Calls `Kernel.turn_the_wheels`.", ["Kernel.turn_the_wheels"]),
        ("The counterpart of MindProcess.", ["MindProcess"]),
        ("`CRASH_PARTS=sfu,redis` and `a + b` are no names.", []),
    ],
)
def test_a_stale_mention_is_found(note, expected):
    assert list(stale(note)) == expected
