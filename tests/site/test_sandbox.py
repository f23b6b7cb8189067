"""A sandbox: what goes into it, and what becomes of it when its parts do not all live to its end."""

from pathlib import Path

import pytest
from django.utils import timezone

from accounts.models import User
from experiments import publishing
from experiments.models import Study
from experiments.shipped import shipped
from robots.models import FloorPlan, Robot
from surveys.models import Questionnaire
from telepresence_site.demo.children import StartFailed
from telepresence_site.rehearsing import sandbox
from tests.support.site import wait_for


@pytest.mark.django_db(transaction=True)
def test_a_published_study_is_played_where_nobody_knows_who_published_it(tmp_path, settings):
    settings.VAR_DIR, settings.CREDENTIALS_DIR = tmp_path, tmp_path / "credentials"
    row = publishing.store(shipped()["exploration"], timezone.now())
    Study.objects.update(status=Study.Status.PUBLISHED, published_by=User.objects.create(username="researcher"))
    published = Study.objects.get()
    sandbox.pack(published, tmp_path)
    assert published.published_by is not None
    for model in (Study, Questionnaire, FloorPlan, User):
        model.objects.all().delete()
    unpacked = sandbox.unpack()
    assert (unpacked.pk, unpacked.sha256, unpacked.status) == (row.pk, row.sha256, Study.Status.DRAFT)
    assert {robot.name for robot in Robot.objects.all()} == {"giraff", "rhodon"}


def test_a_part_that_ends_meanwhile_fails_the_play_with_its_last_words(tmp_path, settings, monkeypatch):
    settings.VAR_DIR = tmp_path
    started = []

    def start(children, _definition, _sites):
        started.append(children)
        children.start("web server", ["-c", "print('no memory left'); raise SystemExit(3)"])
        return "http://127.0.0.1:1"

    monkeypatch.setattr(sandbox, "_start", start)
    with pytest.raises(StartFailed, match=r"The web server ended meanwhile \(3\): no memory left"), sandbox.running(shipped()["exploration"], Path()):
        wait_for(started[0].ended, 20, "the end of the child")
    assert started[0].running == []
