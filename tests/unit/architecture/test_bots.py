"""Bots are visitors: they speak HTTP and WebSocket, and know of the server's inside no more than a
page does.
"""

import ast
from pathlib import Path

from tests.support.paths import ROOT

BOTS = sorted((ROOT / "experiments" / "bots").rglob("*.py"))
OURS = {
    "telepresence_site",
    "experiments",
    "surveys",
    "sessions",
    "accounts",
    "robots",
    "tests",
    "django",
    "channels",
}
# The messages that pages have too, routes over the floor plan of a page, the answers of a bot to a
# question of each type, which are in the type's own file, and the bots' own modules.
ALLOWED = (
    "experiments.bots",
    "robots.api",
    "robots.world.cell_graph",
    "robots.world.render_plan.rasterise",
    "robots.world.solids.leaf_end",
    "sessions.protocol",
    "surveys.questions",
)
# What makes time go faster tells Django's clock, in the processes of a sandbox; it is no bot.
CLOCKS = ROOT / "experiments" / "bots" / "fast_time" / "sitecustomize.py"


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, path
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def test_bots_import_no_models_and_nothing_else_of_the_servers_inside():
    assert len(BOTS) > 10
    for path in BOTS:
        inside = {
            name
            for name in imports(path)
            if name.split(".")[0] in OURS and not name.startswith(ALLOWED)
        }
        assert inside <= ({"django.utils.timezone"} if path == CLOCKS else set()), (
            f"{path.name} imports {inside}"
        )


def test_the_words_on_the_wire_bring_no_models_with_them():
    for name in (
        "sessions/protocol.py",
        *(f"robots/api/{path.name}" for path in (ROOT / "robots" / "api").glob("*.py")),
    ):
        inside = {module for module in imports(ROOT / name) if module.split(".")[0] in OURS}
        assert all(module.startswith(("robots.api", "sessions.protocol")) for module in inside), (
            f"{name} imports {inside}"
        )
