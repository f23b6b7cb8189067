"""What collectstatic makes of the modules and style sheets."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import minify
import pytest

from tests.support.paths import ROOT

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def collected(tmp_path_factory) -> Path:
    var = tmp_path_factory.mktemp("var")
    environment = {name: value for name, value in os.environ.items() if name not in {"PLAIN_STATIC", "DEBUG", "DJANGO_SETTINGS_MODULE"}}
    subprocess.run(
        [sys.executable, "manage.py", "collectstatic", "--noinput", "-v", "0"],
        cwd=ROOT, env={**environment, "VAR_DIR": str(var), "HTTP_ONLY": "1"}, check=True, timeout=120, umask=0o027,
    )  # fmt: skip
    return var / "static"


def test_the_proxy_which_is_another_user_may_read_what_was_collected_by_one_who_shares_nothing(collected):
    shut = [path for path in collected.rglob("*") if not path.stat().st_mode & (0o005 if path.is_dir() else 0o004)]
    assert [path for path in shut if path.suffix != ".gz"] == []  # these are for the site's own processes


def test_every_module_imports_only_hashed_modules_so_that_none_loads_twice(collected):
    names = json.loads((collected / "staticfiles.json").read_text())["paths"]
    modules = [hashed for plain, hashed in names.items() if plain.startswith("js/") and plain.endswith(".js")]
    assert modules
    for hashed in modules:
        for target in re.findall(r"(?:from|import)\s*\(?\s*[\"'](\.[^\"']+)[\"']", (collected / hashed).read_text()):
            assert re.search(r"\.[0-9a-f]{12}\.js$", target), f"{hashed} imports {target}"
            assert (collected / hashed).parent.joinpath(target).resolve().exists(), f"{hashed} imports {target}, which is not there"


def test_collected_scripts_are_what_node_reads_without_their_comments(collected):
    modules = [path for path in (collected / "js").rglob("*.js") if re.search(r"\.[0-9a-f]{12}\.js$", path.name)]
    assert modules
    for path in modules:
        kind = "commonjs" if path.name.startswith("boot.") else "module"
        source = path.read_text()
        assert "/**" not in source
        checked = subprocess.run(["node", f"--input-type={kind}", "--check"], input=source, capture_output=True, text=True, check=False)
        assert checked.returncode == 0, f"{path.name}: {checked.stderr}"


def test_the_pages_own_tests_pass_on_its_shortened_modules(tmp_path):
    for name in ("tests/js", "tests/golden", "templates/sessions", "static/js"):
        shutil.copytree(ROOT / name, tmp_path / name)
    for path in (tmp_path / "static" / "js").rglob("*.js"):
        path.write_text(minify.string("text/javascript", path.read_text()))
    tests = [tmp_path / "tests/js" / f"{name}.test.js" for name in ("commands", "dots", "overlay", "pointing", "robot_api", "session")]
    done = subprocess.run(["node", "--test", *map(str, tests)], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout[-3000:]


def test_the_drive_pages_script_stays_small(collected):
    wanted = re.findall(r"static 'js/([^']+)'", (ROOT / "templates" / "sessions" / "_modules.html").read_text())
    names = json.loads((collected / "staticfiles.json").read_text())["paths"]
    size = sum((collected / names[f"js/{name}"]).stat().st_size for name in [*wanted, "console.js", "boot.js"])
    assert 40_000 < size < 150_000, f"{size} bytes"


def test_no_style_sheet_points_at_a_file_that_is_not_there(collected):
    for sheet in (collected / "css").glob("*.css"):
        for target in re.findall(r"url\([\"']?([^\"')]+)[\"']?\)", sheet.read_text()):
            assert target.startswith("data:") or (sheet.parent / target.split("#")[0]).resolve().exists(), f"{sheet.name}: {target}"
