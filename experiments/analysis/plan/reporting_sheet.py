"""The facts that a report on human-robot interaction must state, filled from the data."""

import math
from collections import Counter
from collections.abc import Collection, Iterator, Sequence

from experiments.analysis.metrics.definitions import VERSION
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.plan.preregistration import before_data
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.people import (
    COUNTED,
    NOT_REPORTED,
    answer_groups,
    counted_by_kind,
)
from experiments.analysis.tables.scored_responses import counted
from experiments.analysis.tables.table import NOTHING, Table, amount, spoken
from experiments.dataset.exclusions import excluded_participants
from experiments.dataset.levels import ASSISTANCE, BY_HAND, REPLACED, UNCOUNTED
from experiments.dataset.records import COMPLETED, Dataset, ParticipantRecord
from experiments.definition.plan import hypotheses_of

NAME = "reporting-sheet"
UNKNOWN = "unknown"
EVERYBODY = "who joined and neither withdrew nor are excluded by the plan"
DROVE = ("drove", "ended", "answered")  # stages that are kept of participants who withdrew
SEX = ("sex", "gender")  # items of the registration that ask for it
LATENCIES = {  # metrics of a session: median and 95th percentile
    "Age of commands at the wheels": ("command_age_median", "command_age_p95"),
    "Age of video on the page": ("frame_age", "frame_age_p95"),
}
ROBOT_FACTS = {
    "model": "Base",
    "control architecture": "Robot control architecture",
    "footprint (m)": "Size (m)",
    "greatest speed (m/s)": "Greatest speed (m/s)",
    "software of the agent": "Agent",
}
ACTIONS = {
    "places": "goes to named places by itself",
    "map": "goes to points of the map by itself",
    "follow": "follows routes by itself",
    "dock": "docks by itself",
    "undock": "undocks by itself",
}
Line = tuple[str, str, str]  # section, item, value


def reporting_sheet(
    dataset: Dataset, measured: Sequence[Measured], everybody: Sequence[ParticipantRecord]
) -> Table:
    """Return the sheet of a dataset of what counts; `everybody` has the participants of the whole
    one.
    """
    parts = (_autonomy, _failures, _exclusions, _deviations, _versions)
    lines = (
        ("Participants", "in the dataset", counted_by_kind(everybody, "participant")),
        ("Participants", "in this sheet", counted_by_kind(dataset.participants) or "nobody"),
        *_participants(dataset),
        *_robots(dataset, measured),
        *(line for part in parts for line in part(dataset)),
    )
    rows, last = [], ""
    for section, item, value in lines:
        rows.append(("" if section == last else section, item, value))
        last = section
    note = "Unknown: neither the study's definition nor its data say."
    return Table.of(NAME, "Reporting sheet.", ("Topic", "Item", "Value"), rows, (note,))


def as_markdown(table: Table) -> str:
    lines = [f"# {table.title.removesuffix('.')}", ""]
    for topic, item, value in table.rows:
        if topic.text:
            lines += ["", f"## {topic.text}", ""]
        lines.append(f"- {item.text}: {' '.join(value.text.split())}")
    return "\n".join((*lines, "", *table.notes, ""))


# --- participants ---------------------------------------------------------------------------------


def _participants(dataset: Dataset) -> Iterator[Line]:
    people, study = dataset.participants, dataset.study
    staying = [one for one in people if not one.withdrawn]
    drivers = {one.participant for one in (*dataset.sessions, *dataset.others) if one.drove}
    drivers |= {one.id for one in people if one.withdrawn and one.stage in DROVE}
    items = {
        "joined": len(people),
        "drawn anew, before they were exposed": sum(one.draws > 1 for one in people),
        "replaced by others": sum(one.place == REPLACED for one in people),
        "withdrew": len(people) - len(staying),
        "drove a robot": len(drivers),
        "finished": sum(one.finished for one in staying),
        COUNTED: len(_drivers(dataset)),
        "drives that count": len(dataset.sessions),
        **dict(_demography(dataset)),
        "recruitment": study.recruitment or UNKNOWN,
        "compensation": study.compensation or UNKNOWN,
    }
    for item, value in items.items():
        yield "Participants", item, str(value)


def _drivers(dataset: Dataset) -> set[str]:
    return {one.participant for one in dataset.sessions}


def _demography(dataset: Dataset) -> Iterator[tuple[str, str]]:
    """Yield age and sex, of those whose drives the results have and of everybody."""
    drivers, everybody = _drivers(dataset), {one.id: one.age for one in dataset.included}
    for who, some in ((COUNTED, drivers & everybody.keys()), (EVERYBODY, everybody.keys())):
        yield f"age, of those {who}", _ages([everybody[one] for one in some])
        yield f"sex or gender, of those {who}", _sexes(dataset, some)


def _ages(ages: Sequence[float]) -> str:
    known = [age for age in ages if not math.isnan(age)]
    about = spread(known)
    if about.mean is None:
        return UNKNOWN
    sd = NOTHING if about.sd is None else f"{about.sd:.1f}"
    missing = f"; {len(ages) - len(known)} {NOT_REPORTED}" if len(known) < len(ages) else ""
    bounds = f"{min(known):.0f} to {max(known):.0f}"
    return f"n = {len(known)}, M = {about.mean:.1f}, SD = {sd}, {bounds}{missing}"


def _sexes(dataset: Dataset, some: Collection[str]) -> str:
    """Return how often some participants gave each answer to the question for it."""
    definition = dataset.questionnaire(dataset.registration)
    asked = [one for one in definition.questions() if one.key in SEX] if definition else []
    if not asked:
        return f"{UNKNOWN}: not asked"
    groups, _ = answer_groups(dataset, asked[0], counted(dataset, dataset.registration))
    found = ((label, len({*ids} & {*some})) for label, ids in groups)
    return ", ".join(f"{label}: {n}" for label, n in found if n) or UNKNOWN


# --- the robot ------------------------------------------------------------------------------------


def _robots(dataset: Dataset, measured: Sequence[Measured]) -> Iterator[Line]:
    in_use = {one.robot for one in dataset.sessions}
    for robot in dataset.robots:
        if in_use and robot.name not in in_use:
            continue
        section = f"Robot {robot.title}"
        yield section, "make", UNKNOWN
        for item, fact in ROBOT_FACTS.items():
            value = robot.facts.get(fact, NOTHING)
            yield section, item, UNKNOWN if value == NOTHING else value
        own = [one for one in measured if one.session.robot == robot.name]
        for item, names in LATENCIES.items():
            yield section, item, _latency(own, names)
    if not dataset.robots:
        yield "Robot", "model", UNKNOWN


def _latency(measured: Sequence[Measured], names: tuple[str, str]) -> str:
    median, p95 = (spread([one.values[name] for one in measured]).median for name in names)
    if median is None:
        return f"{UNKNOWN}: not measured"
    known = sum(not math.isnan(one.values[names[0]]) for one in measured)
    high = "" if p95 is None else f", 95th percentile {1000.0 * p95:.0f} ms"
    return f"median {1000.0 * median:.0f} ms{high} (medians over {amount(known, 'drive')})"


def _autonomy(dataset: Dataset) -> Iterator[Line]:
    for one in dataset.study.conditions:
        own = [ACTIONS[action] for action in one.actions if action in ACTIONS]
        value = "; ".join((ASSISTANCE[one.assist], *own))
        yield "Autonomy by condition", dataset.say(one.title) or one.key, value


# --- failures and deviations ----------------------------------------------------------------------


def _failures(dataset: Dataset) -> Iterator[Line]:
    section, sessions = "Failures", (*dataset.sessions, *dataset.others)
    ended = Counter((one.outcome, one.fault_side) for one in sessions if one.outcome)
    if not ended:
        yield section, "outcomes", f"{UNKNOWN}: no drive has ended"
    for (outcome, side), n in sorted(ended.items()):
        by = "" if outcome == COMPLETED or not side else f", side: {side}"
        yield section, f"{spoken(outcome)}{by}", amount(n, "drive")
    if running := sum(not one.outcome for one in sessions):
        yield section, "without an outcome", amount(running, "drive")
    for code, n in sorted(Counter(one.counts_why for one in dataset.others).items()):
        yield "Drives that do not count", UNCOUNTED[code], amount(n, "drive")


def _exclusions(dataset: Dataset) -> Iterator[Line]:
    section, found = "Exclusions", dataset.exclusions
    if not found:
        yield section, "excluded", "nobody"
    if people := excluded_participants(found):
        yield section, "excluded by the plan's rules", amount(len(people), "participant")
    of_drives = {one.rule for one in found if one.session}
    for rule, n in sorted(Counter(one.rule for one in found).items()):
        yield section, rule, amount(n, "drive" if rule in of_drives else "case")


def _deviations(dataset: Dataset) -> Iterator[Line]:
    section, freeze, plan = "Deviations from the plan", dataset.freeze, dataset.study.plan
    if plan is None:
        yield section, "plan", "none was declared: every analysis is exploratory"
    else:
        yield section, "plan frozen before data", before_data(freeze)
        wanted = UNKNOWN if plan.participants is None else str(plan.participants)
        yield section, "planned participants", wanted
        yield section, f"participants {COUNTED}", str(len(_drivers(dataset)))
        others = [one.key for one in dataset.study.analyses if not hypotheses_of(plan, one)]
        if others:
            yield section, "analyses without a hypothesis (exploratory)", ", ".join(others)
    by_hand = sum(one.rule == BY_HAND for one in dataset.exclusions)
    yield section, "exclusions by hand, outside of the rules", str(by_hand)
    mismatched = sum(bool(one.mismatch) for one in dataset.sessions)
    yield section, "drives whose condition was not applied as assigned", str(mismatched)
    stated = freeze.deviations.strip() if freeze is not None else ""
    yield section, "stated by the researchers", stated or f"{UNKNOWN}: they have stated nothing"


def _versions(dataset: Dataset) -> Iterator[Line]:
    study, checksum, frozen, software = dataset.study, UNKNOWN, UNKNOWN, UNKNOWN
    if dataset.freeze is not None:
        checksum, software = dataset.freeze.sha256, dataset.freeze.software or UNKNOWN
        frozen = dataset.freeze.frozen_at or "no: a draft, which may still change"
    asked = ", ".join(f"{one.slug} {one.version}" for one in dataset.questionnaires)
    items = {
        "study": f"{study.slug} {study.version}",
        "SHA-256 of the definition": checksum,
        "definition frozen": frozen,
        "questionnaires": asked or UNKNOWN,
        "software of the server": software,
        "definitions of the metrics": str(VERSION),
    }
    yield from (("Versions", item, value) for item, value in items.items())
