"""The modules and style sheets after collectstatic."""

import gzip
import json
import re
import sys
from pathlib import Path

import pytest
from django.template import Context, Template

from telepresence_site.web import module_graph
from tests.support.paths import ROOT
from tests.support.programs.finished import run, site_environment

COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
IMPORTED = re.compile(r"(?:from|import)\s*\(?\s*[\"'](\.[^\"']+)[\"']")
HASH = re.compile(r"\.[0-9a-f]{12}(?=\.js)")
STATIC_IMPORT = re.compile(r"^(?:import|export)[^()]*?\bfrom \"([^\"]+)\";$", re.MULTILINE)
LISTED_SHEET = re.compile(r'^@import "(.+)";$', re.MULTILINE)
LARGEST = 181_500  # bytes of script that the drive page is sent
FIRST = 103_800  # and of it what it needs to connect
VIEWS = {f"view/{name}" for name in ("map", "overlay", "display", "technical")}
LATER = {*VIEWS, "autonomy", "study", "presence"}
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def collected(tmp_path_factory) -> Path:
    var = tmp_path_factory.mktemp("var")
    environment = site_environment(var, HTTP_ONLY="1")
    words = ["manage.py", "collectstatic", "--noinput", "-v", "0"]
    run(sys.executable, *words, env=environment, check=True, umask=0o027)
    return var / "static"


@pytest.mark.nightly
def test_static_files_collected_with_a_strict_umask_are_readable(collected):
    shut = [
        path
        for path in collected.rglob("*")
        if not path.stat().st_mode & (0o005 if path.is_dir() else 0o004)
    ]
    # compressed copies are for the site's own processes
    assert [path for path in shut if path.suffix != ".gz"] == []


def modules_of(collected: Path) -> dict[str, Path]:
    """Return our delivered scripts by their names in static/."""
    names = json.loads((collected / "staticfiles.json").read_text())["paths"]
    found = {
        plain: collected / hashed
        for plain, hashed in names.items()
        if plain.startswith("js/") and plain.endswith(".js")
    }
    assert set(found) == {
        str(path.relative_to(ROOT / "static")) for path in (ROOT / "static/js").rglob("*.js")
    }
    return found


def test_every_module_imports_only_hashed_modules_so_that_none_loads_twice(collected):
    imports = 0
    for plain, path in modules_of(collected).items():
        for target in IMPORTED.findall(COMMENT.sub("", path.read_text())):
            imports += 1
            assert HASH.search(target), f"{plain} imports {target}"
            assert path.parent.joinpath(target).resolve().exists(), (
                f"{plain} imports {target}, which is not there"
            )
    assert imports > len(list((ROOT / "static/js").rglob("*.js")))


def test_delivered_scripts_differ_from_their_sources_only_in_import_names(collected):
    for plain, path in modules_of(collected).items():
        assert HASH.sub("", path.read_text()) == (ROOT / "static" / plain).read_text(), plain


def test_every_script_is_also_stored_compressed(collected):
    copies = {path.with_name(f"{path.name}.gz"): path for path in modules_of(collected).values()}
    stored = [copy for copy in copies if copy.exists()]
    assert len(stored) > len(copies) / 2, "but for those that are too small"
    for copy in stored:
        assert gzip.decompress(copy.read_bytes()) == copies[copy].read_bytes()


@pytest.mark.parametrize(
    ("template", "entry"),
    [
        ("sessions/drive.html", "js/drive/page.js"),
        ("experiments/research/replay.html", "js/pages/replay/page.js"),
    ],
)
def test_page_preloads_all_modules_except_those_fetched_when_needed(collected, template, entry):
    tag = f'{{% modulepreload "{entry}" %}}'
    assert tag in (ROOT / "templates" / template).read_text()
    links = Template("{% load modules %}" + tag).render(Context())
    preloaded = HASH.sub("", links)
    files = {path.resolve(): plain for plain, path in modules_of(collected).items()}
    reached = [path for path, plain in files.items() if plain == entry]
    for path in reached:
        for target in STATIC_IMPORT.findall(path.read_text()):
            imported = (path.parent / target).resolve()
            reached += [imported] if imported not in reached else []
    assert sorted(re.findall(r'href="/static/([^"]+)"', preloaded)) == sorted(
        files[path] for path in reached
    )


def test_drive_page_lists_exactly_the_modules_that_it_fetches_later(collected):
    tag = '{% modulepreload_later "js/drive/features.js" beside="js/drive/page.js" %}'
    assert tag in (ROOT / "templates/sessions/drive.html").read_text()
    links = Template("{% load modules %}" + tag).render(Context())
    listed = re.findall(r'href="/static/([^"]+)"', HASH.sub("", links))
    assert {f"js/{name}/feature.js" for name in LATER} == {
        name for name in listed if name.endswith("/feature.js")
    }
    first = module_graph.modules_of("js/drive/page.js")
    assert not set(listed) & set(first)
    needed = {name for one in listed for name in module_graph.modules_of(one)}
    assert needed <= {*first, *listed}


def test_drive_pages_script_stays_within_its_size_limits(collected):
    modules = modules_of(collected)

    def size(*names: str) -> int:
        return sum(len(gzip.compress(modules[name].read_bytes())) for name in names)

    first = size(*module_graph.modules_of("js/drive/page.js"), "js/drive/load_retry.js")
    later = size(*module_graph.later_modules_of("js/drive/features.js", "js/drive/page.js"))
    assert FIRST / 2 < first < FIRST, f"{first} bytes"
    assert LARGEST / 2 < first + later < LARGEST, f"{first + later} bytes"


@pytest.mark.parametrize(
    ("template", "sheet"), [("base.html", "base.css"), ("sessions/drive.html", "drive_page.css")]
)
def test_page_has_one_style_sheet_which_contains_all_that_it_lists(collected, template, sheet):
    linked = re.findall(r"{% static '(css/[^']+)' %}", (ROOT / "templates" / template).read_text())
    assert linked == [f"css/{sheet}"]
    names = json.loads((collected / "staticfiles.json").read_text())["paths"]
    delivered = (collected / names[linked[0]]).read_text()
    assert "@import" not in delivered
    listed = LISTED_SHEET.findall((ROOT / "static/css" / sheet).read_text())
    places = [delivered.index((ROOT / "static/css" / name).read_text()) for name in listed]
    assert len(places) > 3
    assert places == sorted(places)


def test_style_sheets_name_only_existing_files(collected):
    for sheet in (collected / "css").glob("*.css"):
        for target in re.findall(r"url\([\"']?([^\"')]+)[\"']?\)", sheet.read_text()):
            assert (
                target.startswith("data:")
                or (sheet.parent / target.split("#")[0]).resolve().exists()
            ), f"{sheet.name}: {target}"
