"""Times on the pages of a study: one format, and always the time zone."""

import re

import pytest
from django.urls import reverse

from experiments import publishing
from experiments.models import Study
from tests.integration.experiments.test_publishing import NOW
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies.participants import comer
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db
ZONED = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC")
BARE = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d(?! UTC|:)|[ap]\.m\.|de \d{4} a las")


@pytest.mark.parametrize("language", ["en", "es"])
def test_pages_of_a_study_name_the_zone_of_every_time(client, language):
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    study = publishing.store(small_study(), NOW)
    participant = comer(study, person("ada"))
    Study.objects.update(status=Study.Status.PUBLISHED, published_at=NOW)
    pages = [
        reverse("admin:experiments_study_change", args=[study.pk]),
        reverse("admin:experiments_study_changelist"),
        reverse("admin:experiments_participant_change", args=[participant.pk]),
        reverse("admin:experiments_participant_changelist"),
    ]
    for page in pages:
        text = read(client.get(page, headers={"Accept-Language": language})).text
        assert ZONED.search(text), page
        assert not BARE.search(text), (page, BARE.search(text))
