"""The demo's ready study: the paper's, published, so that its link works and its figures can be
drawn the same hour.
"""

import datetime

import msgspec
from django.db import transaction

from accounts.models import User
from experiments import publishing
from experiments.definition.problems import parse
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from experiments.models import Study, StudyMember
from telepresence_site.demo.seed import RESEARCHER

SLUG = "exploration"
# The paper's robots were real. The demo's are not, and nobody is to consent to anything else.
SIMULATED = (
    ("a real robot in a real building", "a simulated robot in a simulated building"),
    ("un robot real en un edificio real", "un robot simulado en un edificio simulado"),
    ("Drive a robot through an office far away", "Drive a simulated robot through an office"),
    ("Conduce un robot por una oficina lejana", "Conduce un robot simulado por una oficina"),
)
REASON = "It comes with the demo, whose robots and site it was made for."


def publish_study(now: datetime.datetime) -> str:
    """Publish the study unless some version of it is there already, and return its name.

    Needs the robots to have said what they are.

    Raises:
        NotPublishableError: they have not, yet.
    """
    if not Study.objects.filter(slug=SLUG).exists():
        researcher = User.objects.get(username=RESEARCHER)
        with transaction.atomic():  # what cannot be published yet is not left behind as a draft
            row = publishing.store(_simulated(shipped()[SLUG]), now)
            row.entry = Study.Entry.CODE  # whoever tries the demo has no account
            row.save(update_fields=["entry"])
            StudyMember.objects.get_or_create(
                slug=SLUG, user=researcher, defaults={"role": StudyMember.Role.OWNER}
            )
            publishing.publish(row, researcher, REASON, now)
    return SLUG


def _simulated(study: StudyDefinition) -> StudyDefinition:
    """Return a study that says of its robots what they are in the demo."""
    document = msgspec.json.encode(study).decode()
    for real, simulated in SIMULATED:
        document = document.replace(real, simulated)
    return parse(document.encode())
