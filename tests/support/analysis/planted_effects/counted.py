"""Which drives of an exported study count, read from the rows of its folder and nothing else."""

import csv
from collections.abc import Iterator
from pathlib import Path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def reasons(dataset: Path) -> dict[str, str]:
    """Return why each drive of a bot does not count, by session; empty for those that do. In these
    studies no participant practised, was excluded or met a fault of the platform.
    """
    sessions = rows_of(dataset / "data" / "description-sessions_data.csv")
    assert not any(int(one["practice"]) or one["excluded"] for one in sessions)
    assert "platform" not in {one["fault_side"] for one in sessions}
    return {one["id"]: _reason(one) for one in sessions}


def _reason(session: dict[str, str]) -> str:
    if not session["outcome"]:
        return "running"
    if not session["first_frame"] and not session["first_motion"]:
        return "not_exposed"
    return "" if session["first_motion"] else "not_driven"


def reported_reasons(tables: Path) -> dict[str, str]:
    """Return the same as the report has it."""
    return {one["session"]: one["counts_why"] for one in rows_of(tables / "sessions.csv")}


def drawn_again(dataset: Path) -> Iterator[dict[str, str]]:
    people = rows_of(dataset / "data" / "description-participants_data.csv")
    return (one for one in people if int(one["draws"]) > 1)


def withdrawn(dataset: Path) -> Iterator[dict[str, str]]:
    people = rows_of(dataset / "data" / "description-participants_data.csv")
    return (one for one in people if int(one["withdrawn"]))
