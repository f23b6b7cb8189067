"""A process with a site's settings that runs Python for a test. Django is set up once there, not
for every question (2 s of processor each).

`python -m tests.support.django_shell` reads one JSON string of code a line, runs it, and answers
{"said": what it printed, "error": traceback or ""}.
"""

import contextlib
import io
import json
import subprocess
import sys
import traceback
from pathlib import Path


class DjangoShell:
    """The test's side of it."""

    def __init__(self, root: Path, environment: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.django_shell"],
            cwd=root,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, code: str) -> str:
        """Run Python with Django set up, and return what it prints; AssertionError with the
        traceback of what it raises.
        """
        assert self._process.stdin, "a pipe was asked for"
        assert self._process.stdout, "a pipe was asked for"
        self._process.stdin.write(json.dumps(code) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"the clerk is gone (exit code {self._process.wait()})"
        answer: dict[str, str] = json.loads(line)
        assert not answer["error"], answer["error"]
        return answer["said"]

    def close(self) -> None:
        self._process.communicate()  # the end of its input is its end


def main() -> None:
    """Answer until the input ends. What is answered keeps no connection: the test may replace the
    database.
    """
    import django

    django.setup()
    from django.db import connections

    answers = sys.stdout
    for line in sys.stdin:
        said, error = io.StringIO(), ""
        with contextlib.redirect_stdout(said):
            try:
                exec(compile(json.loads(line), "<asked by a test>", "exec"), {})
            except Exception:
                error = traceback.format_exc()
        connections.close_all()
        answers.write(json.dumps({"said": said.getvalue(), "error": error}) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
