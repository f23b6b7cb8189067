"""The official validator of Psych-DS (psych-ds/psychds-validator 1.5.0), in a Chromium, as it is
bundled with the R package psychds; `make setup-psychds` fetches it.

It asks the network for the newest schema, gets none, and uses the one that comes with it.
"""

import hashlib
from pathlib import Path
from typing import Any

from playwright.sync_api import Route, sync_playwright

from tests.support.browsers.chromium import CHROMIUM, FLAGS
from tests.support.paths import ROOT

FOLDER = ROOT / "var" / "psychds" / "inst" / "shiny" / "www"
SCHEMAS = ("defaultSchema.json", "defaultSchemaOrg.json", "defaultSchemaOrgJsonLD.json")
FILES = ("js/validator.js", "js/jsonld.min.js", *SCHEMAS)
# Of these, one after the other.
SHA256 = "d86692e81fe60b7093bbeca1dd83ad9bc3eacf533b79c3458f1c8f95f5733b9d"
ORIGIN = "http://validator.test"
PAGE = """<!doctype html><script src="/js/jsonld.min.js"></script>
<script type="module">
  import { validateWeb } from "/js/validator.js";
  const webFile = (text) => ({ text: async () => text });
  const tree = (node) =>
    Object.fromEntries(
      Object.entries(node).map(([name, part]) => [
        name,
        typeof part === "string"
          ? { type: "file", file: webFile(part) }
          : { type: "directory", contents: tree(part) },
      ]),
    );
  window.validate = async (files) => {
    const { valid, issues } = await validateWeb(tree(files), { schema: "latest" });
    const told = (file) => `${file.path} ${file.evidence ?? ""}`;
    const found = [...issues.values()].map(({ key, severity, files }) => ({
      key, severity, files: [...files.values()].map(told),
    }));
    return { valid, issues: found };
  };
</script>"""


def is_there() -> bool:
    return FOLDER.is_dir()


def validate(folder: Path) -> dict[str, Any]:
    """Return what the validator says of a folder: `valid`, and `issues` with their severity."""
    whole = b"".join((FOLDER / name).read_bytes() for name in FILES)
    assert hashlib.sha256(whole).hexdigest() == SHA256, f"{FOLDER} has another version"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page()
        page.route("**/*", _serve)
        page.goto(ORIGIN)
        page.wait_for_function("window.validate !== undefined")
        found: dict[str, Any] = page.evaluate("(files) => window.validate(files)", _tree(folder))
        browser.close()
    return found


def _serve(route: Route) -> None:
    name = route.request.url.removeprefix(ORIGIN).lstrip("/")
    if route.request.url.rstrip("/") == ORIGIN:
        route.fulfill(body=PAGE, content_type="text/html; charset=utf-8")
    elif name in FILES:
        kind = "text/javascript" if name.endswith(".js") else "application/json"
        route.fulfill(body=(FOLDER / name).read_bytes(), content_type=f"{kind}; charset=utf-8")
    else:
        route.abort()


def _tree(folder: Path) -> dict[str, Any]:
    return {
        path.name: _tree(path) if path.is_dir() else path.read_bytes().decode(errors="replace")
        for path in sorted(folder.iterdir())
    }
