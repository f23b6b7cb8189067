"""Ages of commands and video by condition, and what the robot's safety limits did to commands."""

from collections.abc import Iterator, Mapping, Sequence

from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.table import Table, count, number, people_in, session_count
from experiments.dataset.records import Dataset
from experiments.definition.schema import Condition
from robots.api.network_words import spell

# (median, 95th percentile) of a session, by the head of the column.
AGES = {
    "Command": ("command_age_median", "command_age_p95"),
    "Video on the page": ("frame_age", "frame_age_p95"),
    "Video at the wheels": ("answer_age", "answer_age_p95"),
}
AGES_NOTES = (
    "Ages in seconds: the medians over sessions of each session's median and 95th percentile.",
    (
        "Command: from the visitor's hand to the wheels. Video on the page: from the camera to"
        " the eyes; at the wheels: from the camera over both."
    ),
    (
        "Networks: what the condition puts on them; delay and jitter in ms, loss and reorder in %,"
        " rate in kbit/s."
    ),
)
SHARES = {"% refused": "share_refused", "% too old": "share_too_old", "% slowed": "share_slowed"}
VALUES = {
    "Asked (m/s)": "asked_speed",
    "Allowed (m/s)": "allowed_speed",
    "Applied (m/s)": "applied_speed",
    "Command age (s)": "command_age_median",
    "Command age, p95 (s)": "command_age_p95",
}
NOTABLE = 0.05  # of the commands: fewer are slowed or refused on any network now and then
LIMITS_NOTE = (
    "Means over sessions; too old: refused because the command, or the video frame that it "
    "answered, was too old; slowed: applied with less speed than asked for, because of such an age."
)
_PARTS = ((0.9, "nearly all"), (0.6, "most"), (0.4, "half"), (0.27, "a third"), (0.15, "a fifth"))


def ages(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    rows = []
    for condition, own in _by_condition(dataset, measured):
        sessions = [one.session for one in own]
        ids = [one.id for one in sessions]
        medians = (
            number(spread([one.values[name] for one in own]).median, 3, ids)
            for names in AGES.values()
            for name in names
        )
        network = condition.network
        networks = (spell(one) or "clean" for one in (network.control, network.video))
        rows.append((condition.key, *networks, people_in(sessions), session_count(ids), *medians))
    head = ("Condition", "Network to the robot", "Network back", "Participants", "Sessions")
    heads = (*head, *(f"{name}, {what}" for name in AGES for what in ("median", "p95")))
    return Table.of("ages", "Ages of commands and video.", heads, rows, AGES_NOTES)


def _by_condition(
    dataset: Dataset, measured: Sequence[Measured]
) -> Iterator[tuple[Condition, list[Measured]]]:
    for condition in dataset.study.conditions:
        yield condition, [one for one in measured if one.session.condition == condition.key]


def safety_limits(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return what the limits did by condition; notes name conditions in which this is visible."""
    rows, findings = [], list[str]()
    for condition, own in _by_condition(dataset, measured):
        ids = [one.session.id for one in own]
        wanted = (*SHARES.values(), *VALUES.values())
        means = {name: spread([one.values[name] for one in own]).mean for name in wanted}
        commands = sum(int(one.values["commands"]) for one in own if one.values["commands"] > 0)
        shares = (means[name] for name in SHARES.values())
        percentages = (number(None if one is None else 100.0 * one, 1, ids) for one in shares)
        values = (number(means[name], 3, ids) for name in VALUES.values())
        cells = (session_count(ids), count(commands, ids), *percentages, *values)
        rows.append((condition.key, *cells))
        findings += _manipulation_check(dataset.say(condition.title) or condition.key, means)
    title = "Commands and the robot's safety limits."
    head = ("Condition", "Sessions", "Commands", *SHARES, *VALUES)
    return Table.of("safety-limits", title, head, rows, (LIMITS_NOTE, *findings))


def _manipulation_check(title: str, means: Mapping[str, float | None]) -> Iterator[str]:
    effects = []
    for act, name in (("slowed", "share_slowed"), ("refused", "share_too_old")):
        share = means[name] or 0.0
        if share >= NOTABLE:
            part = next((part for least, part in _PARTS if share >= least), "some")
            effects.append(f"{act} {part} ({100.0 * share:.0f} %) of the commands")
    if effects:
        yield (
            f"With “{title}”, the robot {' and '.join(effects)}: this condition measured the"
            " safety limits as well as delay."
        )
