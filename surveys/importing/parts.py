"""Parts of questions that the formats have in common: options, scales, and texts for "other"."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Draft, Item
from surveys.importing.report import Note
from surveys.problems import MAX_POINTS, MIN_POINTS

# Words of answers that other systems make themselves and do not write into the file.
WORDS: dict[str, dict[str, str]] = {
    "yes": {"en": "Yes", "es": "Sí", "de": "Ja", "fr": "Oui", "it": "Sì", "pt": "Sim"},
    "no": {"en": "No", "es": "No", "de": "Nein", "fr": "Non", "it": "No", "pt": "Não"},
    "true": {"en": "True", "es": "Verdadero", "de": "Wahr", "fr": "Vrai"},
    "false": {"en": "False", "es": "Falso", "de": "Falsch", "fr": "Faux"},
    "uncertain": {"en": "Uncertain", "es": "No lo sé", "de": "Unsicher", "fr": "Incertain"},
    "increase": {"en": "Increase", "es": "Aumentar", "de": "Zunahme", "fr": "Augmenter"},
    "same": {"en": "Same", "es": "Igual", "de": "Gleich", "fr": "Sans changement"},
    "decrease": {"en": "Decrease", "es": "Disminuir", "de": "Abnahme", "fr": "Diminuer"},
    "female": {"en": "Female", "es": "Femenino", "de": "Weiblich", "fr": "Féminin"},
    "male": {"en": "Male", "es": "Masculino", "de": "Männlich", "fr": "Masculin"},
    "other": {"en": "Other", "es": "Otro", "de": "Andere", "fr": "Autre", "it": "Altro"},
    "comment": {"en": "Comment", "es": "Comentario", "de": "Kommentar", "fr": "Commentaire"},
}
_NOT_APPLICABLE = re.compile(
    r"n\s*/?\s*a|(not|non) applicable|does not apply|no aplica|no procede|nicht zutreffend|"
    r"trifft nicht zu|sans objet",
    re.IGNORECASE,
)
_PREFERS_NOT = re.compile(
    r"(i )?(prefer|would rather|choose|decline)( not)? to (say|answer|respond)|"
    r"prefiero no (contestar|responder|decirlo)|keine angabe|ne souhaite pas répondre",
    re.IGNORECASE,
)
OTHER_LINE = 200


def word(name: str, draft: Draft, note: Note) -> Text:
    """Return an answer's word that the file does not hold, in the languages of the file."""
    known = WORDS[name]
    lacking = [lang for lang in draft.languages if lang.split("-")[0] not in known]
    if lacking:
        note.changed(
            _("The file has no text for the answer “%(word)s” in %(languages)s; add it.")
            % {"word": known["en"], "languages": ", ".join(lacking)}
        )
    return {lang: known.get(lang.split("-")[0], known["en"]) for lang in draft.languages}


# --- options --------------------------------------------------------------------------------------


def option_values(codes: Sequence[str], note: Note) -> dict[str, str]:
    """Return a value that fits here for each code of the file, in their order."""
    values: dict[str, str] = {}
    taken: set[str] = set()
    numbers: Counter[str] = Counter()
    for code in codes:
        bare = code.strip().lower()
        bare = f"minus_{bare[1:]}" if bare.startswith("-") else bare
        base = re.sub(r"[^a-z0-9_-]+", "_", bare).strip("_-")[:36] or "option"
        value = base
        while value in taken:
            numbers[base] += 1
            value = f"{base}_{numbers[base] + 1}"
        taken.add(value)
        values[code] = value
    renamed = [
        f"{code} → {value}" for code, value in values.items() if value != code.strip().lower()
    ]
    if renamed:
        note.changed(
            _("These codes are stored in a different form: %(codes)s.")
            % {"codes": ", ".join(renamed)}
        )
    return values


def options(labels: Mapping[str, Text], note: Note, alone: Collection[str] = ()) -> list[Item]:
    """Return the options of a question, of labels by code. Those without a label are left out."""
    values = option_values(list(labels), note)
    unnamed = [code for code, label in labels.items() if not label]
    if unnamed:
        note.changed(
            _("Options without a text are not imported: %(codes)s.") % {"codes": ", ".join(unnamed)}
        )
    return [
        {"value": values[code], "label": label} | ({"alone": True} if code in alone else {})
        for code, label in labels.items()
        if label
    ]


def remember_options(draft: Draft, name: str, labels: Mapping[str, Text], key: str) -> None:
    """Let conditions ask for the options of a question by the codes of the file."""
    values = option_values(list(labels), Note(name))
    for code, label in labels.items():
        if label:
            draft.remember(name, code, key, values[code])


def other_text(draft: Draft, note: Note, key: str, value: str, label: Text) -> Item:
    """Return the question for the words beside an option, asked when it is chosen."""
    own = draft.key(f"{key}_{value}_text", note)
    note.changed(
        _(
            "The text for “%(option)s” becomes a separate question, shown when that option is "
            "chosen."
        )
        % {"option": label[draft.languages[0]]}
    )
    return {
        "kind": "text",
        "key": own,
        "text": label,
        "max_length": OTHER_LINE,
        "show_if": {"item": key, "is": [value]},
    }


# --- scales ---------------------------------------------------------------------------------------


def scale(
    draft: Draft, note: Note, answers: Mapping[str, tuple[str, Text]]
) -> tuple[str, dict[str, int], dict[str, bool]]:
    """Return the scale of a grid: its name, its values by answer, and which reasons for no answer
    it offers (`not_applicable`, `prefer_not`).

    Args:
        draft: the questionnaire.
        note: where changes are noted.
        answers: (code that is stored, label) of each answer, in the order shown.
    """
    reasons: dict[str, bool] = {}
    kept = dict(answers)
    for name, pattern in (("not_applicable", _NOT_APPLICABLE), ("prefer_not", _PREFERS_NOT)):
        for answer, (_code, label) in answers.items():
            if len(kept) > MIN_POINTS and answer in kept and _is(pattern, label):
                reasons[name] = True
                del kept[answer]
                note.changed(
                    _("“%(label)s” becomes a reason for not answering, not a point of the scale.")
                    % {"label": label[draft.languages[0]]}
                )
    values = _scale_values({answer: code for answer, (code, _label) in kept.items()}, note)
    points = [(values[answer], label) for answer, (_code, label) in kept.items()]
    if MIN_POINTS <= len(points) <= MAX_POINTS:
        points = [
            (value, label or (draft.same(str(value)) if n in {0, len(points) - 1} else {}))
            for n, (value, label) in enumerate(points)
        ]
    return draft.scale(points), values, reasons


def _is(pattern: re.Pattern[str], label: Text) -> bool:
    return any(pattern.fullmatch(text.strip(" .()")) for text in label.values())


def _scale_values(codes: Mapping[str, str], note: Note) -> dict[str, int]:
    """Return rising whole numbers for the codes of a scale: the codes where they are, else 1, 2, …
    in the order shown, which stays as it is.
    """
    try:
        numbers = [int(code) for code in codes.values()]
    except ValueError:
        numbers = []
    if len(numbers) == len(codes) and numbers == sorted(set(numbers)):
        return dict(zip(codes, numbers, strict=True))
    values = {answer: n for n, answer in enumerate(codes, start=1)}
    told = ", ".join(f"{codes[answer]} → {value}" for answer, value in values.items())
    note.changed(
        _("The values of a scale must increase, so they are stored as %(codes)s.") % {"codes": told}
    )
    if len(numbers) == len(codes) > 1 and numbers == sorted(set(numbers), reverse=True):
        note.changed(_("The file scores this scale in reverse. Reverse it when you score it."))
    return values


def note_reversal(note: Note, text: str) -> None:
    """Note that a text of the file says that an item is scored in reverse."""
    if re.search(r"\brevers(e|ed)\b|\binvert(ed|ido|ida)\b|\bumgepolt\b", text, re.IGNORECASE):
        note.changed(
            _("It is reverse-scored in the file. If a score uses it, add reverse: %(text)s")
            % {"text": text.strip()}
        )


def flags(**fields: Any) -> dict[str, Any]:
    """Return the fields of an item that are set, without those that are not."""
    return {name: value for name, value in fields.items() if value}
