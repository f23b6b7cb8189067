"""Whether a database refused because its disk is full."""

_SQLITE_FULL = "database or disk is full"
_POSTGRES_FULL = "53100"  # SQLSTATE disk_full


def is_disk_full(error: Exception) -> bool:
    """Tell whether there is no room: SQLite's own sentence, or PostgreSQL's code."""
    return (
        _SQLITE_FULL in str(error) or getattr(error.__cause__, "sqlstate", None) == _POSTGRES_FULL
    )
