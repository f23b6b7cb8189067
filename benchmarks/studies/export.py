"""The export of a thousand sessions with 1.2 million states from the database, as a folder and as
an archive, by the site's own command.

    python -m benchmarks.studies.export [--sessions N]

The study is made up by a seeded generator and stored in a database of the benchmark's own; time and
memory are those of the command's whole process, with its start.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.studies.analysis import SEED, large
from benchmarks.table import Figure, keep

ROOT = Path(__file__).resolve().parents[2]
EXPORT_SECONDS, MEGABYTES = 60.0, 300.0


def stored(sessions: int) -> str:
    """Put the made-up study into the database that the environment names, and return its name."""
    import django

    django.setup()
    from django.core.management import call_command
    from django.db import transaction

    from tests.support.studies.study_rows import put

    call_command("migrate", verbosity=0)
    with transaction.atomic():
        return put(large(sessions)).study.slug


def measured(*words: str) -> tuple[float, float]:
    """Run a command of the site and return its seconds and the most megabytes that it had."""
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "manage.py", *words], cwd=ROOT, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(words)} failed")
    return time.perf_counter() - begun, usage.ru_maxrss / 1024.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=1000)
    wanted = parser.parse_args().sessions
    with tempfile.TemporaryDirectory(prefix="telepresence-export-") as folder:
        home = Path(folder)
        os.environ |= {
            "VAR_DIR": folder,
            "DATABASE_URL": f"sqlite:///{home / 'db.sqlite3'}",
            "DJANGO_SETTINGS_MODULE": "tests.settings",
        }
        begun = time.perf_counter()
        study = stored(wanted)
        storing = time.perf_counter() - begun
        seconds, megabytes = measured("export_study", study, "--out", str(home / "dataset"))
        zip_seconds, zip_megabytes = measured(
            "export_study", study, "--zip", "--out", str(home / "dataset.zip")
        )
        size = (
            sum(path.stat().st_size for path in (home / "dataset").rglob("*") if path.is_file())
            / 1e6
        )
        states = sum(
            path.read_bytes().count(b"\n") - 1
            for path in (home / "dataset" / "data" / "states").iterdir()
        )
        packed = (home / "dataset.zip").stat().st_size / 1e6
    share = max(wanted / 1000.0, 0.1)  # the start of a process does not shrink with the sessions
    return keep(
        "export",
        [
            Figure("sessions", float(wanted), ""),
            Figure("states", float(states), ""),
            Figure("study made up and stored", storing, "s"),
            Figure("export as a folder", seconds, "s", EXPORT_SECONDS * share),
            Figure("most memory", megabytes, "MB", MEGABYTES),
            Figure("size of the folder", size, "MB"),
            Figure("export as an archive", zip_seconds, "s", EXPORT_SECONDS * share),
            Figure("most memory of that", zip_megabytes, "MB", MEGABYTES),
            Figure("size of the archive", packed, "MB"),
        ],
        seed=SEED,
    )


if __name__ == "__main__":
    sys.exit(main())
