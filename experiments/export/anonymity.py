"""The anonymity of participants in a public dataset.

k-anonymity (Sweeney, "k-anonymity: a model for protecting privacy", 2002): each participant shares
what an acquaintance may know of them with at least k − 1 others in the dataset.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

from django.utils.translation import gettext as _

from experiments.dataset.records import Dataset, WholeStudy
from experiments.export.format import text_of
from experiments.extraction.people import asks_for_sharing, numbers_of_public
from experiments.models import Study

FEW = 5  # in a smaller group, a participant may be recognized


def sharing_warnings(study: Study) -> list[str]:
    """Return what people who publish a study's public dataset have to know about who is in it."""
    public, whole = numbers_of_public(study)
    if not asks_for_sharing(study.as_definition()):
        return [
            _(
                "The consent did not ask whether data may be published, so the public dataset has "
                "everybody who took part and did not withdraw. Publish it only if the consent "
                "text and the ethics approval allow it."
            )
        ]
    if public == whole:
        return []
    words = _(
        "The public dataset has %(public)d of %(whole)d participants, because the others did not "
        "agree to publishing. Its results differ from those of the report on all of them."
    )
    return [words % {"public": public, "whole": whole}]


def anonymity(dataset: Dataset, study: WholeStudy) -> str:
    """Return the README's part on a public dataset, which is a part of a study."""
    people = _known_of(dataset)
    public, whole = len(people), study.participants
    names = list(next(iter(people.values()), {}))
    sets = [names[:1], *([names[0], name] for name in names[1:]), names]
    rows = [_row(people, some) for some in dict.fromkeys(map(tuple, sets)) if some]
    who = f"It has {public} of the {whole} participants; the others did not agree to publishing."
    who += " Results that were published on all of them therefore have other numbers."
    if public == whole:
        who = f"It has all {whole} participants, who agreed to publishing."
    if not asks_for_sharing(dataset.study):
        who = f"It has all {whole} participants: the consent did not ask about publishing."
    about = {"few": FEW, "who": who, "withdrew": dataset.withdrew, "rows": "\n".join(rows)}
    return text_of("anonymity.md").format(**about)


def _known_of(dataset: Dataset) -> Mapping[str, Mapping[str, str]]:
    """Return what may be known of each participant: the range of their age, and what they chose
    from lists in questions about the person, by column.
    """
    steps = [step for step in dataset.study.questionnaire_steps if step.is_about_person]
    choices = {
        (one.slug, one.version): [q.key for q in one.questions() if q.labelled_values]
        for one in dataset.questionnaires
    }
    about = [(step.questionnaire, step.version) for step in steps]
    asked = {name: choices.get(name, []) for name in about}
    names = [f"{slug}.{key}" for (slug, _version), keys in asked.items() for key in keys]
    found = {
        one.id: {"age_band": one.age_band, **dict.fromkeys(names, "")}
        for one in dataset.participants
        if one.kind == "participant"
    }
    for response in dataset.responses:
        step = dataset.asking(response)
        if step is None or not step.is_about_person or response.participant not in found:
            continue
        for key in asked.get((response.questionnaire, response.version), ()):
            value = response.values.get(key, "")
            found[response.participant][f"{response.questionnaire}.{key}"] = str(value)
    return found


def _row(people: Mapping[str, Mapping[str, str]], names: Sequence[str]) -> str:
    """Return the size of the smallest group of participants who are alike in these columns, and the
    number of participants in groups of fewer than FEW.
    """
    sizes = Counter(tuple(one[name] for name in names) for one in people.values()).values()
    few = sum(size for size in sizes if size < FEW)
    alike = ", ".join(names) if len(names) <= 2 else "all of these"
    return f"| {alike} | {min(sizes, default=0)} | {few} of {len(people)} |"
