"""A process with a site's settings that runs Python code for a test, so that Django is set up only
once (2 s of CPU time).

`python -m tests.support.django_shell` reads one JSON string of code per line, runs it, and answers
{"output": ..., "error": traceback or ""}.
"""

import contextlib
import io
import json
import subprocess
import sys
import traceback
from pathlib import Path


class DjangoShell:
    """The test's end of the process."""

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
        """Run code and return its output; AssertionError with the traceback of an exception."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write(json.dumps(code) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"the Django shell has ended (exit code {self._process.wait()})"
        answer: dict[str, str] = json.loads(line)
        assert not answer["error"], answer["error"]
        return answer["output"]

    def close(self) -> None:
        self._process.communicate()  # the end of its input is its end


def main() -> None:
    """Answer until the input ends; no database connection is kept, as a test may replace it."""
    import django

    django.setup()
    from django.db import connections

    answers = sys.stdout
    for line in sys.stdin:
        output, error = io.StringIO(), ""
        with contextlib.redirect_stdout(output):
            try:
                exec(compile(json.loads(line), "<code of a test>", "exec"), {})
            except Exception:  # of any kind, by a test's own code: its answer
                error = traceback.format_exc()
        connections.close_all()
        answers.write(json.dumps({"output": output.getvalue(), "error": error}) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
