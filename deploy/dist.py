"""Build a release of the present commit: dist.py FOLDER.

The folder gets the wheel, the source archive, lists of components (CycloneDX) for computers of
robots and for servers, and SHA256SUMS. What is not committed is left out, and every date is the
commit's: two runs write the same bytes.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COMPONENTS = {"robot": "requirements-robot.lock", "server": "requirements-server.lock"}


def run(*words, **options):
    """Run a program and return its output; exit with its errors."""
    done = subprocess.run(words, capture_output=True, text=True, check=False, **options)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


def checkout(folder):
    """Write the files of the present commit into a folder; return the commit's Unix time."""
    archive = folder.with_suffix(".tar")
    run("git", "-C", ROOT, "archive", "--output", archive, "HEAD")
    folder.mkdir()
    run("tar", "-xf", archive, "-C", folder)
    return run("git", "-C", ROOT, "log", "-1", "--format=%ct").strip()


def components(source, lock, version, environment):
    """Return the components that a lock file names, with their hashes, as CycloneDX."""
    about = ("--pyproject", "pyproject.toml", "--output-reproducible")
    words = (sys.executable, "-W", "ignore", "-m", "cyclonedx_py", "requirements", lock, *about)
    found = json.loads(run(*words, cwd=source, env=environment))
    found["metadata"]["component"]["version"] = version
    return json.dumps(found, indent=2, sort_keys=True) + "\n"


def main():
    """Build everything, and print the files with their sizes."""
    out = Path(sys.argv[1]).absolute()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as work:
        source = Path(work) / "source"
        environment = {**os.environ, "SOURCE_DATE_EPOCH": checkout(source), "TZ": "UTC"}
        run(sys.executable, "-m", "hatchling", "build", "-d", out, cwd=source, env=environment)
        (wheel,) = out.glob("*.whl")
        version = wheel.name.split("-")[1]
        for part, lock in COMPONENTS.items():
            text = components(source, lock, version, environment)
            (out / f"telepresence-{version}-{part}.cdx.json").write_text(text)
    files = sorted(out.iterdir())
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files]
    (out / "SHA256SUMS").write_text("".join(sums))
    for file in files:
        print(f"  {file.name:<48} {file.stat().st_size / 1e6:6.1f} MB")


if __name__ == "__main__":
    main()
