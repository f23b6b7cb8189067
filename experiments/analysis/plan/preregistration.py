"""A study's definition as the text of a preregistration, in Markdown: the questions of the OSF
Preregistration in their order, which include those of AsPredicted, and an appendix with every
number and choice, also defaults. preregistration.toml has its sentences.
"""

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import msgspec

from experiments.analysis.metrics.definitions import METRICS, VERSION
from experiments.analysis.tables.scored_responses import DISTRIBUTIONS, RULES
from experiments.dataset.levels import FAULTS
from experiments.dataset.records import FreezeRecord
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.factors import conditions_together
from experiments.definition.plan import Hypothesis, StudyPlan, hypotheses_of, measures_of
from experiments.definition.schema import Condition, Course, Impairment, StudyDefinition
from robots.api.network_words import RANGES, spell
from surveys.definition import Definition
from surveys.documents import spoken
from surveys.scoring import ScoredScale, measured_scale, parts_of, scales_of

PARTS: Any = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
UNANSWERED, NO_PLAN = PARTS["unanswered"], PARTS["no_plan"]
# Fields of a study that are texts, have sections of their own, or are not for the public.
WITHOUT_SETTINGS = frozenset(
    {"format", "slug", "version", "title", "intro", "source", "licence", "recruitment"}
    | {"compensation", "languages", "steps", "factors", "analyses", "plan", "coding", "recruiting"}
)


def preregistration(
    study: StudyDefinition, freeze: FreezeRecord | None, questionnaires: Sequence[Definition] = ()
) -> str:
    """Return the text of a preregistration of a study, from its definition, the record of when it
    was frozen, and those of its questionnaires that are known.
    """
    asked = {one.slug: one for one in sorted(questionnaires, key=lambda one: one.version)}
    text = _Text(study, study.plan or StudyPlan(), freeze, asked)
    lines = [f"# Preregistration: {text.say(study.title) or study.slug}", ""]
    lines += [_part("study", study=study), _freeze(freeze), ""]
    if study.plan is None:
        lines += [NO_PLAN, ""]
    answers = text.answers()
    for section, questions in PARTS["sections"].items():
        lines += [f"## {section}", ""]
        for question in questions:
            known = [line for line in answers.get(question, ()) if line.strip()]
            lines += [f"### {question}", "", *(known or [UNANSWERED]), ""]
    return "\n".join((*lines, "## Every number and choice", "", *_settings(study), ""))


def _part(*path: str, **values: object) -> str:
    """Return a sentence of the template, or several lines, with its fields filled in."""
    return str(reduce(getitem, path, PARTS)).strip().format(**values)


def _freeze(freeze: FreezeRecord | None) -> str:
    if freeze is None:
        return _part("freeze_unknown")
    name = "frozen" if freeze.frozen_at else "draft"
    return _part(name, freeze=freeze, before=before_data(freeze))


def before_data(freeze: FreezeRecord | None) -> str:
    """Return whether a definition was frozen before there were data, and what limits that."""
    if freeze is not None and not freeze.frozen_at:
        return _part("before_data", "draft")
    if freeze is None or freeze.before_data is None:
        return _part("before_data", "unknown")
    joined = _part("before_data", "yes" if freeze.before_data else "no")
    if not freeze.earlier:
        return joined
    return _part("before_data", "earlier", joined=joined, freeze=freeze)


@dataclass(frozen=True)
class _Text:
    """The answers from a study's definition, its plan, and its questionnaires by name."""

    study: StudyDefinition
    plan: StudyPlan
    freeze: FreezeRecord | None
    asked: Mapping[str, Definition]

    def say(self, text: dict[str, str]) -> str:
        return spoken(text, self.study.languages[0] if self.study.languages else "en")

    def answers(self) -> dict[str, Iterable[str]]:
        study, plan = self.study, self.plan
        is_single = len(study.conditions) == 1
        manipulated = study.factors or (() if is_single else study.conditions)
        measures = dict.fromkeys(measure for one in study.analyses for measure in one.measures)
        slugs = dict.fromkeys(step.questionnaire for step in study.questionnaire_steps)
        recruiting = (study.recruitment, study.compensation)
        return {
            "Title": [self.say(study.title)],
            "Description": [self.say(study.intro)],
            "Research question": [plan.question],
            "Hypotheses": [self._hypothesis(one) for one in plan.hypotheses],
            "Study type": [_part("observation" if is_single else "experiment")],
            "Blinding": [plan.blinding],
            "Study design": self._study_design(),
            "Randomization": self._randomization(),
            "Data collection procedures": [*recruiting, *self._eligibility()],
            "Sample size rationale": [plan.rationale, *self._expected()],
            "Stopping rule": [plan.stopping],
            "Manipulated variables": [f"- `{it.key}`: {self.say(it.title)}" for it in manipulated]
            or [_part("one_condition")],
            "Measured variables": [self._measure(one) for one in measures],
            "Indices": [line for slug in slugs for line in self._scales(slug)],
            "Statistical models": [self._model(one) for one in study.analyses],
            "Other": [plan.notes, study.source],
            **self._sample(),
            **self._decisions(),
        }

    def _sample(self) -> dict[str, list[str]]:
        people, quota, freeze = self.plan.participants, self.study.allocation.quota, self.freeze
        size = [] if people is None else [_part("size", participants=people)]
        size += [] if quota is None else [_part("quota", quota=quota)]
        has_started = freeze is not None and freeze.frozen_at
        existing = [_part("existing", before=before_data(freeze))] if has_started else []
        return {"Existing data": existing, "Sample size": size}

    def _decisions(self) -> dict[str, list[str]]:
        study, plan = self.study, self.plan
        if study.plan is None:
            return {"Data exclusion": [_counting(study)]}
        incomplete = _part("incomplete", plan.incomplete)
        return {
            "Inference criteria": list(_criteria(study, plan)),
            "Data exclusion": [_counting(study), *_rules(plan)],
            "Missing data": [plan.missing_data, incomplete],
            "Exploratory analysis": list(_exploratory(study)),
        }

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

    def _study_design(self) -> Iterator[str]:
        study, n = self.study, len(self.study.conditions)
        most = max((len(keys) for keys in conditions_together(study)), default=0)
        if n > 1:
            yield _part("conditions", most=most, n=n)
        for factor in study.factors:
            levels = ", ".join(self.say(level.title) for level in factor.levels)
            yield _part("factor", factor=factor, levels=levels)
        for one in study.conditions:
            yield _part("condition", key=one.key, about="; ".join(self._described(one)))
        for step in study.drives:
            what = "Practice, which counts in no result" if step.is_practice else "Task"
            again = ", once for each condition" if step.repeat else ""
            yield _part("drive", what=what, step=step, again=again)
        if study.task is not None:
            yield _part("task", task=study.task)
        yield from map(_course, study.courses)
        yield _start(study)

    def _described(self, one: Condition) -> Iterator[str]:
        levels = ", ".join(f"{factor} {level}" for factor, level in one.levels.items())
        parts = (
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
        )
        yield from filter(None, parts)
        for step in self.study.steps:
            if pages := ", ".join(map(str, step.own_pages(one.key))):
                yield _part("own_pages", pages=pages, step=step)

    def _randomization(self) -> Iterator[str]:
        study, allocation = self.study, self.study.allocation
        if len(study.conditions) == 1:
            yield _part("one_condition")
            return
        when = "when_offered_robot" if study.decides_robot else "when_getting_robot"
        when = "when_instructed" if study.has_condition_specific_pages else when
        yield _part("assignment", when=_part(when), allocation=allocation)
        if allocation.balance:
            yield self._balance()
        yield _part("keeps_cell" if study.reveals_condition else "drawn_again")
        if study.practice_keys and not study.reveals_condition:
            yield _part("practised")
        if allocation.design == "between" and (study.practice_keys or study.reveals_condition):
            yield _part("left", allocation=allocation)
        if allocation.design == "within":
            order = _part("orders", allocation.order)
            yield _part("within", order=order, allocation=allocation)
        refill = study.refill
        if not (refill.outcomes and refill.most):
            yield _part("not_replaced")
            return
        named = ", ".join(one.replace("_", " ") for one in refill.outcomes)
        yield _part("replaced", most=refill.most, named=named)

    def _balance(self) -> str:
        allocation = self.study.allocation
        factors = []
        for one in allocation.balance:
            limits = ", ".join(f"{limit:g}" for limit in one.limits)
            factors.append(f"{one.item} (from {limits})" if limits else one.item)
        is_minimized = allocation.balancing == "minimization"
        alike = _part("alike_minimized" if is_minimized else "alike_stratified")
        return _part("balance", alike=alike, factors=", ".join(factors))

    def _eligibility(self) -> Iterator[str]:
        """Yield who cannot take part, by age, device and answers."""
        study = self.study
        if study.consent is not None:
            what = _part("guardian" if study.consent.minors == "guardian" else "no_minors")
            yield _part("minors", age=study.consent.minimum_age, what=what)
        for what, named in (("devices", study.devices), ("browsers", study.browsers)):
            if named:
                yield _part("only_with", what=what, named=", ".join(named))
        for rule in study.screening:
            wanted = [f"one of {', '.join(rule.answers)}"] if rule.answers else []
            wanted += [f"at least {rule.at_least:g}"] if rule.at_least is not None else []
            wanted += [f"at most {rule.at_most:g}"] if rule.at_most is not None else []
            yield _part("screening", rule=rule, wanted=", ".join(wanted))
        for quota in study.answer_quotas:
            yield _part("answer_quota", it=quota, named=", ".join(quota.answers))

    def _expected(self) -> Iterator[str]:
        if self.plan.expected:
            yield _part("power", plan=self.plan)
        for one in self.plan.expected:
            more = "" if one.sd is None else f", SD {one.sd:g}"
            more += "" if one.correlation is None else f", correlation {one.correlation:g}"
            yield _part("expected", it=one, more=more)

    # --- variables and analysis -------------------------------------------------------------------

    def _measure(self, measure: str) -> str:
        slug, _, item = measure.partition(".")
        if slug in self.asked and (scale := measured_scale(self.asked[slug], item)):
            return f"- `{measure}`: {_scale(scale)}"
        for column in METRICS:
            if column.name == measure:
                unit = f" ({column.unit})" if column.unit else ""
                return _part("metric", column=column, unit=unit, version=VERSION)
        return f"- `{measure}`"

    def _scales(self, slug: str) -> Iterator[str]:
        """Yield how a questionnaire is scored, and which of its items are reverse-coded."""
        asked = self.asked.get(slug)
        if asked is None:
            yield _part("unknown_scores", slug=slug)
            return
        scales = (*scales_of(asked), *parts_of(asked))
        name = f"`{slug}`, version {asked.version}"
        if not scales:
            yield _part("no_score", name=name)
            return
        yield _part("reversed", name=name, keys=", ".join(asked.reversed) or "none")
        for one in scales:
            yield f"- `{slug}.{one.key}` {self.say(one.label)}: {_scale(one)}"

    def _model(self, one: DeclaredAnalysis) -> str:
        test = _part("models" if one.is_model else "tests", one.test)
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
    parts = [_part("course", course=course, stops=stops)]
    if course.doors:
        parts.append(f"doors to cross, where open: {', '.join(course.doors)}")
    if course.photo is not None:
        parts.append(_part("photo", photo=course.photo))
    if course.zones:
        parts.append(f"zones: {', '.join(zone.name for zone in course.zones)}")
    return "; ".join(parts) + "."


def _start(study: StudyDefinition) -> str:
    start, rules = study.start, []
    if start.charge > 0.0:
        rules.append(_part("charge", percent=100.0 * start.charge))
    if start.docked:
        rules.append(_part("docked", start=start))
    return _part("start", wanted="; ".join(rules)) if rules else ""


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


def _counting(study: StudyDefinition) -> str:
    """Return which drives and answers count, whatever the plan says."""
    analysis, quality = study.analysis, study.quality
    more = ", the condition applied as assigned" if quality.condition_applied else ""
    more += ", no operator" if quality.operator_absent else ""
    about = {"drives": _part("drives", analysis.drives), "rule": RULES[analysis.counts]}
    about |= {"distribution": DISTRIBUTIONS[analysis.interval], "more": more}
    return _part("counting", quality=quality, **about)


def _criteria(study: StudyDefinition, plan: StudyPlan) -> Iterator[str]:
    yield _part("two_sided", plan=plan)
    if study.analyses:
        yield _part("holm")
    for one in plan.families:
        yield _part("family", key=one.key, named=", ".join(one.hypotheses))


def _rules(plan: StudyPlan) -> Iterator[str]:
    """Yield the rules of the plan, which are applied before any result is computed."""
    for check in plan.attention_checks:
        yield _part("attention_check", it=check)
    for one in plan.speeders:
        limits = [] if one.seconds is None else [f"{one.seconds:g} s"]
        if one.median_share is not None:
            limits.append(f"{one.median_share:g} of the median time")
        yield _part("speeders", it=one, limits=" or ".join(limits))
    yield f"- {_part('incomplete', plan.incomplete)}"
    if plan.faults:
        yield _part("faults", named="; ".join(FAULTS[one] for one in plan.faults))
    yield _part("sensitivity")


def _exploratory(study: StudyDefinition) -> Iterator[str]:
    others = [f"`{one.key}`" for one in study.analyses if not hypotheses_of(study.plan, one)]
    yield _part("exploratory")
    if others:
        yield _part("undecided", keys=", ".join(others))


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
