"""The lists of the study builder: what can be added, and the titles and summaries of parts."""

from collections.abc import Iterator, Mapping
from typing import Any

from django.utils.translation import gettext as _, ngettext

from experiments.builder.design import condition_facts
from experiments.builder.labels import GUIDE
from experiments.definition.steps import KINDS
from experiments.participation.steps import page_type
from surveys.document_forms.parts import Document
from surveys.documents import text_in


def kinds(section: str) -> list[tuple[str, Any]]:
    if section == "steps":
        return [(kind, page_type(kind).label) for kind in KINDS]
    named = {
        "conditions": _("Condition"),
        "courses": _("Course"),
        "analyses": _("Analysis"),
        "stages": GUIDE.item("stages"),
        "codes": GUIDE.item("codes"),
    }
    return [("", named[section])]


def title_of(part: Document, whole: Document) -> str:
    named = {"robot": part.get("robot", ""), "site": part.get("site", "")}
    texts = [text_in(part.get("title", {}), whole["languages"])]
    texts += [part.get(name, "") for name in ("name", "code", "key")]
    return next(filter(None, texts), _("%(robot)s at %(site)s") % named)


def about(
    section: str, part: Document, whole: Document, titles: Mapping[tuple[str, int], str]
) -> Iterator[Any]:
    """Yield the summary of a part, with empty texts; `titles` by questionnaire and version."""
    if section == "steps":
        yield page_type(part["kind"]).label
        if "questionnaire" in part:
            name, version = part["questionnaire"], part.get("version", 1)
            title = titles.get((name, version), name)
            yield _("%(title)s, version %(n)d") % {"title": title, "n": version}
        yield _("%(n)g min") % {"n": part["minutes"]} if "minutes" in part else ""
        yield _("for each condition") if part.get("repeat") else ""
    elif section == "analyses":
        yield GUIDE.word("test", part.get("test", "means"))
        yield ", ".join(part.get("measures", ()))
    elif section == "stages":
        n = len(part.get("steps", ()))
        yield ngettext("%(n)d step", "%(n)d steps", n) % {"n": n}
    elif section == "codes":
        yield GUIDE.word("Code.kind", part["kind"])
        yield part.get("key", "")
        yield part.get("group", "")
    elif section == "conditions":
        cell = part.get("levels", {}).items()
        known = [(one["key"], level) for one in whole["factors"] for level in one.get("levels", ())]
        chosen = [title_of(level, whole) for key, level in known if (key, level["key"]) in cell]
        yield ", ".join(chosen)
        yield _("%(robot)s at %(site)s") % {"robot": part["robot"], "site": part["site"]}
        yield _("by invitation") if part.get("access") == "invitation" else ""
        yield from condition_facts(part)
    else:
        n = len(part["checkpoints"])
        yield ngettext("%(n)d checkpoint", "%(n)d checkpoints", n) % {"n": n}
        yield _("photo") if part.get("photo") else ""
