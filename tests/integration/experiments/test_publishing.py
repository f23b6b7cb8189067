"""Studies in the database: drafts that may be half done, published versions that never change."""

import datetime

import msgspec
import pytest
from django.contrib.admin.models import LogEntry

from experiments import publishing, resources
from experiments.definition.shipped import shipped
from experiments.models import FrozenStudyError, Rehearsal, Study, StudyMember
from experiments.publishing import NotPublishableError, publish, store
from robots.models import FloorPlan
from robots.plans.floorplans import store_floor_plan
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError, ChangedMeanwhileError
from tests.support.paths import ROOT
from tests.support.people import person
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.study_site import cabin_with_giraff, robot_at

pytestmark = pytest.mark.django_db
NOW = datetime.datetime(2026, 5, 4, 10, 0, tzinfo=datetime.UTC)
OFFICE = ROOT / "robots/world/plans/office"
WHY = "It was rehearsed by hand in the laboratory."


def rehearsed(row: Study, **changes) -> Rehearsal:
    fields = {"sha256": row.sha256, "began_at": NOW, "finished_at": NOW, "passed": True}
    return Rehearsal.objects.create(study=row, **{**fields, **changes})


# --- drafts ---------------------------------------------------------------------------------------


def test_storing_the_same_study_twice_gives_one_row():
    assert store(small_study(), NOW).pk == store(small_study(), NOW).pk
    row = Study.objects.get()
    assert (row.slug, row.version, row.title) == ("cabin-study", 1, "Cabin")
    assert row.status == Study.Status.DRAFT


def test_a_draft_is_replaced_by_a_changed_definition_of_its_version():
    store(small_study(), NOW)
    row = store(small_study(title={"en": "Hut"}), NOW)
    assert Study.objects.get().title == "Hut"
    assert row.as_definition().title == {"en": "Hut"}


def test_a_half_done_draft_is_kept_with_its_problems():
    changed = small_study(conditions=[], slug="other", version=7)
    row = publishing.save_draft(store(small_study(), NOW), changed)
    assert (row.slug, row.version) == ("cabin-study", 1)
    assert "There is no condition; add at least one." in sentences(publishing.problems_of(row))


def test_saving_an_equal_definition_keeps_the_rehearsed_digest():
    row = store(small_study(), NOW)
    photo = {"checkpoint": 2, "mirror": "mirror", "radius": 1.5}
    courses = [{**STUDY["courses"][0], "zones": [], "photo": photo}]
    assert publishing.save_draft(row, small_study(courses=courses)).sha256 == row.sha256


def test_an_empty_study_has_the_usual_steps_and_lists_what_is_missing():
    row = publishing.begin_empty("mine", "My study", ["en", "es"], NOW)
    steps = [step.key for step in row.as_definition().steps]
    assert steps == ["consent", "about_you", "instructions", "task", "experience", "thanks"]
    assert "There is no condition; add at least one." in sentences(publishing.problems_of(row))
    asked = (
        "institution, duration, risks, retention, who gets copies, date of the publication, "
        "ethics approval, contact"
    )
    english = ", ".join(f"[[{name}]]" for name in asked.split(", "))
    found = [one for one in sentences(publishing.problems_of(row)) if "placeholders" in one]
    assert len(found) == 1
    assert found[0].startswith(
        f"Step consent: fill in the placeholders of the text. en: {english}; es: [[institución]], "
    )
    assert found[0].count("[[") == 16
    with pytest.raises(BadDefinitionError, match="There is a study mine already"):
        publishing.begin_empty("mine", "My study", ["en"], NOW)


@pytest.mark.parametrize(
    ("slug", "languages"), [("Not A Slug", ["en"]), ("mine", ["English!"]), ("link", ["en"])]
)
def test_an_empty_study_needs_a_right_name_and_languages(slug, languages):
    with pytest.raises(BadDefinitionError):
        publishing.begin_empty(slug, "My study", languages, NOW)
    assert not Study.objects.exists()


def test_a_consent_with_a_placeholder_is_not_published_and_names_it():
    cabin_with_giraff()
    consent = {"kind": "consent", "key": "consent", "title": {"en": "Consent"}}

    def stored(text):
        steps = [{**consent, "text": {"en": text}}, *STUDY["steps"]]
        return publishing.store(small_study(steps=steps), NOW)

    row = stored("Write to [[contact]]; see note [1].")
    found = "Step consent: fill in the placeholders of the text. en: [[contact]]."
    assert sentences(publishing.problems_of(row)) == [found]
    with pytest.raises(publishing.NotPublishableError):
        publishing.publish(row, None, WHY, NOW)
    assert publishing.problems_of(stored("Write to Ada; see note [1].")) == []


def test_a_consent_that_does_not_ask_about_publishing_data_is_confirmed():
    cabin_with_giraff()
    consent = {"kind": "consent", "key": "consent", "title": {"en": "Consent"}}
    consent["text"] = {"en": "Drive."}
    asking = {**consent, "sharing": {"en": "My data may be published."}}
    row = publishing.store(small_study(steps=[consent, *STUDY["steps"]]), NOW)
    with pytest.raises(publishing.NotPublishableError, match="whether data may be published"):
        publishing.publish(row, None, WHY, NOW)
    publishing.save_draft(row, small_study(steps=[asking, *STUDY["steps"]]))
    assert publishing.publish(Study.objects.get(), None, WHY, NOW).status == "published"


# --- problems here --------------------------------------------------------------------------------


def test_with_its_site_and_robot_it_may_be_published():
    cabin_with_giraff()
    assert resources.obstacles_here(small_study()) == []


def test_a_series_can_do_what_each_of_its_robots_can():
    plan = cabin_with_giraff()
    robot_at(plan, "lame", "giraff", capabilities=("velocity",))
    tilting = [{**condition, "actions": ["tilt"]} for condition in STUDY["conditions"]]
    found = sentences(resources.obstacles_here(small_study(conditions=tilting)))
    assert "Condition all_open: giraff cannot do the action tilt." in found


def test_the_shipped_studies_can_be_run_in_the_office():
    office = store_floor_plan(OFFICE)
    for name in ("giraff", "rhodon"):
        robot_at(office, name, name)
    for study in shipped().values():
        assert resources.obstacles_here(study) == []


# --- publishing -----------------------------------------------------------------------------------


def test_publishing_asks_for_a_rehearsal_that_passed_or_a_reason():
    cabin_with_giraff()
    row = store(small_study(), NOW)
    rehearsed(row, passed=False)
    rehearsed(row, sha256="of something else")
    rehearsed(row, finished_at=None)
    for reason in ("", "   later   "):
        with pytest.raises(NotPublishableError, match="No rehearsal of this definition has passed"):
            publish(row, None, reason, NOW)
    ada = person()
    published = publish(row, ada, WHY, NOW)
    assert (published.status, published.published_at) == (Study.Status.PUBLISHED, NOW)
    assert published.unrehearsed_reason == WHY
    assert WHY in LogEntry.objects.get(user=ada).change_message


def test_study_changed_since_it_was_read_is_not_published():
    cabin_with_giraff()
    row = store(small_study(), NOW)
    publishing.save_draft(row, small_study(title={"en": "Hut"}))
    with pytest.raises(NotPublishableError, match="has since been changed or published"):
        publish(row, None, WHY, NOW)


@pytest.fixture
def published():
    cabin_with_giraff()
    return publish(store(small_study(), NOW), None, WHY, NOW)


def test_a_published_version_never_changes(published):
    with pytest.raises(BadDefinitionError, match="make a new version"):
        store(small_study(title={"en": "Hut"}), NOW)
    with pytest.raises(ChangedMeanwhileError):
        publishing.save_draft(published, small_study(title={"en": "Hut"}))
    changes = (
        {"definition": msgspec.to_builtins(small_study(title={"en": "Hut"}))},
        {"slug": "other"},
        {"version": 2},
        {"status": Study.Status.DRAFT},
    )
    for change in changes:
        row = Study.objects.get(pk=published.pk)
        for name, value in change.items():
            setattr(row, name, value)
        with pytest.raises(FrozenStudyError):
            row.save()
    assert Study.objects.get().sha256 == published.sha256


def test_a_new_version_is_a_draft_with_the_same_settings(published):
    Study.objects.update(time_zone="Europe/Madrid", exclusive=True)
    copy = publishing.new_version(Study.objects.get(), NOW)
    assert (copy.version, copy.status) == (2, Study.Status.DRAFT)
    assert (copy.time_zone, copy.exclusive) == ("Europe/Madrid", True)
    assert publishing.new_version(published, NOW).version == 3


def test_publishing_a_new_version_closes_the_one_before(published):
    newer = publish(publishing.new_version(published, NOW), None, WHY, NOW)
    older = Study.objects.get(pk=published.pk)
    assert (older.status, older.closed_at) == (Study.Status.CLOSED, NOW)
    assert newer.status == Study.Status.PUBLISHED
    with pytest.raises(NotPublishableError, match="newer version"):
        publishing.reopen(older)


def test_first_user_of_a_study_becomes_its_only_owner():
    row = store(small_study(), NOW)
    ada = person()
    publishing.own(row, ada)
    publishing.own(row, person("bob"))
    (member,) = StudyMember.objects.all()
    assert (member.user, member.role) == (ada, StudyMember.Role.OWNER)


def test_a_site_without_a_plan_is_not_offered_for_courses():
    FloorPlan.objects.filter(pk=cabin_with_giraff().pk).update(plan={})
    assert resources.sites() == {}
