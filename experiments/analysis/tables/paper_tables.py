"""Tables 1, 3, 4 and 5 of the paper (Melendez-Fernandez et al., 2017), from a dataset."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from experiments.analysis.statistics.descriptive import ROUNDED, shares, spread
from experiments.analysis.tables.response_selection import counted, note
from experiments.analysis.tables.scored_responses import coded
from experiments.analysis.tables.table import Table, TableCell, amount, count, number, words
from experiments.dataset.records import Dataset, ResponseRecord
from sessions.devices import OTHER
from surveys.answers import Missing
from surveys.definition import Definition
from surveys.likert import LikertRow, likert_table

SYSTEMS = ("Windows", "Linux", "Mac OS", "Android", "iOS")
BROWSERS = ("Chrome", "Firefox", "Chromium", "Opera")
INTERVALS = {
    "normal": (
        "CI: half-width of the confidence interval of the mean by the normal distribution, c·SD/√n."
    ),
    "t": (
        "CI: half-width of the confidence interval of the mean by Student's t distribution,"
        " c·SD/√n."
    ),
}
OVERALL = "Overall"
REVERSED = "reversed: answers are counted from the other end of the scale, in all rows."


def table_1(dataset: Dataset) -> Table:
    """Return the robots of the study's conditions, and any other that was driven, a column each,
    with what is told of them. A robot for practice alone is none of them.
    """
    wanted = {one.robot for one in dataset.study.conditions}
    own = [one.name for one in dataset.robots if one.series in wanted]
    robots = [
        dataset.robot(name)
        for name in dict.fromkeys([*own, *(one.robot for one in dataset.sessions)])
    ]
    driven = {
        robot.name: tuple(one.id for one in dataset.sessions if one.robot == robot.name)
        for robot in robots
    }
    facts = list(dict.fromkeys(name for robot in robots for name in robot.facts))
    rows = [
        (words(name), *(words(robot.facts.get(name, "–")) for robot in robots)) for name in facts
    ]
    rows.append(
        (
            words("Sessions"),
            *(count(len(driven[robot.name]), driven[robot.name]) for robot in robots),
        )
    )
    return Table(
        "table-1", "The telepresence robots.", ("", *(robot.title for robot in robots)), tuple(rows)
    )


def table_3(dataset: Dataset) -> Table:
    """Return the sessions by operating system and browser: the paper's rows and columns, any other
    that was found, and what is unknown.
    """
    found = [(one.os or OTHER, one.browser or OTHER, one.id) for one in dataset.sessions]
    systems = _with_others(SYSTEMS, (system for system, _, _ in found))
    browsers = _with_others(BROWSERS, (browser for _, browser, _ in found))

    def cell(system: str | None, browser: str | None) -> TableCell:
        ids = [one for s, b, one in found if system in {s, None} and browser in {b, None}]
        return count(len(ids), ids)

    rows = [
        (words(system), *(cell(system, browser) for browser in browsers), cell(system, None))
        for system in systems
    ]
    rows.append((words("all"), *(cell(None, browser) for browser in browsers), cell(None, None)))
    networks = len({one.network for one in dataset.sessions if one.network})
    people = len({one.participant for one in dataset.sessions})
    below = (
        f"{amount(people, 'participant')}, {amount(len(found), 'session')},"
        f" {amount(networks, 'different network')}. OS: operating system."
    )
    return Table(
        "table-3",
        "OSs and web browsers used to access the system (sessions).",
        ("OS", *browsers, "all"),
        tuple(rows),
        (below,),
    )


def _with_others(known: tuple[str, ...], found: Iterable[str]) -> tuple[str, ...]:
    counts = Counter(found)
    more = sorted(name for name in counts if name not in known and name != OTHER)
    return (*known, *more, OTHER) if counts[OTHER] else (*known, *more)


def table_4(dataset: Dataset) -> Table:
    """Return the statements of the final questionnaire, by topic."""
    definition = dataset.questionnaire(dataset.study.analysis.statements)
    title = "Questions answered by the visitors after the experience."
    head = ("Topic", "", "Statement")
    if definition is None:
        return Table("table-4", title, head, ())
    topics = {key: dataset.say(topic.text) for topic in definition.topics for key in topic.items}
    rows = tuple(
        (
            words(topics.get(one.key, "")),
            words(_statement(one.key, is_reversed=one.key in definition.reversed)),
            words(dataset.say(one.text)),
        )
        for one in definition.questions()
        if one.points
    )
    labels = (f"{signed(value)}: {label}" for value, label in scale_of(dataset).items() if label)
    return Table("table-4", title, head, rows, (f"{'; '.join(labels)}.",))


def lines_of(
    dataset: Dataset, condition: str | None = None
) -> tuple[list[LikertRow], list[ResponseRecord]]:
    """Return the rows of Table 5 and the responses that count in it, reverse-coded answers counted
    from the other end; no rows without a questionnaire of statements.
    """
    definition = dataset.questionnaire(dataset.study.analysis.statements)
    responses = coded(dataset, counted(dataset, dataset.study.analysis.statements, condition))
    if definition is None or definition.scoring != "likert":
        return [], responses
    said = [_on_the_scale(definition, one) for one in responses]
    return (
        likert_table(
            definition,
            said,
            language=dataset.language,
            interval=dataset.study.analysis.interval,
            overall=OVERALL,
        ),
        responses,
    )


def _on_the_scale(definition: Definition, response: ResponseRecord) -> dict[str, int | None]:
    return {one.key: response.values.get(one.key) for one in definition.questions() if one.points}


def table_5(dataset: Dataset, condition: str | None = None) -> Table:
    """Return the summary of the final questionnaire, of all sessions or of those
    of one condition.
    """
    lines, responses = lines_of(dataset, condition)
    scale = tuple(scale_of(dataset))
    head = ("", *(f"% {signed(value)}" for value in scale), "n", "Mean", "SD", "CI95", "CI99")
    head = (*head, "Median", "IQR")
    rows = tuple(_summary_row(line, responses, scale) for line in lines)
    below = (
        note(dataset, responses),
        *counted_in(responses),
        INTERVALS[dataset.study.analysis.interval],
        ROUNDED,
        *([REVERSED] if any(line.is_reversed for line in lines) else ()),
        *_not_applicable(lines, responses),
    )
    suffix = f"-{condition}" if condition else ""
    title = "Summary of final questionnaire responses" + (
        f", condition {condition}." if condition else "."
    )
    return Table(f"table-5{suffix}", title, head, rows, below)


def counted_in(responses: Sequence[ResponseRecord]) -> Iterator[str]:
    """Say what n and the numbers beside it are made of: responses, which are no participants where
    one participant gave several.
    """
    several = len(responses) > len({one.participant for one in responses})
    yield (
        "n: responses that answer at least one of the row's statements, "
        + ("several of one participant among them." if several else "one a participant.")
    )
    yield (
        "Percentages of all answers to the row's statements; mean, SD, CI, median and IQR (third"
        " less first quartile) of n values, a response's value being the mean of its answers to"
        " them."
    )
    if several:
        yield (
            "The CI takes the n responses as independent of each other. Those of one participant"
            " are not, so this is no interval for participants; tests have one value a participant"
            " and condition."
        )


def _not_applicable(
    lines: Sequence[LikertRow], responses: Sequence[ResponseRecord]
) -> tuple[str, ...]:
    """Return how often "Does not apply" was answered to the statements; nothing when never."""
    keys = {key for line in lines for key in line.statements}
    times = sum(one.missing.get(key) == Missing.NOT_APPLICABLE for one in responses for key in keys)
    return (f"Answers “Does not apply”: {times}; they count as missing.",) if times else ()


def scale_of(dataset: Dataset) -> dict[int, str]:
    """Return the values of the scale of the statements with their labels; none without a
    questionnaire.
    """
    definition = dataset.questionnaire(dataset.study.analysis.statements)
    scales = (one.points for one in definition.questions() if one.points) if definition else ()
    return {point.value: dataset.say(point.label) for point in next(iter(scales), ())}


def behind(line: LikertRow, responses: Sequence[ResponseRecord]) -> tuple[str, ...]:
    """Return the sessions whose answers a row of Table 5 is made of."""
    return behind_statements(line.statements, responses)


def behind_statements(
    statements: Sequence[str], responses: Sequence[ResponseRecord]
) -> tuple[str, ...]:
    """Return the sessions in which one of some statements was answered."""
    return tuple(
        one.session
        for one in responses
        if one.session and any(one.values.get(key) is not None for key in statements)
    )


def said(
    line: LikertRow, responses: Sequence[ResponseRecord], values: Sequence[int]
) -> tuple[str, ...]:
    """Return the sessions in which one of some values was answered to one of a row's statements."""
    return tuple(
        one.session
        for one in responses
        if one.session and any(one.values.get(key) in values for key in line.statements)
    )


def label_of(line: LikertRow) -> str:
    """Return what a row of Table 5 is called: statements by their key, as in Table 4."""
    if line.kind != "statement":
        return line.label
    return _statement(line.key, is_reversed=line.is_reversed)


def _statement(key: str, *, is_reversed: bool) -> str:
    return f"{key.upper()} (reversed)" if is_reversed else key.upper()


def _summary_row(
    line: LikertRow, responses: Sequence[ResponseRecord], scale: Sequence[int]
) -> tuple[TableCell, ...]:
    found, about = line.summary, behind(line, responses)
    parts = shares(found.counts) or (None,) * len(scale)
    cells = [
        number(part, 1, said(line, responses, (value,)))
        for part, value in zip(parts, scale, strict=True)
    ]
    ranked = spread(respondent_scores(responses, line.statements))
    numbers = (found.mean, found.sd, found.ci95, found.ci99, ranked.median, ranked.iqr)
    return (
        words(label_of(line)),
        *cells,
        count(found.respondents, about),
        *(number(value, 2, about) for value in numbers),
    )


def respondent_scores(
    responses: Sequence[ResponseRecord], statements: Sequence[str]
) -> list[float]:
    """Return the score of each response: the mean of its answers to some statements."""
    given = (
        [value for key in statements if (value := one.values.get(key)) is not None]
        for one in responses
    )
    return [math.fsum(values) / len(values) for values in given if values]


def signed(value: float) -> str:
    """Return a value of a scale with its sign, as the paper prints it."""
    return f"+{value:g}" if value > 0 else f"{value:g}".replace("-", "−")
