"""Tables 1, 3, 4 and 5 of Melendez-Fernandez et al. (2017), and Table 5 by condition."""

import math
from collections.abc import Iterable, Iterator, Sequence

from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.descriptive import ROUNDED, shares, spread
from experiments.analysis.tables import comparisons
from experiments.analysis.tables.scored_responses import DISTRIBUTIONS, RULES, coded, counted, note
from experiments.analysis.tables.table import Cells, Table, amount, count, number, session_count
from experiments.dataset.records import Dataset, ResponseRecord
from experiments.definition.factors import layout_of
from sessions.devices import OTHER
from surveys.answers import Missing
from surveys.likert import LikertRow, likert_table

SYSTEMS = ("Windows", "Linux", "Mac OS", "Android", "iOS")
BROWSERS = ("Chrome", "Firefox", "Chromium", "Opera")
OVERALL = "Overall"
REVERSED = "reversed: answers are counted from the other end of the scale, in all rows."


def table_1(dataset: Dataset) -> Table:
    """Return facts about the robots of conditions, and of others that were driven in drives that
    count.
    """
    wanted = {one.robot for one in dataset.study.conditions}
    own = [one.name for one in dataset.robots if one.series in wanted]
    used = [one.robot for one in dataset.sessions]
    robots = [dataset.robot(name) for name in dict.fromkeys([*own, *used])]
    facts = dict.fromkeys(name for robot in robots for name in robot.facts)
    rows = [(name, *(robot.facts.get(name, "–") for robot in robots)) for name in facts]
    sessions = (
        session_count([one.id for one in dataset.sessions if one.robot == robot.name])
        for robot in robots
    )
    head = ("", *(robot.title for robot in robots))
    return Table.of("table-1", "The telepresence robots.", head, [*rows, ("Sessions", *sessions)])


def table_3(dataset: Dataset) -> Table:
    """Return the sessions by operating system and browser: the paper's, others, unknown ones."""
    found = [(one.os or OTHER, one.browser or OTHER, one.id) for one in dataset.sessions]
    systems = _with_others(SYSTEMS, (system for system, _, _ in found))
    browsers = _with_others(BROWSERS, (browser for _, browser, _ in found))
    rows = []
    for system in (*systems, None):
        own = [(browser, one) for name, browser, one in found if system in {name, None}]
        cells = [[one for name, one in own if name == browser] for browser in browsers]
        rows.append((system or "all", *map(session_count, (*cells, [one for _, one in own]))))
    networks = len({one.network for one in dataset.sessions if one.network})
    people = len({one.participant for one in dataset.sessions})
    below = (
        f"{amount(people, 'participant')}, {amount(len(found), 'session')},"
        f" {amount(networks, 'different network')}. OS: operating system."
    )
    title = "OSs and web browsers used to access the system (sessions)."
    return Table.of("table-3", title, ("OS", *browsers, "all"), rows, (below,))


def _with_others(known: tuple[str, ...], found: Iterable[str]) -> tuple[str, ...]:
    names = set(found)
    more = sorted(names - {*known, OTHER})
    return (*known, *more, OTHER) if OTHER in names else (*known, *more)


def table_4(dataset: Dataset) -> Table:
    definition = dataset.questionnaire(dataset.study.analysis.statements)
    title = "Questions answered by the visitors after the experience."
    head = ("Topic", "", "Statement")
    if definition is None:
        return Table("table-4", title, head, ())
    topics = {key: dataset.say(topic.text) for topic in definition.topics for key in topic.items}
    rows = []
    for one in definition.questions():
        if one.points:
            name = _statement(one.key, is_reversed=one.key in definition.reversed)
            rows.append((topics.get(one.key, ""), name, dataset.say(one.text)))
    labels = (f"{signed(value)}: {label}" for value, label in scale_of(dataset).items() if label)
    return Table.of("table-4", title, head, rows, (f"{'; '.join(labels)}.",))


# --- Table 5 --------------------------------------------------------------------------------------


def lines_of(
    dataset: Dataset, condition: str | None = None
) -> tuple[list[LikertRow], list[ResponseRecord]]:
    """Return the rows of Table 5 and the responses that count in it; reverse-coded answers are
    counted from the other end.
    """
    analysis = dataset.study.analysis
    definition = dataset.questionnaire(analysis.statements)
    responses = coded(dataset, counted(dataset, analysis.statements, condition))
    if definition is None or definition.scoring != "likert":
        return [], responses
    keys = [one.key for one in definition.questions() if one.points]
    answers = [(one.participant, {key: one.values.get(key) for key in keys}) for one in responses]
    language, interval = dataset.language, analysis.interval
    lines = likert_table(definition, answers, language=language, interval=interval, overall=OVERALL)
    return lines, responses


def table_5(dataset: Dataset, condition: str | None = None) -> Table:
    """Return the summary of the final questionnaire, of all sessions or of one condition."""
    lines, responses = lines_of(dataset, condition)
    scale = tuple(scale_of(dataset))
    head = (
        *("", *(f"% {signed(value)}" for value in scale), "n", "Mean", "SD", "CI95", "CI99"),
        *("Median", "IQR"),
    )
    keys = {key for line in lines for key in line.statements}
    times = sum(one.missing.get(key) == Missing.NOT_APPLICABLE for one in responses for key in keys)
    below = (
        *notes_of(dataset, responses),
        *([REVERSED] if any(line.is_reversed for line in lines) else ()),
        *([f"Answers “Does not apply”: {times}; they count as missing."] if times else ()),
    )
    name, title = "table-5", "Summary of final questionnaire responses"
    if condition:
        name, title = f"{name}-{condition}", f"{title}, condition {condition}"
    rows = (_summary_row(line, responses, scale) for line in lines)
    return Table.of(name, f"{title}.", head, rows, below)


def notes_of(dataset: Dataset, responses: Sequence[ResponseRecord]) -> Iterator[str]:
    """Yield what the numbers count, and the interval."""
    yield note(dataset, responses)
    yield (
        "n: participants who answered at least one of the row's statements. Percentages of all"
        " answers to them; mean, SD, CI, median and IQR (third less first quartile) of n values: a"
        " participant's is the mean of their responses, and a response's that of its answers."
    )
    distribution = DISTRIBUTIONS[dataset.study.analysis.interval]
    yield (
        "CI: half-width of the confidence interval of the mean by"
        f" {distribution} distribution, c·SD/√n."
    )
    yield ROUNDED


def scale_of(dataset: Dataset) -> dict[int, str]:
    """Return the values of the scale of the statements with their labels."""
    definition = dataset.questionnaire(dataset.study.analysis.statements)
    scales = (one.points for one in definition.questions() if one.points) if definition else ()
    return {point.value: dataset.say(point.label) for point in next(iter(scales), ())}


def behind(
    keys: Sequence[str], responses: Sequence[ResponseRecord], values: Sequence[int] | None = None
) -> tuple[str, ...]:
    """Return the sessions in which a statement was answered, or answered with one of `values`."""
    found = []
    for one in responses:
        given = [value for key in keys if (value := one.values.get(key)) is not None]
        if one.session and any(values is None or value in values for value in given):
            found.append(one.session)
    return tuple(found)


def label_of(line: LikertRow) -> str:
    """Return what a row of Table 5 is called: statements by their key, as in Table 4."""
    if line.kind != "statement":
        return line.label
    return _statement(line.key, is_reversed=line.is_reversed)


def _statement(key: str, *, is_reversed: bool) -> str:
    return f"{key.upper()} (reversed)" if is_reversed else key.upper()


def _summary_row(
    line: LikertRow, responses: Sequence[ResponseRecord], scale: Sequence[int]
) -> Cells:
    found, about = line.summary, behind(line.statements, responses)
    parts = zip(shares(found.counts) or (None,) * len(scale), scale, strict=True)
    scores = comparisons.participant_means(_scores(responses, line.statements))
    ranked = spread([*scores.values()])
    numbers = (found.mean, found.sd, found.ci95, found.ci99, ranked.median, ranked.iqr)
    n, shown = count(found.respondents, about), (number(value, 2, about) for value in numbers)
    cells = (number(part, 1, behind(line.statements, responses, (value,))) for part, value in parts)
    return label_of(line), *cells, n, *shown


def _scores(
    responses: Sequence[ResponseRecord], statements: Sequence[str]
) -> Iterator[tuple[str, float]]:
    """Yield the participant and the mean answer of each response to one of some statements."""
    for one in responses:
        given = [value for key in statements if (value := one.values.get(key)) is not None]
        if given:
            yield one.participant, math.fsum(given) / len(given)


def signed(value: float) -> str:
    """Return a value of a scale with its sign, as the paper prints it."""
    return f"+{value:g}" if value > 0 else f"{value:g}".replace("-", "−")


def compare_answers(dataset: Dataset) -> Table:
    """Return every row of Table 5 by condition, with a test of the difference."""
    found = {one.key: lines_of(dataset, one.key) for one in dataset.study.conditions}
    found = {key: own for key, own in found.items() if own[1]}
    lines = next((lines for lines, _ in found.values()), [])
    is_paired = layout_of(dataset.study, [{key} for key in found]).is_paired
    rows = []
    for line in lines:
        keys = line.statements
        groups = {
            key: comparisons.ComparedSide(
                comparisons.participant_means(_scores(own, keys)), behind(keys, own)
            )
            for key, (_, own) in found.items()
        }
        values = {key: group.values for key, group in groups.items()}
        rows.append((label_of(line), (compare(values, is_paired=is_paired), [*groups.values()])))
    scores = "A participant's score is the mean of their answers. IQR: third less first quartile."
    topics = "A topic of one statement is the same test as the statement."
    notes = (RULES[dataset.study.analysis.counts], scores, topics)
    title = "Final questionnaire by condition."
    return comparisons.comparison_table("answers", title, "", [*found], rows, notes)
