"""Consent: the text as it was shown, who agreed to it when, and who may not."""

import datetime
import hashlib
from typing import Literal

from django.db import IntegrityError, transaction

from experiments.definition.steps.consent import Consent
from experiments.models import ConsentReceipt, Participant
from surveys.documents import spoken

Answer = Literal["agreed", "too_young", "guardian"]


def may_agree(step: Consent, age: int | None, guardian: str) -> Answer:
    """Return whether somebody may agree by themself, is turned away, or needs a guardian's word
    that is not there.
    """
    if not step.minimum_age or (age is not None and age >= step.minimum_age):
        return "agreed"
    if step.minors == "refused":
        return "too_young"
    return "agreed" if guardian else "guardian"


def agree(
    participant: Participant,
    step: Consent,
    *,
    language: str,
    age: int | None = None,
    guardian: str = "",
    sharing: bool | None = None,
    now: datetime.datetime,
) -> ConsentReceipt:
    """Return the receipt of a participant's consent, made at the first call, with the texts as they
    were shown then; `sharing` is None where the step did not ask.
    """
    text = spoken(step.text, language)
    fields = {
        "language": language,
        "text": text,
        "text_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "guardian": guardian[:120],
        "sharing": sharing,
        "sharing_text": spoken(step.sharing, language) if sharing is not None else "",
        "agreed_at": now,
    }
    try:
        with transaction.atomic():
            receipt = ConsentReceipt.objects.create(
                participant=participant, step=step.key, version=step.version, **fields
            )
    except IntegrityError:
        return ConsentReceipt.objects.get(
            participant=participant, step=step.key, version=step.version
        )
    Participant.objects.filter(pk=participant.pk).update(age=age, language=language)
    participant.age, participant.language = age, language
    return receipt


def as_text(receipt: ConsentReceipt) -> str:
    study = receipt.participant.study
    lines = [
        receipt.text,
        "",
        "--",
        f"{study.title} ({study.slug}, version {study.version})",
        f"participant {receipt.participant.code}",
        f"consent {receipt.step}, version {receipt.version}, {receipt.language}",
        f"agreed {receipt.agreed_at.isoformat(timespec='seconds')}",
        f"sha256 of the text {receipt.text_sha256}",
    ]
    if receipt.guardian:
        lines.insert(-1, f"guardian {receipt.guardian}")
    if receipt.sharing is not None:
        lines[1:1] = ["", f"[{'x' if receipt.sharing else ' '}] {receipt.sharing_text}"]
    return "\n".join(lines) + "\n"
