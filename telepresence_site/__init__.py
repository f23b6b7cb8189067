"""The Django project."""

import robots  # noqa: F401 -- prepares structlog and PyAV, before anything else loads them
