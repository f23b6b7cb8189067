"""What no linter checks: names of hosts, unfinished work, modules that would load twice."""

import ast
import re
import subprocess
from pathlib import Path

from tests.support.media.sources import text_of
from tests.support.paths import ROOT

BROAD = re.compile(r"\bexcept(?::|\s+(?:Base)?Exception\b)")
TRACKED = [
    ROOT / name
    for name in subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split("\n")
    if name
]


def sources(*endings: str, under: str = "") -> list[Path]:
    return [
        path
        for path in TRACKED
        if path.suffix in endings
        and path.is_file()
        and str(path.relative_to(ROOT)).startswith(under)
    ]


def test_lock_files_hold_no_address():
    for path in TRACKED:
        if path.name.endswith((".lock", "lock.json")) and path.is_file():
            assert "://" not in path.read_text(), (
                f"{path.name} names the place its packages came from"
            )


def test_every_locked_package_is_pinned_with_hashes():
    for part in ("", "-robot", "-server", "-dev", "-ros2"):
        blocks = re.split(r"\n(?=\S)", (ROOT / f"requirements{part}.lock").read_text().strip())
        assert len(blocks) > 20
        for block in blocks:
            assert re.match(r"[a-z0-9-]+==", block), block[:60]
            assert "--hash=sha256:" in block, block[:60]


def test_the_developers_lock_holds_every_run_time_package_at_the_same_version():
    def pins(name: str) -> set[str]:
        return set(re.findall(r"^([a-z0-9-]+==[^\s;]+)", (ROOT / name).read_text(), re.MULTILINE))

    assert pins("requirements-robot.lock") <= pins("requirements.lock")
    assert pins("requirements.lock") <= pins("requirements-server.lock")
    assert pins("requirements-server.lock") <= pins("requirements-dev.lock")


def test_no_work_is_left_undone_in_the_sources():
    mark = re.compile(r"\b(TO" + r"DO|FIX" + r"ME|XX" + r"X)\b")
    for path in sources(".py", ".js", ".css", ".html", ".sh"):
        assert not mark.search(text_of(path)), (
            f"{path.relative_to(ROOT)} says that something is left to do"
        )


def dotted(node: ast.AST) -> str:
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def test_every_import_in_a_module_ends_in_a_semicolon():
    # Django rewrites imports to hashed names only when they do; a module would otherwise load
    # twice.
    modules = sources(".js", under="static/js")
    assert modules
    for path in modules:
        for statement in re.findall(
            r"^(?:import|export)\b[^;]*?from\s+[\"'][^\"']+[\"'](.?)",
            path.read_text(),
            re.MULTILINE,
        ):
            assert statement == ";", path.relative_to(ROOT)


def test_broad_excepts_stand_only_where_a_loop_must_outlive_everything():
    found = set()
    for path in sources(".py"):
        relative = str(path.relative_to(ROOT))
        if relative.startswith(("tests/", "benchmarks/")) or not BROAD.search(text_of(path)):
            continue
        for node in ast.walk(ast.parse(text_of(path))):
            broad = isinstance(node, ast.ExceptHandler) and (
                node.type is None or dotted(node.type) in {"Exception", "BaseException"}
            )
            reraises = broad and any(
                isinstance(inner, ast.Raise) and inner.exc is None for inner in ast.walk(node)
            )
            if broad and not reraises:
                found.add(relative)
    control_loop = {
        "robots/agent/control/supervised_adapter.py",
        "robots/agent/control/dispatcher.py",
        "robots/agent/control/loop.py",
        "robots/agent/adapters/ros/guarded_node.py",
        "robots/agent/adapters/ros/ros1_node.py",
        "robots/agent/adapters/ros/ros2_node.py",
    }
    # one listener, page or message must not take those of the others
    listeners = {
        "robots/bridge/bridge.py",
        "robots/bridge/delivery.py",
        "robots/bridge/broker_address.py",
        "sessions/consumers/robot_page.py",
        "sessions/page_channel.py",
    }
    assert (
        found <= {"robots/agent/agent.py", "sessions/manager/service.py"} | control_loop | listeners
    )
