"""A study's definition as the text of a preregistration, in Markdown: the questions of the OSF
Preregistration in their order, which include those of AsPredicted. Each is answered from the
definition, or marked as unanswered. An appendix has every number and choice of the definition, with
its defaults.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgspec

from experiments.analysis.metrics.definitions import METRICS, VERSION
from experiments.analysis.tables import response_selection
from experiments.dataset.records import FreezeRecord
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.factors import conditions_together
from experiments.definition.plan import Hypothesis, StudyPlan, hypotheses_of, measures_of
from experiments.definition.schema import Condition, Course, Impairment, StudyDefinition
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
    "first": "the first counts",
    "last": "the last counts",
    "all": "all count, and their values are averaged first",
}
Answers = tuple[tuple[str, Iterable[str]], ...]  # questions, with paragraphs or lines of each


def preregistration(
    study: StudyDefinition, freeze: FreezeRecord | None, questionnaires: Sequence[Definition] = ()
) -> str:
    """Return the text of a preregistration of a study, from its definition, the record of when it
    was frozen, and those of its questionnaires that are known.
    """
    asked = {one.slug: one for one in sorted(questionnaires, key=lambda one: one.version)}
    text = _Text(study, study.plan or StudyPlan(), freeze, asked)
    lines = [f"# Preregistration: {text.say(study.title) or study.slug}", ""]
    lines += [*_freeze_lines(study, freeze), ""]
    if study.plan is None:
        lines += [NO_PLAN, ""]
    for section, answers in text.sections():
        lines += [f"## {section}", ""]
        for question, given in answers:
            known = [line for line in given if line.strip()]
            lines += [f"### {question}", "", *(known or [UNANSWERED]), ""]
    return "\n".join((*lines, "## Every number and choice", "", *_settings(study), ""))


def _freeze_lines(study: StudyDefinition, freeze: FreezeRecord | None) -> Iterator[str]:
    yield f"Study `{study.slug}`, version {study.version}."
    if freeze is None:
        yield "When the definition was frozen is unknown."
    elif not freeze.frozen_at:
        yield "This is a draft: the definition is not frozen and may still change."
        yield f"SHA-256 of the draft: `{freeze.sha256}`."
    else:
        yield f"Frozen on {freeze.frozen_at} (SHA-256 of the definition: `{freeze.sha256}`)."
        yield f"Before data: {before_data(freeze)}."


def before_data(freeze: FreezeRecord | None) -> str:
    """Return whether a definition was frozen before there were data, and what limits that."""
    if freeze is not None and not freeze.frozen_at:
        return "no, it is a draft"
    if freeze is None or freeze.before_data is None:
        return "unknown"
    joined = "no, a participant of this version had already joined"
    if freeze.before_data:
        joined = "yes, no participant of this version had joined"
    if not freeze.earlier:
        return joined
    return f"{joined}; but {freeze.earlier} had joined earlier versions, whose data were known"


@dataclass(frozen=True)
class _Text:
    """The answers from a study's definition, its plan, and its questionnaires by name."""

    study: StudyDefinition
    plan: StudyPlan
    freeze: FreezeRecord | None
    asked: Mapping[str, Definition]

    def say(self, text: dict[str, str]) -> str:
        return spoken(text, self.study.languages[0] if self.study.languages else "en")

    def sections(self) -> Iterator[tuple[str, Answers]]:
        yield "Study information", self._information()
        yield "Design plan", self._design()
        yield "Sampling plan", self._sampling()
        yield "Variables", self._variables()
        yield "Analysis plan", self._analysis()
        yield "Other", (("Other", [self.plan.notes, self.study.source]),)

    def _information(self) -> Answers:
        return (
            ("Title", [self.say(self.study.title)]),
            ("Description", [self.say(self.study.intro)]),
            ("Research question", [self.plan.question]),
            ("Hypotheses", [self._hypothesis(one) for one in self.plan.hypotheses]),
        )

    def _hypothesis(self, one: Hypothesis) -> str:
        analysis = next((it for it in self.study.analyses if it.key == one.analysis), None)
        if analysis is None:
            return f"- **{one.key}**: {one.text}"
        measures = ", ".join(f"`{measure}`" for measure in measures_of(one, analysis))
        parts = [f"analysis `{analysis.key}`", measures]
        sides: Sequence[str] = ("the first side", "the second")
        if one.contrast is not None and one.contrast <= len(analysis.contrasts):
            contrast = analysis.contrasts[one.contrast - 1]
            parts.append(f"contrast “{self.say(contrast.title)}”")
            both = (contrast.first, contrast.second)
            sides = [", ".join(f"`{key}`" for key in keys) for keys in both]
        if one.effect:
            parts.append(f"effect `{one.effect}`")
        factor = next((it for it in self.study.factors if it.key == one.effect), None)
        if factor is not None and len(factor.levels) == 2:
            sides = [f"“{self.say(level.title)}”" for level in factor.levels]
        expected = "a difference, two-sided"
        if one.direction != "different":
            word = "greater" if one.direction == "greater" else "smaller"
            expected = f"{sides[0]} is {word} than {sides[1]}; tested two-sided"
        return f"- **{one.key}**: {one.text} Expected: {expected}. Tested by: {'; '.join(parts)}."

    # --- design and sampling ----------------------------------------------------------------------

    def _design(self) -> Answers:
        kind = "Experiment: participants are assigned to conditions."
        if len(self.study.conditions) == 1:
            kind = "Observational study: every participant has the same condition."
        return (
            ("Study type", [kind]),
            ("Blinding", [self.plan.blinding]),
            ("Study design", list(self._study_design())),
            ("Randomization", list(self._randomization())),
        )

    def _study_design(self) -> Iterator[str]:
        study = self.study
        most = max((len(keys) for keys in conditions_together(study)), default=0)
        if len(study.conditions) > 1:
            yield f"A participant does {most} of {len(study.conditions)} conditions."
        for factor in study.factors:
            levels = ", ".join(self.say(level.title) for level in factor.levels)
            yield f"- Factor `{factor.key}`, {factor.design} participants: {levels}"
        for condition in study.conditions:
            yield f"- Condition `{condition.key}`: {'; '.join(self._described(condition))}"
        for step in study.drives:
            what = "Practice, which counts in no result" if step.is_practice else "Task"
            again = ", once for each condition" if step.repeat else ""
            yield f"- {what}, `{step.key}`: at most {step.minutes:g} minutes{again}."
        if study.task is not None:
            yield (
                "- The time of the task begins with the first video frame that the page shows. It"
                " is completed when all checkpoints were passed in order and the robot has then"
                f" rested on its charging contacts for {study.task.docked_seconds:g} s; a robot"
                " without contacts decides by itself that it is docked."
            )
        yield from map(_course, study.courses)
        yield _start(study)

    def _described(self, one: Condition) -> Iterator[str]:
        """Yield what a condition is, in words and numbers."""
        levels = ", ".join(f"{factor} {level}" for factor, level in one.levels.items())
        yield from filter(
            None,
            (
                self.say(one.title),
                levels and f"levels: {levels}",
                f"robot {one.robot} at {one.site}",
                f"assistance {one.assist}",
                f"controllers {', '.join(one.controllers) or 'none'}",
                one.actions and f"actions {', '.join(one.actions)}",
                one.interface != "standard" and f"page {one.interface}",
                one.control_way != "any" and f"commands over {one.control_way}",
                one.doors_closed and f"closed {', '.join(one.doors_closed)}",
                one.speed.linear is not None and f"at most {one.speed.linear:g} m/s",
                one.speed.angular is not None and f"at most {one.speed.angular:g} rad/s",
                _network("network to the robot, one way", one.network.control),
                _network("network back with the video, one way", one.network.video),
                one.idle_seconds and f"asked whether they are there after {one.idle_seconds:g} s",
                one.access == "invitation" and "by invitation",
            ),
        )
        for step in self.study.steps:
            if pages := ", ".join(map(str, step.own_pages(one.key))):
                yield f"pages {pages} of the instructions `{step.key}`, for some conditions only"

    def _randomization(self) -> Iterator[str]:
        study, allocation = self.study, self.study.allocation
        if len(study.conditions) == 1:
            yield "None: there is one condition."
            return
        when = "On first getting the robot"
        if study.tells_condition:
            when = "Before reading instructions that depend on the condition"
        yield (
            f"{when}, a participant is assigned to the cell with the fewest places filled or in"
            f" progress with probability {allocation.best_probability:g}, otherwise to one of the"
            " others; ties and chance follow from a seed that is kept."
        )
        yield self._balance()
        yield (
            "A participant keeps the cell: the page shows something of it before any video."
            if study.reveals_condition
            else "A participant who was not exposed gives the place back and is drawn anew on"
            " getting the robot again; every draw is reported, and the participant counts in the"
            " cell of the drive that counts."
        )
        if allocation.design == "within":
            yield f"Conditions are done {ORDERS[allocation.order]}."
            yield (
                f"A participant who was not seen for {allocation.left_after_hours:g} hours before"
                " the last condition has left: another participant gets the order."
            )
        yield self._replacement()

    def _balance(self) -> str:
        allocation = self.study.allocation
        factors = [
            f"{one.item} (from {', '.join(f'{limit:g}' for limit in one.limits)})"
            if one.limits
            else one.item
            for one in allocation.balance
        ]
        alike = "all of these factors (strata)"
        if allocation.balancing == "minimization":
            alike = "each of these factors, added up (minimization)"
        places = f"Places count of participants alike in {alike}: {', '.join(factors)}."
        return places if factors else ""

    def _replacement(self) -> str:
        refill = self.study.refill
        if not (refill.outcomes and refill.most):
            return "Exposed participants are not replaced."
        named = ", ".join(one.replace("_", " ") for one in refill.outcomes)
        return (
            "Exposed participants whose task ended so are replaced, at most"
            f" {refill.most} times in each cell: {named}. They stay in the flow, and their drives"
            " count as those of others."
        )

    def _sampling(self) -> Answers:
        study, plan, freeze = self.study, self.plan, self.freeze
        quota = study.allocation.quota
        size = [f"{plan.participants} complete cases."] if plan.participants is not None else []
        size += [f"At most {quota} participants in each cell."] if quota is not None else []
        has_started = freeze is not None and bool(freeze.frozen_at)
        existing = f"Frozen before data: {before_data(freeze)}." if has_started else ""
        procedures = [study.recruitment, study.compensation, *self._eligibility()]
        return (
            ("Existing data", [existing]),
            ("Data collection procedures", procedures),
            ("Sample size", size),
            ("Sample size rationale", [plan.rationale, *self._expected()]),
            ("Stopping rule", [plan.stopping]),
        )

    def _eligibility(self) -> Iterator[str]:
        """Yield who cannot take part, by age, device and answers."""
        study = self.study
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

    def _expected(self) -> Iterator[str]:
        if self.plan.expected:
            yield f"Expected effects, to be found with a power of {self.plan.power:g}:"
        for one in self.plan.expected:
            more = "" if one.sd is None else f", SD {one.sd:g}"
            more += "" if one.correlation is None else f", correlation {one.correlation:g}"
            where = f"`{one.measure}` in `{one.condition}`"
            yield f"- {where}: {one.difference:+g} against the first condition{more}"

    # --- variables and analysis -------------------------------------------------------------------

    def _variables(self) -> Answers:
        study = self.study
        several = study.conditions if len(study.conditions) > 1 else ()
        manipulated = [f"- `{it.key}`: {self.say(it.title)}" for it in study.factors or several]
        measures = dict.fromkeys(measure for one in study.analyses for measure in one.measures)
        slugs = dict.fromkeys(step.questionnaire for step in study.asking)
        return (
            ("Manipulated variables", manipulated or ["None: there is one condition."]),
            ("Measured variables", [self._measure(one) for one in measures]),
            ("Indices", [line for slug in slugs for line in self._scales(slug)]),
        )

    def _measure(self, measure: str) -> str:
        """Return a measure with its definition."""
        slug, point, item = measure.partition(".")
        if point:
            scale = measured_scale(self.asked[slug], item) if slug in self.asked else None
            return f"- `{measure}`" if scale is None else f"- `{measure}`: {_scale(scale)}"
        column = next((one for one in METRICS if one.name == measure), None)
        if column is None:
            return f"- `{measure}`"
        unit = f" ({column.unit})" if column.unit else ""
        return f"- `{measure}`{unit}: {column.meaning}. Definitions of version {VERSION}."

    def _scales(self, slug: str) -> Iterator[str]:
        """Yield how a questionnaire is scored, and which of its items are reverse-coded."""
        asked = self.asked.get(slug)
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
            yield f"- `{slug}.{one.key}` {self.say(one.label)}: {_scale(one)}"

    def _analysis(self) -> Answers:
        study, plan = self.study, self.plan
        criteria, exclusions, missing, exploratory = [], [*_counting(study)], [], []
        if study.plan is not None:
            criteria = list(_criteria(study, plan))
            exclusions += _rules(plan)
            missing = [plan.missing_data, INCOMPLETE[plan.incomplete]]
            exploratory = list(_exploratory(study))
        return (
            ("Statistical models", [self._model(one) for one in study.analyses]),
            ("Transformations", []),
            ("Inference criteria", criteria),
            ("Data exclusion", exclusions),
            ("Missing data", missing),
            ("Exploratory analysis", exploratory),
        )

    def _model(self, one: DeclaredAnalysis) -> str:
        test = MODELS[one.test] if one.is_model else TESTS[one.test]
        contrasts = "; ".join(self.say(it.title) for it in one.contrasts)
        parts = {
            "Measures": ", ".join(f"`{measure}`" for measure in one.measures),
            "Contrasts": contrasts,
            "Conditions": ", ".join(one.conditions),
            "Each pair of conditions is compared as well": one.post_hoc,
            "Effects": ", ".join(one.effects),
            "Covariates": ", ".join(one.covariates),
        }
        about = [f"{k}." if v is True else f"{k}: {v}." for k, v in parts.items() if v]
        return f"- `{one.key}` ({self.say(one.title)}): {test}. {' '.join(about)}"


# --- parts without texts of the study -------------------------------------------------------------


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
    start, rules = study.start, []
    if start.charge > 0.0:
        rules.append(f"its battery has at least {100.0 * start.charge:g} % of its charge")
    if start.docked:
        rules.append(
            f"it is docked within {start.distance:g} m and {start.heading:g} rad of the pose of the"
            " course's station"
        )
    wanted = "; ".join(rules)
    return f"- A drive begins only when this holds of the robot: {wanted}." if wanted else ""


def _network(what: str, impairment: Impairment | None) -> str:
    units = {"milliseconds": "ms", "percent": "%"}
    words = []
    for part in filter(None, spell(impairment).split(",")):
        name, _, value = part.partition("=")
        words.append(f"{name} {value} {units.get(RANGES[name][2], RANGES[name][2])}")
    return f"{what}: {', '.join(words)}" if words else ""


def _scale(scale: ScoredScale) -> str:
    low, high = scale.bounds
    return f"{scale.formula}; from {low:g} to {high:g}."


def _counting(study: StudyDefinition) -> Iterator[str]:
    """Yield which drives and answers count, whatever the plan says."""
    yield (
        "- Exposed is a participant to whom the page showed a video frame of the task. A drive"
        " counts when it is one of the task, has ended, and the participant moved the robot in it."
        " Of several such drives of a participant in a condition,"
        f" {DRIVES[study.analysis.drives]}."
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
        where = f"`{check.questionnaire}.{check.item}`"
        yield (
            f"- Attention check: participants whose answer to {where} is not “{check.answer}” are"
            " excluded."
        )
    for speeder in plan.speeders:
        limits = [] if speeder.seconds is None else [f"{speeder.seconds:g} s"]
        if speeder.median_share is not None:
            limits.append(f"{speeder.median_share:g} of the median time")
        yield (
            f"- Speeders: participants who answer `{speeder.questionnaire}` in less than"
            f" {' or '.join(limits)} are excluded."
        )
    yield f"- {INCOMPLETE[plan.incomplete]}"
    yield "A sensitivity analysis reports all declared tests with the excluded drives as well."


def _exploratory(study: StudyDefinition) -> Iterator[str]:
    others = [f"`{one.key}`" for one in study.analyses if not hypotheses_of(study.plan, one)]
    yield "Every test that no hypothesis names is exploratory, and is marked so in the report."
    if others:
        yield f"Declared without a hypothesis: {', '.join(others)}."


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
