"""Two processes that do something at the same instant, again and again, on real databases."""

import contextlib
import json
import os
import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.support.django_shell import DjangoShell
from tests.support.paths import ROOT
from tests.support.programs.postgres import running_postgres
from tests.support.sessions.site import DATABASE, empty_database

DATABASES = ["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)]
SOON = 0.03  # s, in which both have read what they need
# A sleep would wake up late, without a race.
AT_ONCE = "import time\nwhile time.time() < start: pass\n"


class Racers:
    def __init__(self, environment: dict[str, str]) -> None:
        self.shells = [DjangoShell(ROOT, environment) for _ in range(2)]

    def ask(self, code: str, **values: Any) -> Any:
        """Run code in one of them, with these variables; return the JSON that it prints."""
        return json.loads(self.shells[0].ask(_assigned(values) + code))

    def race(self, first: str, then: str, *questions: Any) -> list[Any]:
        """Run `first` in each process with a `question` of its own, and `then` in both at once;
        return the JSON that they print.
        """
        start = time.time() + SOON
        codes = [
            _assigned({"start": start, "question": one}) + first + AT_ONCE + then
            for one in questions
        ]
        with ThreadPoolExecutor() as pool:
            asked = pool.map(lambda shell, code: shell.ask(code), self.shells, codes)
            return [json.loads(answer) for answer in asked]


def _assigned(values: dict[str, Any]) -> str:
    return "import json\n" + "".join(f"{name} = {value!r}\n" for name, value in values.items())


@contextlib.contextmanager
def racing_on(database: str, var: Path) -> Iterator[Racers]:
    """Start them on one of `DATABASES`."""
    own = {"VAR_DIR": str(var), "HTTP_ONLY": "1", "LOG_LEVEL": "WARNING"}
    environment = os.environ | own | {"DJANGO_SETTINGS_MODULE": "tests.settings"}
    environment.pop("DATABASE_URL", None)
    with contextlib.ExitStack() as stack:
        if database == "sqlite":
            shutil.copyfile(empty_database(), var / DATABASE)
        else:
            environment["DATABASE_URL"] = stack.enter_context(running_postgres()).url
        racers = Racers(environment)
        for shell in racers.shells:
            stack.callback(shell.close)
        yield racers
