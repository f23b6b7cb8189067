"""`manage.py compare_codings SCHEME FILE FILE …`: how well coders of one session agree."""

from argparse import ArgumentParser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
from django.core.management.base import BaseCommand, CommandError

from experiments.coding import agreement
from experiments.coding.agreement import CodeReliability, EventReliability, ReliabilityEstimate
from experiments.coding.reading import read_coding
from experiments.coding.scheme import BadCodingError, CodedEvent, events_from, scheme_in
from experiments.definition.coding import Code

MAX_FILE = 20 * 1024 * 1024


class Command(BaseCommand):
    help = (
        "Compare codings of one session, a file for each coder (ELAN .eaf or BORIS .boris): "
        "Cohen's kappa of each pair and Krippendorff's alpha of all, for each code."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        add("scheme", type=Path, help="the codes as JSON")
        add("files", type=Path, nargs="+", help="a file for each coder")
        add("--bin", type=float, default=1.0, help="width of a bin, s")
        text = "most seconds between the starts of two events that match"
        add("--tolerance", type=float, default=0.5, help=text)
        add("--duration", type=float, help="length of the session, s; default: the last event")
        text = "the observation to read from BORIS projects that have several"
        add("--observation", default="", help=text)

    def handle(self, *_args: Any, **options: Any) -> None:
        files = list(dict.fromkeys(options["files"]))
        if len(files) < 2:
            raise CommandError("Give a file for each of at least two coders.")
        with _naming(options["scheme"]):
            codes = scheme_in(_bytes(options["scheme"])).codes
        read = [self._read(path, codes, options["observation"]) for path in files]
        last = max((one.end or one.begin for some in read for one in some), default=0.0)
        duration = last if options["duration"] is None else options["duration"]
        codings = []
        for path, events in zip(files, read, strict=True):
            with _naming(path):
                codings.append(events_from(msgspec.to_builtins(events), codes, duration))
        width, within = options["bin"], options["tolerance"]
        keys, sessions = [code.code for code in codes], [(duration, codings)]
        try:
            found = agreement.reliability(sessions, keys, width=width, tolerance=within)
        except ValueError as error:
            raise CommandError(f"--bin: {error}.") from error
        self.stdout.write(
            f"{duration:g} s in bins of {width:g} s; events match within {within:g} s"
        )
        names = [path.name for path in files]
        lines = [line for one in found.codes for line in _code_lines(one, names)]
        lines += [line for pair in found.events for line in _event_lines(pair, names)]
        self.stdout.write("\n".join(lines))

    def _read(self, path: Path, codes: tuple[Code, ...], observation: str) -> list[CodedEvent]:
        document = _bytes(path)
        with _naming(path):
            events, problems = read_coding(document, codes, limit=MAX_FILE, observation=observation)
        for problem in problems:
            self.stdout.write(f"{path.name}: {problem}")
        return events


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Make a BadCodingError a CommandError that names the file."""
    try:
        yield
    except BadCodingError as error:
        raise CommandError(f"{path}: {error}") from error


def _code_lines(one: CodeReliability, names: list[str]) -> Iterator[str]:
    yield f"{one.code or 'all codes'}: alpha {_number(one.alpha)}"
    for pair in one.pairs:
        a, b = (names[place] for place in pair.coders)
        found = pair.matches
        yield (
            f"    {a} and {b}: kappa {_number(pair.kappa)}; agreement {_number(pair.agreement)}; "
            f"events in both: {found.both}, only in {a}: {found.first}, only in {b}: {found.second}"
        )


def _event_lines(pair: EventReliability, names: list[str]) -> Iterator[str]:
    a, b = (names[place] for place in pair.coders)
    yield f"events of {a} (rows) and {b}: kappa {_number(pair.kappa)}"
    heads = [*pair.labels, "none"]
    for head, row in zip(heads, pair.table, strict=True):
        cells = ", ".join(f"{name} {n:.0f}" for name, n in zip(heads, row, strict=True) if n)
        yield f"    {head}: {cells or '–'}"


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            document = file.read(MAX_FILE + 1)
    except OSError as error:
        raise CommandError(f"{error.filename}: {error.strerror}.") from error
    if len(document) > MAX_FILE:
        raise CommandError(f"{path} is larger than {MAX_FILE // 1024**2} MB.")
    return document


def _number(one: ReliabilityEstimate) -> str:
    if one.value is None:
        return "unknown"
    has_interval = one.low is not None and one.high is not None
    return f"{one.value:.3f}" + (f" [{one.low:.3f}, {one.high:.3f}]" if has_interval else "")
