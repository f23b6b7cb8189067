"""The demo's study: the paper's, published, so that visitors can take part in it at once."""

import datetime

import msgspec
from django.db import transaction

from accounts.models import User
from experiments import publishing
from experiments.definition.problems import parse
from experiments.definition.shipped import shipped
from experiments.models import Study, StudyMember
from telepresence_site.demo.seed import RESEARCHER

SLUG = "exploration"
# The paper's robots were real, the demo's are not: the consent must say so.
SIMULATED = (
    ("a real robot in a real building", "a simulated robot in a simulated building"),
    ("un robot real en un edificio real", "un robot simulado en un edificio simulado"),
    ("Drive a robot through an office far away", "Drive a simulated robot through an office"),
    ("Conduce un robot por una oficina lejana", "Conduce un robot simulado por una oficina"),
)
REASON = "It comes with the demo, whose robots and site it was made for."


def publish_study(now: datetime.datetime) -> str:
    """Publish the study unless a version of it exists, and return its name.

    Raises:
        NotPublishableError: the robots have not sent their factsheets yet.
    """
    if not Study.objects.filter(slug=SLUG).exists():
        researcher = User.objects.get(username=RESEARCHER)
        document = msgspec.json.encode(shipped()[SLUG]).decode()
        for real, simulated in SIMULATED:
            document = document.replace(real, simulated)
        with transaction.atomic():  # leaves no draft if it cannot be published yet
            row = publishing.store(parse(document.encode()), now)
            row.entry = Study.Entry.CODE  # a participant of the demo has no account
            row.save(update_fields=["entry"])
            StudyMember.objects.get_or_create(
                slug=SLUG, user=researcher, defaults={"role": StudyMember.Role.OWNER}
            )
            publishing.publish(row, researcher, REASON, now, is_confirmed=True)
    return SLUG
