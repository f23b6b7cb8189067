"""Make the virtual environment and install a lock file into it: set_up.py VENV LOCK.

Runs before anything is installed, so it uses the standard library alone, and syntax that an old
Python still reads far enough to say that it is too old.
"""

import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import time

OLDEST = (3, 11)
PIP_LOCK = os.path.join(os.path.dirname(os.path.abspath(__file__)), "pip.lock")
DOWNLOAD = re.compile(r"(Downloading|Using cached) .*\(([\d.]+) ([kMG]?B)\)")
MEGABYTES = {"B": 1e-6, "kB": 1e-3, "MB": 1.0, "GB": 1e3}


def fail(sentence):
    """Print an error and exit."""
    sys.stderr.write(sentence + "\n")
    sys.exit(1)


def stamp_of(lock):
    """Return what an up-to-date environment was made of: this Python, pip and this lock file."""
    digest = hashlib.sha256()
    for path in (PIP_LOCK, lock):
        with open(path, "rb") as file:
            digest.update(file.read())
    return "%s %s" % (sys.version.split()[0], digest.hexdigest())


def installed(venv):
    """Return the stamps of the lock files that were installed."""
    try:
        with open(os.path.join(venv, "installed")) as file:
            return file.read().split("\n")
    except FileNotFoundError:
        return []


def make_environment(venv):
    """Create the virtual environment unless a working one of this Python is there."""
    python = os.path.join(venv, "bin", "python")
    if os.path.exists(python):
        version = subprocess.run(
            [python, "-c", "import sys, pip; print(sys.version.split()[0])"],
            capture_output=True,
            text=True,
            check=False,
        )
        if version.stdout.strip() == sys.version.split()[0]:
            return python
    if importlib.util.find_spec("ensurepip") is None:
        fail("Python's venv module is missing: install it with 'sudo apt install python3-venv'.")
    started = time.monotonic()
    made = subprocess.run(
        [sys.executable, "-m", "venv", "--clear", venv], capture_output=True, text=True, check=False
    )
    if made.returncode:
        last = (made.stdout + made.stderr).strip().splitlines()[-1:] or ["no reason given"]
        fail("The virtual environment could not be made in %s: %s" % (venv, last[0]))
    say("virtual environment", started)
    return python


def update_pip(python):
    """Replace the pip that Python came with, and remove its setuptools, which no package needs:
    both are years old and have known vulnerabilities.
    """
    started = time.monotonic()
    for arguments in (
        ["install", "--quiet", "--require-hashes", "--no-input", "-r", PIP_LOCK],
        ["uninstall", "--quiet", "--yes", "setuptools"],
    ):
        done = subprocess.run(
            [python, "-m", "pip", arguments[0], "--disable-pip-version-check"] + arguments[1:],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode:
            lines = done.stdout.strip().splitlines()
            errors = [line for line in lines if line.startswith("ERROR")] or lines[-1:]
            fail("pip could not be updated: %s" % (errors[0] if errors else "it gave no reason"))
    say("pip", started)


def install(python, lock):
    """Install the lock file with pip, hashes checked, and say how much was fetched."""
    with open(lock) as file:
        wanted = sum(1 for line in file if "==" in line and not line.startswith((" ", "#")))
    print("  installing up to %d packages from %s, hashes checked …" % (wanted, lock), flush=True)
    started, fetched, count, tail = time.monotonic(), 0.0, 0, []
    command = [
        python,
        "-m",
        "pip",
        "install",
        "--require-hashes",
        "--disable-pip-version-check",
        "--no-input",
        "--progress-bar",
        "off",
        "-r",
        lock,
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as pip:
        for line in pip.stdout:
            tail = (tail + [line.strip()])[-15:]
            found = DOWNLOAD.search(line)
            if found:
                count += 1
                fetched += float(found.group(2)) * MEGABYTES[found.group(3)]
                if sys.stdout.isatty():
                    print("\r  %3d packages, %.0f MB" % (count, fetched), end="", flush=True)
    if pip.returncode:
        print()
        errors = [line for line in tail if line.startswith("ERROR")] or tail
        fail(
            "The packages of %s could not be installed: %s"
            % (lock, errors[0] if errors else "pip gave no reason")
        )
    if sys.stdout.isatty():
        print("\r", end="")
    say("%d packages, %.0f MB" % (count, fetched), started)


def say(what, started):
    """Print one finished step and how long it took."""
    print("  %-44s %5.1f s" % (what, time.monotonic() - started), flush=True)


def main():
    """Check this Python, then bring the environment up to date."""
    if sys.version_info[:2] < OLDEST:
        fail(
            "Python %d.%d or newer is needed, and %s is %d.%d: name a newer one with 'make"
            " PYTHON=/path/to/python3.11'." % (OLDEST + (sys.executable,) + sys.version_info[:2])
        )
    venv, lock = sys.argv[1:3]
    python = make_environment(venv)
    stamp = stamp_of(lock)
    stamps = installed(venv)
    if stamp not in stamps:
        update_pip(python)
        install(python, lock)
        # What was installed before may now have other versions: only this lock is there as it says.
        stamps = [stamp]
        # The developers' lock holds the run-time's, at the same versions.
        if lock == "requirements-dev.lock":
            stamps.append(stamp_of("requirements.lock"))
        with open(os.path.join(venv, "installed"), "w") as file:
            file.write("\n".join(stamps))


if __name__ == "__main__":
    main()
