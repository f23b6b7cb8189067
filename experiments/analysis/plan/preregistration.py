"""A study's definition as the text of a preregistration, in Markdown: the questions of the OSF
Preregistration in their order, which include those of AsPredicted. Each is answered from the
definition, or marked as unanswered. An appendix has every number and choice of the definition, with
its defaults.
"""

from collections.abc import Iterable, Iterator, Sequence

import msgspec

from experiments.analysis.metrics.definitions import METRICS, VERSION
from experiments.analysis.tables import response_selection
from experiments.dataset.records import FreezeRecord
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.factors import conditions_together
from experiments.definition.plan import (
    AttentionCheck,
    Hypothesis,
    Speeder,
    StudyPlan,
    hypotheses_of,
    measures_of,
)
from experiments.definition.schema import Allocation, Condition, Course, Impairment, StudyDefinition
from robots.api.network_words import RANGES, spell
from surveys.definition import Definition
from surveys.documents import spoken
from surveys.scoring import ScoredScale, measured_scale, parts_of, scales_of

UNANSWERED = "*Unanswered: the definition of the study does not say.*"
NO_PLAN = "**No plan was declared: every analysis of this study is exploratory.**"
ORDERS = {
    "fixed": "in the order of the definition",
    "all": "in one of all orders",
    "balanced": "in an order of a Latin square (Williams)",
}
TESTS = {
    "means": "paired t tests within participants, Welch's t tests between them; of several"
    " conditions at once, the analysis of variance for repeated measures within (corrected by"
    " Greenhouse and Geisser) and Welch's between",
    "ranks": "Wilcoxon's signed ranks within participants, Mann-Whitney between them; of several"
    " conditions at once, Friedman's test within and Kruskal-Wallis between",
    "proportions": "McNemar's test (mid-p) and Cochran's Q within participants, the N−1 χ² test"
    " between them (Boschloo's where a count of less than 1 is expected)",
    "counts": "Poisson regression of the rate per minute by generalized estimating equations, with"
    " participants as clusters",
    "times": "the log-rank test between participants, Cox's regression with participants as"
    " clusters within them; times that never came are censored at the end of the drive",
    "mixed": "a linear mixed model with an intercept for each participant, by REML; terms in sum"
    " coding, by Wald tests from the residuals of participants (CR2)",
}
MODELS = {
    "mixed": TESTS["mixed"],
    "proportions": "logistic regression by generalized estimating equations, with participants as"
    " clusters; terms in sum coding",
    "counts": f"{TESTS['counts']}; terms in sum coding",
    "times": "Cox's regression with participants as clusters, terms in sum coding; times that never"
    " came are censored at the end of the drive",
}
INCOMPLETE = {
    "keep": "Participants with missing conditions or answers are kept in every test for which they"
    " have values.",
    "drives": "Participants who lack a drive in one of their conditions are excluded.",
    "answers": "Participants who lack a drive in one of their conditions, or a finished"
    " questionnaire of the study, are excluded.",
}
# Fields of a study that are texts, have sections of their own, or are not for the public.
WITHOUT_SETTINGS = frozenset(
    {"format", "slug", "version", "title", "intro", "source", "licence", "recruitment"}
    | {"compensation", "languages", "steps", "factors", "analyses", "plan", "coding", "recruiting"}
)
DRIVES = {
    "first": "Of several such drives of a participant in a condition, the first counts.",
    "last": "Of several such drives of a participant in a condition, the last counts.",
    "all": "Of several such drives of a participant in a condition, all count, and their values are"
    " averaged first.",
}
Answer = tuple[str, Iterable[str]]  # a question, and the paragraphs or lines that answer it


def preregistration(
    study: StudyDefinition,
    freeze: FreezeRecord | None,
    questionnaires: Sequence[Definition] = (),
) -> str:
    """Return the text of a preregistration of a study.

    Args:
        study: its definition.
        freeze: when it was frozen, if that is known.
        questionnaires: those that it asks, as far as they are known.
    """
    lines = [f"# Preregistration: {_say(study, study.title) or study.slug}", ""]
    lines += [*_freeze_lines(study, freeze), ""]
    if study.plan is None:
        lines += [NO_PLAN, ""]
    plan = study.plan or StudyPlan()
    asked = {one.slug: one for one in sorted(questionnaires, key=lambda one: one.version)}
    for section, answers in _sections(study, plan, freeze, asked):
        lines += [f"## {section}", ""]
        for question, given in answers:
            known = [line for line in given if line.strip()]
            lines += [f"### {question}", "", *(known or [UNANSWERED]), ""]
    return "\n".join((*lines, "## Every number and choice", "", *_settings(study), ""))


def _freeze_lines(study: StudyDefinition, freeze: FreezeRecord | None) -> Iterator[str]:
    yield f"Study `{study.slug}`, version {study.version}."
    if freeze is None:
        yield "When the definition was frozen is unknown."
        return
    if not freeze.frozen_at:
        yield "This is a draft: the definition is not frozen and may still change."
        yield f"SHA-256 of the draft: `{freeze.sha256}`."
        return
    yield f"Frozen on {freeze.frozen_at} (SHA-256 of the definition: `{freeze.sha256}`)."
    yield f"Before data: {before_data(freeze)}."


def before_data(freeze: FreezeRecord | None) -> str:
    """Return whether a definition was frozen before there were data, and what limits that."""
    if freeze is not None and not freeze.frozen_at:
        return "no, it is a draft"
    if freeze is None or freeze.before_data is None:
        return "unknown"
    told = (
        "yes, no participant of this version had joined"
        if freeze.before_data
        else "no, a participant of this version had already joined"
    )
    if not freeze.earlier:
        return told
    return f"{told}; but {freeze.earlier} had joined earlier versions, whose data were known"


def _sections(
    study: StudyDefinition,
    plan: StudyPlan,
    freeze: FreezeRecord | None,
    asked: dict[str, Definition],
) -> Iterator[tuple[str, tuple[Answer, ...]]]:
    yield "Study information", _information(study, plan)
    yield "Design plan", _design(study, plan)
    yield "Sampling plan", _sampling(study, plan, freeze)
    yield "Variables", _variables(study, asked)
    yield "Analysis plan", _analysis(study, plan)
    yield "Other", (("Other", [plan.notes, study.source]),)


def _information(study: StudyDefinition, plan: StudyPlan) -> tuple[Answer, ...]:
    return (
        ("Title", [_say(study, study.title)]),
        ("Description", [_say(study, study.intro)]),
        ("Research question", [plan.question]),
        ("Hypotheses", [_hypothesis(study, one) for one in plan.hypotheses]),
    )


def _hypothesis(study: StudyDefinition, one: Hypothesis) -> str:
    analysis = next((it for it in study.analyses if it.key == one.analysis), None)
    if analysis is None:
        return f"- **{one.key}**: {one.text}"
    parts = [
        f"analysis `{analysis.key}`",
        ", ".join(f"`{it}`" for it in measures_of(one, analysis)),
    ]
    if one.contrast is not None and one.contrast <= len(analysis.contrasts):
        parts.append(f"contrast “{_say(study, analysis.contrasts[one.contrast - 1].title)}”")
    if one.effect:
        parts.append(f"effect `{one.effect}`")
    expected = f"Expected: {_direction(study, one, analysis)}."
    return f"- **{one.key}**: {one.text} {expected} Tested by: {'; '.join(parts)}."


def _direction(study: StudyDefinition, one: Hypothesis, analysis: DeclaredAnalysis) -> str:
    """Return the expected direction in words, with the titles of the sides, or of the levels."""
    if one.direction == "different":
        return "a difference, two-sided"
    first, second = "the first side", "the second"
    factor = next((it for it in study.factors if it.key == one.effect), None)
    if factor is not None and len(factor.levels) == 2:
        first, second = (f"“{_say(study, level.title)}”" for level in factor.levels)
    elif one.contrast is not None and one.contrast <= len(analysis.contrasts):
        it = analysis.contrasts[one.contrast - 1]
        first, second = (", ".join(f"`{key}`" for key in keys) for keys in (it.first, it.second))
    word = "greater" if one.direction == "greater" else "smaller"
    return f"{first} is {word} than {second}; tested two-sided"


# --- design and sampling --------------------------------------------------------------------------


def _design(study: StudyDefinition, plan: StudyPlan) -> tuple[Answer, ...]:
    kind = "Experiment: participants are assigned to conditions."
    if len(study.conditions) == 1:
        kind = "Observational study: every participant has the same condition."
    return (
        ("Study type", [kind]),
        ("Blinding", [plan.blinding]),
        ("Study design", list(_study_design(study))),
        ("Randomization", list(_randomization(study))),
    )


def _study_design(study: StudyDefinition) -> Iterator[str]:
    most = max((len(keys) for keys in conditions_together(study)), default=0)
    if len(study.conditions) > 1:
        yield f"A participant does {most} of {len(study.conditions)} conditions."
    for factor in study.factors:
        levels = ", ".join(_say(study, level.title) for level in factor.levels)
        yield f"- Factor `{factor.key}`, {factor.design} participants: {levels}"
    for condition in study.conditions:
        yield f"- Condition `{condition.key}`: {described(study, condition)}"
    for step in study.drives:
        what = "Practice, which counts in no result" if step.is_practice else "Task"
        again = ", once for each condition" if step.repeat else ""
        yield f"- {what}, `{step.key}`: at most {step.minutes:g} minutes{again}."
    if study.task is not None:
        yield (
            "- The time of the task begins with the first video frame that the page shows. It is"
            " completed when all checkpoints were passed in order and the robot has then rested on"
            f" its charging contacts for {study.task.docked_seconds:g} s; a robot without contacts"
            " decides by itself that it is docked."
        )
    yield from (_course(one) for one in study.courses)
    yield from filter(None, [_start(study)])


def _course(course: Course) -> str:
    """Return a course in words; positions are metres of the floor plan."""
    stops = "; ".join(
        f"{one.number or 'station'} at ({one.x:g}, {one.y:g}) within {one.radius:g} m"
        for one in course.checkpoints
    )
    parts = [f"- Course of {course.robot} at {course.site}: {stops}"]
    if course.doors:
        parts.append(f"doors to cross, where open: {', '.join(course.doors)}")
    if course.photo is not None:
        near = f"within {course.photo.radius:g} m of checkpoint {course.photo.checkpoint}"
        parts.append(f"a photo of the robot in the mirror {course.photo.mirror}, {near}")
    if course.zones:
        parts.append(f"zones: {', '.join(zone.name for zone in course.zones)}")
    return "; ".join(parts) + "."


def _start(study: StudyDefinition) -> str:
    start = study.start
    rules = []
    if start.charge > 0.0:
        rules.append(f"its battery has at least {100.0 * start.charge:g} % of its charge")
    if start.docked:
        rules.append(
            f"it is docked within {start.distance:g} m and {start.heading:g} rad of the pose of the"
            " course's station"
        )
    wanted = "; ".join(rules)
    return f"- A drive begins only when this holds of the robot: {wanted}." if wanted else ""


def described(study: StudyDefinition, condition: Condition) -> str:
    """Return what a condition is, in words and numbers."""
    levels = ", ".join(f"{factor} {level}" for factor, level in condition.levels.items())
    parts = [
        _say(study, condition.title),
        levels and f"levels: {levels}",
        f"robot {condition.robot} at {condition.site}",
        f"assistance {condition.assist}",
        f"controllers {', '.join(condition.controllers) or 'none'}",
        condition.actions and f"actions {', '.join(condition.actions)}",
        condition.interface != "standard" and f"page {condition.interface}",
        condition.control_way != "any" and f"commands over {condition.control_way}",
        condition.doors_closed and f"closed {', '.join(condition.doors_closed)}",
        condition.speed.linear is not None and f"at most {condition.speed.linear:g} m/s",
        condition.speed.angular is not None and f"at most {condition.speed.angular:g} rad/s",
        _network("network to the robot, one way", condition.network.control),
        _network("network back with the video, one way", condition.network.video),
        condition.idle_seconds
        and f"asked whether they are there after {condition.idle_seconds:g} s",
        condition.access == "invitation" and "by invitation",
    ]
    parts.extend(
        f"pages {', '.join(map(str, pages))} of the instructions `{step.key}`, for some conditions"
        " only"
        for step in study.steps
        if (pages := step.own_pages(condition.key))
    )
    return "; ".join(part for part in parts if part)


def _network(what: str, impairment: Impairment | None) -> str:
    units = {"milliseconds": "ms", "percent": "%"}
    words = []
    for part in filter(None, spell(impairment).split(",")):
        name, _, value = part.partition("=")
        words.append(f"{name} {value} {units.get(RANGES[name][2], RANGES[name][2])}")
    return f"{what}: {', '.join(words)}" if words else ""


def _randomization(study: StudyDefinition) -> Iterator[str]:
    allocation, refill = study.allocation, study.refill
    if len(study.conditions) == 1:
        yield "None: there is one condition."
        return
    when = (
        "Before reading instructions that depend on the condition"
        if study.tells_condition
        else "On first getting the robot"
    )
    yield (
        f"{when}, a participant is assigned to the cell with the fewest places filled or in"
        f" progress with probability {allocation.best_probability:g}, otherwise to one of the"
        " others; ties and chance follow from a seed that is kept."
    )
    if allocation.balance:
        yield _balance(allocation)
    if study.reveals_condition:
        yield "A participant keeps the cell: the page shows something of it before any video."
    else:
        yield (
            "A participant who was not exposed gives the place back and is drawn anew on getting"
            " the robot again; every draw is reported, and the participant counts in the cell of"
            " the drive that counts."
        )
    if allocation.design == "within":
        yield f"Conditions are done {ORDERS[allocation.order]}."
        yield (
            "A participant who was not seen for"
            f" {allocation.left_after_hours:g} hours before the last condition has left: another"
            " participant gets the order."
        )
    yield _replacement(refill.outcomes, refill.most)


def _balance(allocation: Allocation) -> str:
    factors = [
        f"{one.item} (from {', '.join(f'{limit:g}' for limit in one.limits)})"
        if one.limits
        else one.item
        for one in allocation.balance
    ]
    alike = (
        "each of these factors, added up (minimization)"
        if allocation.balancing == "minimization"
        else "all of these factors (strata)"
    )
    return f"Places count of participants alike in {alike}: {', '.join(factors)}."


def _replacement(outcomes: Sequence[str], most: int) -> str:
    if not (outcomes and most):
        return "Exposed participants are not replaced."
    named = ", ".join(one.replace("_", " ") for one in outcomes)
    return (
        f"Exposed participants whose task ended so are replaced, at most {most} times in each cell:"
        f" {named}. They stay in the flow, and their drives count as those of others."
    )


def _sampling(
    study: StudyDefinition, plan: StudyPlan, freeze: FreezeRecord | None
) -> tuple[Answer, ...]:
    quota = study.allocation.quota
    size = [f"{plan.participants} complete cases."] if plan.participants is not None else []
    size += [f"At most {quota} participants in each cell."] if quota is not None else []
    has_started = freeze is not None and bool(freeze.frozen_at)
    existing = f"Frozen before data: {before_data(freeze)}." if has_started else ""
    return (
        ("Existing data", [existing]),
        (
            "Data collection procedures",
            [study.recruitment, study.compensation, *_eligibility(study)],
        ),
        ("Sample size", size),
        ("Sample size rationale", [plan.rationale, *_expected(plan)]),
        ("Stopping rule", [plan.stopping]),
    )


def _eligibility(study: StudyDefinition) -> Iterator[str]:
    """Yield who cannot take part, by age, device and answers."""
    if study.consent is not None:
        minors = "need a guardian" if study.consent.minors == "guardian" else "cannot take part"
        yield f"- Participants younger than {study.consent.minimum_age} {minors}."
    for what, named in (("devices", study.devices), ("browsers", study.browsers)):
        if named:
            yield f"- Only with these {what}: {', '.join(named)}."
    for rule in study.screening:
        wanted = [f"one of {', '.join(rule.answers)}"] if rule.answers else []
        wanted += [f"at least {rule.at_least:g}"] if rule.at_least is not None else []
        wanted += [f"at most {rule.at_most:g}"] if rule.at_most is not None else []
        where = f"`{rule.questionnaire}.{rule.item}`"
        yield f"- Only with this answer to {where}: {', '.join(wanted)}."
    for quota in study.answer_quotas:
        where = f"`{quota.questionnaire}.{quota.item}`"
        yield f"- At most {quota.most} who answer {where} with: {', '.join(quota.answers)}."


def _expected(plan: StudyPlan) -> Iterator[str]:
    if plan.expected:
        yield f"Expected effects, to be found with a power of {plan.power:g}:"
    for one in plan.expected:
        more = "" if one.sd is None else f", SD {one.sd:g}"
        more += "" if one.correlation is None else f", correlation {one.correlation:g}"
        where = f"`{one.measure}` in `{one.condition}`"
        yield f"- {where}: {one.difference:+g} against the first condition{more}"


# --- variables and analysis -----------------------------------------------------------------------


def _variables(study: StudyDefinition, asked: dict[str, Definition]) -> tuple[Answer, ...]:
    manipulated = [f"- `{one.key}`: {_say(study, one.title)}" for one in study.factors]
    if not manipulated and len(study.conditions) > 1:
        manipulated = [f"- `{one.key}`: {_say(study, one.title)}" for one in study.conditions]
    measures = dict.fromkeys(measure for one in study.analyses for measure in one.measures)
    slugs = dict.fromkeys(step.questionnaire for step in study.asking)
    return (
        ("Manipulated variables", manipulated or ["None: there is one condition."]),
        ("Measured variables", [_measure(one, asked) for one in measures]),
        ("Indices", [line for slug in slugs for line in _scales(study, slug, asked.get(slug))]),
    )


def _measure(measure: str, asked: dict[str, Definition]) -> str:
    """Return a measure with its definition."""
    slug, point, item = measure.partition(".")
    if not point:
        column = next((one for one in METRICS if one.name == measure), None)
        if column is None:
            return f"- `{measure}`"
        unit = f" ({column.unit})" if column.unit else ""
        return f"- `{measure}`{unit}: {column.meaning}. Definitions of version {VERSION}."
    scale = measured_scale(asked[slug], item) if slug in asked else None
    return f"- `{measure}`" if scale is None else f"- `{measure}`: {_scale(scale)}"


def _scale(scale: ScoredScale) -> str:
    low, high = scale.bounds
    return f"{scale.formula}; from {low:g} to {high:g}."


def _scales(study: StudyDefinition, slug: str, asked: Definition | None) -> Iterator[str]:
    """Yield how a questionnaire is scored, and which of its items are reverse-coded."""
    if asked is None:
        yield f"- Scores of the questionnaire `{slug}`"
        return
    scales = (*scales_of(asked), *parts_of(asked))
    name = f"`{slug}`, version {asked.version}"
    if not scales:
        yield f"- {name}: answers, no score."
        return
    reverse = ", ".join(asked.reversed) or "none"
    yield f"- {name}. Reverse-coded items, counted from the other end: {reverse}."
    for one in scales:
        yield f"- `{slug}.{one.key}` {_say(study, one.label)}: {_scale(one)}"


def _analysis(study: StudyDefinition, plan: StudyPlan) -> tuple[Answer, ...]:
    is_answered = study.plan is not None
    return (
        ("Statistical models", [_model(study, one) for one in study.analyses]),
        ("Transformations", []),
        ("Inference criteria", list(_criteria(study, plan)) if is_answered else []),
        ("Data exclusion", [*_counting(study), *(_rules(plan) if is_answered else ())]),
        ("Missing data", [plan.missing_data, *([INCOMPLETE[plan.incomplete]] * is_answered)]),
        ("Exploratory analysis", list(_exploratory(study)) if is_answered else []),
    )


def _counting(study: StudyDefinition) -> Iterator[str]:
    """Yield which drives and answers count, whatever the plan says."""
    yield (
        "- Exposed is a participant to whom the page showed a video frame of the task. A drive"
        " counts when it is one of the task, has ended, and the participant moved the robot in it."
        f" {DRIVES[study.analysis.drives]}"
    )
    yield (
        "- An exposed participant who never moves the robot under a condition has not succeeded:"
        " a failure in tests of proportions, such as of `completed`, and in tests of times"
        " censored at the end of the drive. All other metrics and answers are of drives that count."
    )
    yield (
        "- Practice, drives of pilots and bots, drives that a fault of the platform ended, and"
        " drives that a researcher excludes do not count. What a researcher excludes is reported"
        " with the reason."
    )
    yield (
        "- An answer about a drive counts only when the drive counts."
        f" {response_selection.RULES[study.analysis.counts]}"
    )
    kind = "Student's t" if study.analysis.interval == "t" else "the normal"
    yield f"- Intervals of means of answers are by {kind} distribution."
    quality = study.quality
    rules = [
        f"at least {quality.least_sample_rate:g} states a second",
        f"no gap above {quality.longest_gap:g} s",
        f"clocks that differ by at most {quality.largest_clock_offset:g} s",
        *(["the condition applied as assigned"] if quality.condition_applied else []),
        *(["no operator"] if quality.operator_absent else []),
    ]
    yield (
        f"- The record of a drive is called good with {', '.join(rules)}. A record that is not good"
        " is reported, and excludes nothing by itself."
    )


def _model(study: StudyDefinition, one: DeclaredAnalysis) -> str:
    contrasts = "; ".join(_say(study, it.title) for it in one.contrasts)
    test = MODELS[one.test] if one.is_model else TESTS[one.test]
    told = f"- `{one.key}` ({_say(study, one.title)}): {test}. Measures: "
    told += ", ".join(f"`{measure}`" for measure in one.measures) + "."
    told += f" Contrasts: {contrasts}." if contrasts else ""
    told += f" Conditions: {', '.join(one.conditions)}." if one.conditions else ""
    told += " Each pair of conditions is compared as well." if one.post_hoc else ""
    told += f" Effects: {', '.join(one.effects)}." if one.effects else ""
    told += f" Covariates: {', '.join(one.covariates)}." if one.covariates else ""
    return told


def _criteria(study: StudyDefinition, plan: StudyPlan) -> Iterator[str]:
    yield f"p values are two-sided; a corrected p below {plan.alpha:g} is significant."
    if study.analyses:
        yield "The tests of one analysis are corrected together by Holm's method."
    for family in plan.families:
        named = ", ".join(family.hypotheses)
        yield f"- The tests of {named} are corrected together (family `{family.key}`)."


def _rules(plan: StudyPlan) -> Iterator[str]:
    """Yield the rules of the plan, which are applied before any result is computed."""
    for check in plan.attention_checks:
        yield f"- {rule_in_words(check)}"
    for speeder in plan.speeders:
        yield f"- {rule_in_words(speeder)}"
    yield f"- {INCOMPLETE[plan.incomplete]}"
    yield "A sensitivity analysis reports all declared tests with the excluded drives as well."


def rule_in_words(rule: AttentionCheck | Speeder) -> str:
    """Return a rule of exclusion as a sentence."""
    if isinstance(rule, AttentionCheck):
        return (
            f"Attention check: participants whose answer to `{rule.questionnaire}.{rule.item}` is"
            f" not “{rule.answer}” are excluded."
        )
    limits = [] if rule.seconds is None else [f"{rule.seconds:g} s"]
    if rule.median_share is not None:
        limits.append(f"{rule.median_share:g} of the median time")
    return (
        f"Speeders: participants who answer `{rule.questionnaire}` in less than"
        f" {' or '.join(limits)} are excluded."
    )


def _exploratory(study: StudyDefinition) -> Iterator[str]:
    others = [one.key for one in study.analyses if not hypotheses_of(study.plan, one)]
    yield "Every test that no hypothesis names is exploratory, and is marked so in the report."
    if others:
        yield f"Declared without a hypothesis: {', '.join(f'`{key}`' for key in others)}."


# --- every number and choice ----------------------------------------------------------------------


def _settings(study: StudyDefinition) -> Iterator[str]:
    """Yield every field that can change drives, assignment or analysis, with its value: also those
    that a sentence above has, and those that the definition leaves at their defaults.
    """
    for name in study.__struct_fields__:
        if name not in WITHOUT_SETTINGS:
            yield from _fields(getattr(study, name), name)
    for step in study.drives:
        yield from _fields(step, f"step {step.key}")


def _fields(value: object, name: str) -> Iterator[str]:
    if isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            if field not in {"title", "key"}:
                yield from _fields(getattr(value, field), f"{name}.{field}")
    elif isinstance(value, tuple) and any(isinstance(one, msgspec.Struct) for one in value):
        for n, one in enumerate(value, start=1):
            yield from _fields(one, f"{name} {getattr(one, 'key', n)}")
    elif isinstance(value, tuple):
        yield f"- {name}: {', '.join(map(str, value)) or 'none'}"
    elif isinstance(value, dict):
        yield f"- {name}: {', '.join(f'{key} {one}' for key, one in value.items()) or 'none'}"
    else:
        yield f"- {name}: {'none' if value is None else ' '.join(str(value).split())}"


def _say(study: StudyDefinition, text: dict[str, str]) -> str:
    return spoken(text, study.languages[0] if study.languages else "en")
