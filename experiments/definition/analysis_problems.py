"""What is wrong with the analyses that a study declares."""

from collections.abc import Iterator

from experiments.definition.analyses import EFFECTS, DeclaredAnalysis
from experiments.definition.schema import StudyDefinition
from surveys.documents import duplicates


def problems(study: StudyDefinition) -> Iterator[str]:
    """Yield what is wrong with the analyses that a study declares."""
    yield from duplicates("analysis", (one.key for one in study.analyses))
    for one in study.analyses:
        yield from (f"Analysis {one.key}: {told}" for told in _of(one, study))


def _of(one: DeclaredAnalysis, study: StudyDefinition) -> Iterator[str]:
    if not one.measures:
        yield "it measures nothing; add at least one measure."
    yield from duplicates("measure", one.measures)
    asked = {step.questionnaire for step in study.asking}
    for measure in one.measures:
        questionnaire, point, _ = measure.partition(".")
        if point and questionnaire not in asked:
            yield f"the study does not ask the questionnaire {questionnaire}."
    known = {condition.key for condition in study.conditions}
    named = [*one.conditions, *(key for it in one.contrasts for key in (*it.first, *it.second))]
    for key in dict.fromkeys(named):
        if key not in known:
            yield f"there is no condition {key}."
    for contrast in one.contrasts:
        if not contrast.first or not contrast.second or set(contrast.first) & set(contrast.second):
            yield "a contrast compares two different sides of at least one condition each."
    yield from _of_model(one, study)


def _of_model(one: DeclaredAnalysis, study: StudyDefinition) -> Iterator[str]:
    if one.test != "mixed":
        if one.effects:
            yield "only a mixed model has effects."
        return
    if not one.effects:
        yield "a mixed model needs at least one effect."
    if one.contrasts or one.post_hoc:
        yield "a mixed model has effects, and neither contrasts nor post-hoc tests."
    if study.allocation.design != "within":
        yield "a mixed model needs participants who do several conditions."
    factors = {factor.key for factor in study.factors}
    for effect in one.effects:
        for name in effect.split(":"):
            if name not in factors | EFFECTS:
                yield f"there is no factor {name}."
