"""The study builder: a study made page by page, without JSON and without JavaScript."""

import math

import msgspec
import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.urls import reverse

from experiments import publishing
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from experiments.models import ParticipantKind, Study
from robots.models import FloorPlan, Robot
from surveys import questionnaires
from surveys.document_forms.problem_text import sentences
from surveys.models import Questionnaire
from tests.integration.experiments.test_publishing import NOW
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies.participants import comer
from tests.support.studies.questionnaires import defined, item
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.study_pages import form_of
from tests.support.studies.study_site import cabin_with_giraff
from tests.support.studies.wizard_study import wizard_document

pytestmark = pytest.mark.django_db
SECTIONS = (
    *("about", "recruitment", "design", "steps", "conditions", "courses", "analyses", "plan"),
    *("rules", "wizard", "coding"),
)


@pytest.fixture
def boss(client):
    user = person("boss", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


@pytest.fixture
def study(boss):
    cabin_with_giraff()
    return publishing.store(small_study(), NOW)


def section(row: Study, name: str, index: int | None = None) -> str:
    if index is None:
        return reverse("admin:experiments_study_section", args=[row.pk, name])
    return reverse("admin:experiments_study_part", args=[row.pk, name, index])


def send(client, address: str, do: str = "save", **changes):
    """Fill in the form of a page and press one of its buttons."""
    data = form_of(client.get(address))
    data["do"] = do
    for name, value in changes.items():
        if isinstance(value, list):
            data.setlist(name.replace("__", "."), value)
        else:
            data[name.replace("__", ".")] = value
    return client.post(address, dict(data.lists()))


def untick(client, address: str, box: str) -> None:
    form = form_of(client.get(address))
    del form[box]
    client.post(address, dict(form.lists()) | {"do": "save"})


def items_of(client, address: str, **headers) -> list[str]:
    """The texts of the items of the lists on a page, among them the problems."""
    return [e.text for e in read(client.get(address, **headers)).all("li")]


def hrefs(page) -> list[str | None]:
    return [e.attributes.get("href") for e in page.all("a")]


def press(client, row: Study, name: str, do: str, **more):
    """Press a button of a list, such as `add:` or `remove:0`."""
    return client.post(section(row, name), {"do": do, "sha256": Study.objects.get().sha256}, **more)


def stored():
    return Study.objects.get().as_definition()


def wrong():
    return sentences(publishing.problems_of(Study.objects.get()))


# --- building -------------------------------------------------------------------------------------


def test_a_whole_study_without_problems_is_built_without_json(client, boss):
    cabin_with_giraff()
    row = publishing.begin_empty("mine", "My study", ["en"], NOW)
    texts = {"consent": {"text__en": "You will drive."}, "debrief": {"text__en": "Thanks."}}
    for n, step in enumerate(row.as_definition().steps):
        send(client, section(row, "steps", n), **texts.get(type(step).__name__.lower(), {}))
    send(client, section(row, "steps", 2), "add:leaves")
    send(client, section(row, "steps", 2), leaves__0__text__en="Drive with the arrow keys.")
    for n, closed in enumerate(([], ["door"])):
        answer = press(client, row, "conditions", "add:")
        assert answer.headers["Location"] == section(row, "conditions", n)
        send(client, section(row, "conditions", n), title__en=f"Number {n}", doors_closed=closed)
    press(client, row, "courses", "add:")
    (first,) = stored().courses[0].checkpoints
    assert (first.number, first.x, first.y) == (0, 0.5, 2.0)
    send(client, section(row, "courses", 0), "add:checkpoints", at="3 1")
    send(client, section(row, "courses", 0), "add:checkpoints", at="7 2")
    assert wrong() == []
    condition = stored().conditions[1]
    found = (condition.key, condition.robot, condition.site, condition.doors_closed)
    assert found == ("condition_2", "giraff", "cabin", ("door",))


def designed(client, row: Study, *kinds: str) -> str:
    """Add factors on the page of the design, and return its address."""
    page = section(row, "design")
    for kind in kinds:
        assert send(client, page, f"add:factors:{kind}").status_code == 302
    return page


def test_design_page_makes_the_conditions_of_two_factors(client, boss):
    cabin_with_giraff()
    study = publishing.begin_empty("mine", "My study", ["en"], NOW)
    page = designed(client, study, "video_delay", "assist")
    sent = {
        "factors__0__design": "within",
        "factors__0__levels__0__sets__video_delay": "0",
        "factors__0__levels__1__sets__video_delay": "0.3",
        "factors__1__design": "within",
        "factors__1__levels__0__title__en": "None",
        "factors__1__levels__0__sets__assist": "off",
        "factors__1__levels__1__title__en": "Long",
        "factors__1__levels__1__sets__assist": "steer",
    }
    assert send(client, page, **sent).status_code == 302
    found = stored()
    assert [one.key for one in found.factors] == ["delay", "assist"]
    assert [level.title["en"] for level in found.factors[0].levels] == ["0 ms", "300 ms"]
    assert [level.key for level in found.factors[1].levels] == ["off", "steer"]
    assert [one.title["en"] for one in found.conditions] == [
        *("0 ms, None", "0 ms, Long", "300 ms, None", "300 ms, Long")
    ]
    late = found.condition("delay_300_ms_steer")
    assert (late.network.video.delay, late.assist) == (0.3, "steer")
    assert found.condition("delay_0_ms_off").network.video is None
    assert found.allocation.design == "within"
    repeated = [step.kind for step in found.steps if step.repeat]
    assert repeated == ["task", "questionnaire"]
    assert [(one.robot, one.site) for one in found.courses] == [("giraff", "cabin")]
    text = read(client.get(page)).text
    assert "4 conditions · each participant does 4 · 4 orders of conditions" in text
    listed = read(client.get(section(study, "conditions"))).text
    assert "300 ms, Long" in listed
    assert "delay of the video: 300 ms" in listed


def test_renaming_a_level_renames_it_wherever_it_is_used(client, study):
    page = designed(client, study, "assist")
    press(client, study, "analyses", "add:")
    analysis = section(study, "analyses", 0)
    send(client, page, factors__0__design="within")
    send(client, analysis, test="mixed", measures=["task_time"], effects=["assist"])
    conditions = [one.key for one in stored().conditions]
    send(client, page, factors__0__key="help", factors__0__levels__1__key="much")
    found = stored()
    assert [one.levels["help"] for one in found.conditions][1] == "much"
    assert found.analyses[0].effects == ("help",)
    assert found.conditions[0].key == conditions[0]
    assert not [text for text in wrong() if "there is no" in text]


def test_conditions_keep_what_was_written_when_a_factor_is_added(client, study):
    designed(client, study, "assist")
    send(client, section(study, "conditions", 0), title__en="Mine", idle_seconds="60")
    send(client, section(study, "design"), "add:factors:interface")
    found = stored().conditions
    assert len(found) == 4
    assert {one.title["en"] for one in found} >= {"Mine"}
    assert all(one.idle_seconds == 60.0 for one in found[:2])


def test_settings_that_conditions_share_are_changed_for_all_at_once(client, study):
    page = designed(client, study, "assist")
    send(client, page, shared__controllers=["gamepad"])
    assert {one.controllers for one in stored().conditions} == {("gamepad",)}
    assert "shared.assist" not in form_of(client.get(page))


def test_settings_of_a_level_are_fixed_on_the_page_of_a_condition(client, study):
    page = designed(client, study, "assist")
    send(client, page, factors__0__levels__1__sets__assist="steer")
    condition = section(study, "conditions", 1)
    assert "Set by the level" in read(client.get(condition)).text
    assert send(client, condition, title__en="Assisted").status_code == 302
    assert stored().conditions[1].assist == "steer"


def test_design_without_factors_is_chosen_with_the_assignment(client, study):
    page = section(study, "design")
    assert "allocation.design" in form_of(client.get(page))
    send(client, page, allocation__design="within", allocation__quota="5")
    assert (stored().allocation.design, stored().allocation.quota) == ("within", 5)
    assert stored().task.repeat
    designed(client, study, "assist")
    assert "allocation.design" not in form_of(client.get(page))


def test_questionnaire_asked_once_in_a_within_study_must_be_confirmed(client, study):
    send(client, section(study, "design"), allocation__design="within")
    asked = section(study, "steps", 1)
    untick(client, asked, "repeat")
    publish = reverse("admin:experiments_study_publish", args=[study.pk])
    reason = {"reason": "A pilot has shown that it works."}
    refused = client.post(publish, reason)
    assert "answer this questionnaire only once" in read(refused).text
    assert Study.objects.get().status == Study.Status.DRAFT
    client.post(publish, reason | {"confirmed": "on"})
    assert Study.objects.get().status == Study.Status.PUBLISHED


def test_assignment_is_balanced_by_answers_known_before_the_first_drive(client, study):
    design = section(study, "design")
    send(client, design, "add:allocation.balance", allocation__best_probability="0.9")
    age = {"allocation__balance__0__item": "age", "allocation__balance__0__limits": "30, 50"}
    send(client, design, allocation__balancing="strata", **age)
    allocation = stored().allocation
    assert (allocation.best_probability, allocation.balancing) == (0.9, "strata")
    assert [(one.item, one.limits) for one in allocation.balance] == [("age", (30.0, 50.0))]
    assert form_of(client.get(design))["allocation.balance.0.limits"] == "30, 50"
    assert any("the consent does not ask the age" in one for one in wrong())
    send(client, design, allocation__balance__0__item="experience.q1")
    assert any("not asked before the first drive" in one for one in wrong())


def test_recruitment_screening_and_appointments_are_built_without_json(client, study):
    page = section(study, "recruitment")
    send(client, page, "add:screening")
    send(client, page, "add:answer_quotas")
    filled = {"recruiting__on": "on", "recruiting__site": "prolific", "devices": ["computer"]}
    filled |= {"recruiting__codes__done": "C1ABC"}
    filled |= {"appointments__on": "on", "appointments__minutes": "45"}
    asked = {"questionnaire": "ict", "item": "gender"}
    for part, rule in (
        ("screening", {"answers": "woman, man"}),
        ("answer_quotas", {"answers": "man", "most": "12"}),
    ):
        filled |= {f"{part}__0__{name}": value for name, value in (asked | rule).items()}
    assert send(client, page, **filled).status_code == 302
    made = stored()
    assert made.recruiting is not None
    assert (made.recruiting.site, made.recruiting.codes.done) == ("prolific", "C1ABC")
    assert made.devices == ("computer",)
    assert made.screening[0].answers == ("woman", "man")
    assert (made.answer_quotas[0].answers, made.answer_quotas[0].most) == (("man",), 12)
    assert made.appointments is not None
    assert made.appointments.minutes == 45
    assert "Who returns there" in read(client.get(page)).text
    send(client, page, "remove:screening:0")
    assert stored().screening == ()


def test_speed_above_the_top_speed_is_refused_with_the_top_speed(client, study):
    page = section(study, "conditions", 0)
    answer = send(client, page, speed__linear="9")
    assert answer.status_code == 422
    assert "The speed limit of 9 m/s is above the top speed of giraff" in read(answer).text
    assert stored().conditions[0].speed.linear is None
    assert send(client, page, speed__linear="0.2").status_code == 302


def test_lists_call_questionnaires_by_their_titles(client, study):
    title = questionnaires.shipped()["experience"].title["en"]
    assert f"{title}, version 1" in read(client.get(section(study, "steps"))).text


def test_the_builder_states_where_a_task_ends_and_the_alternative(client, study):
    text = read(client.get(section(study, "steps", 0))).text
    assert "docked the robot at the charging station. Otherwise the drive ends" in text
    course = read(client.get(section(study, "courses", 0))).text
    assert "begins and ends at checkpoint 0" in course


def test_two_questions_on_the_age_are_reported_on_both_pages_with_links(client, boss):
    cabin_with_giraff()
    questionnaires.store(defined([item("number", "years", text={"en": "How old are you?"})]), NOW)
    title = {"en": "You"}
    steps = [
        {"kind": "consent", "key": "consent", "title": title, "text": {"en": "Yes?"}},
        {"kind": "form", "key": "you", "title": title, "questionnaire": "test"},
        *STUDY["steps"],
    ]
    row = publishing.store(small_study(steps=steps), NOW)
    twice = "asked for their age twice"
    for index, other in ((0, 1), (1, 0)):
        page = read(client.get(section(row, "steps", index)))
        assert twice in page.text
        assert "“How old are you?”" in page.text
        links = [e.attributes["href"] for e in page.all("a") if e.text == "Go there"]
        assert links == [section(row, "steps", other)]
    assert twice not in read(client.get(section(row, "steps", 2))).text
    send(client, section(row, "steps", 0), minimum_age="0")
    assert twice not in read(client.get(section(row, "steps", 1))).text


def test_a_page_of_the_instructions_is_limited_to_ticked_conditions(client, study):
    address = press(client, study, "steps", "add:instructions").headers["Location"]
    send(client, address, "add:leaves", title__en="Read")
    send(client, address, leaves__0__text__en="Mind the door.", leaves__0__conditions=["shut"])
    assert stored().steps[-1].leaves[0].conditions == ("shut",)
    assert "participants are assigned to their condition when" in read(client.get(address)).text


def test_an_analysis_is_declared_without_json(client, study):
    press(client, study, "analyses", "add:")
    page = section(study, "analyses", 0)
    send(client, page, key="doors", title__en="Doors", measures=["task_time", "experience.q1"])
    send(client, page, "add:contrasts")
    sides = {"contrasts__0__first": ["shut"], "contrasts__0__second": ["all_open"]}
    send(client, page, contrasts__0__title__en="Shut", test="ranks", **sides)
    (analysis,) = stored().analyses
    assert (analysis.key, analysis.test) == ("doors", "ranks")
    assert analysis.measures == ("task_time", "experience.q1")
    assert (analysis.contrasts[0].first, analysis.contrasts[0].second) == (("shut",), ("all_open",))
    assert wrong() == []
    send(client, page, measures=["task_tim", "experience.q99"])
    assert wrong() == [
        "Analysis doors: there is no metric task_tim.",
        "Analysis doors: the questionnaire has no item, topic or score experience.q99.",
    ]


def test_a_plan_is_declared_without_json(client, study):
    press(client, study, "analyses", "add:")
    send(client, section(study, "analyses", 0), key="doors", title__en="Doors", measures=["stops"])
    page = section(study, "plan")
    send(client, page)
    assert stored().plan is None
    send(client, page, "add:hypotheses")
    assert "Plan: hypothesis h1: it has no text." in wrong()
    send(client, page, hypotheses__0__direction="different:doors::")
    assert stored().plan.hypotheses[0].text == "Stops – it differs between the conditions."
    send(client, page, "add:attention_checks")
    check = {"questionnaire": "experience", "item": "q9", "answer": "7"}
    send(client, page, **{f"attention_checks__0__{key}": value for key, value in check.items()})
    assert wrong() == ["Plan: attention check experience.q9: the questionnaire has no such item."]
    send(client, page, attention_checks__0__item="q1")
    assert wrong() == ["Plan: attention check experience.q1: its answers are -1, -2, 0, 1, 2."]
    send(client, page, attention_checks__0__answer="2", participants="40", faults=["gap"])
    plan = stored().plan
    assert plan.faults == ("gap",)
    assert (plan.hypotheses[0].analysis, plan.participants) == ("doors", 40)
    assert wrong() == []


@pytest.mark.nightly
def test_a_script_is_written_without_json(client, study):
    send(client, section(study, "wizard"), wizard__on="on", wizard__conditions=["shut"])
    assert stored().wizard.conditions == ("shut",)
    press(client, study, "stages", "add:")
    page = section(study, "stages", 0)
    for kind in ("", "place", "dock", "undock", "tilt", "turn", "drive"):
        send(client, page, f"add:steps:{kind}")
    assert send(client, page, "add:steps:fly").status_code == 302
    names = {f"steps__{n}__title__en": f"Step {n}" for n in range(7)}
    words = {"steps__0__line__en": "Hello, I am here.", "steps__0__shortcut": "1"}
    send(client, page, title__en="Welcome", steps__4__move__angle="17", **names, **words)
    (stage,) = stored().wizard.stages
    assert len({step.key for step in stage.steps}) == 7
    assert (stage.steps[0].line, stage.steps[0].move) == ({"en": "Hello, I am here."}, None)
    moves = [step.move.__struct_config__.tag for step in stage.steps[1:]]
    assert moves == ["place", "dock", "undock", "tilt", "turn", "drive"]
    assert stage.steps[4].move.angle == math.radians(17)
    send(client, page, "remove:steps:1")  # the cabin has no place to go to
    assert wrong()[0].startswith("The debriefing must tell")
    # the settings of the script have a page of their own, and saving it leaves the stages alone
    assert send(client, section(study, "wizard"), wizard__blind="on").status_code == 302
    assert (stored().wizard.blind, len(stored().wizard.stages[0].steps)) == (True, 6)
    assert read(client.get(section(study, "wizard"))).text.count("6 steps") == 1
    press(client, study, "stages", "copy:0")
    assert not [text for text in wrong() if "stands" in text]
    untick(client, section(study, "wizard"), "wizard.on")
    assert stored().wizard is None


def test_a_coding_scheme_is_written_without_json(client, study):
    send(client, section(study, "coding"), coding__on="on", coding__bin="0.5")
    assert wrong() == ["The coding scheme has no codes."]
    press(client, study, "codes", "add:")
    page = section(study, "codes", 0)
    send(client, page, "add:modifiers", code="help", name="Asks for help", key="h")
    values = {"modifiers__0__name": "whom", "modifiers__0__values": "the robot, a visitor"}
    send(client, page, description="Asks anybody.", **values)
    (code,) = stored().coding.codes
    assert (code.code, code.name, code.kind, code.key) == ("help", "Asks for help", "point", "h")
    assert code.modifiers[0].values == ("the robot", "a visitor")
    assert stored().coding.bin == 0.5
    assert wrong() == []
    press(client, study, "codes", "copy:0")
    assert [one.code for one in stored().coding.codes] == ["help", "help_2"]
    assert wrong() == ["Name “asks for help” appears 2 times."]
    shown = read(client.get(section(study, "coding"))).text
    assert "Asks for help" in shown
    assert "appears 2 times" in shown


def test_a_text_of_a_script_that_is_missing_leads_to_its_stage(client, study):
    whole = {**wizard_document(), "languages": ["en", "es"]}
    row = publishing.save_draft(study, msgspec.convert(whole, StudyDefinition))
    shown = read(client.get(section(row, "stages", 0))).text
    assert "Greet · Line (Spanish) is missing." in shown


@pytest.mark.nightly
@pytest.mark.parametrize("slug", ["exploration", "assistance"])
def test_saving_every_page_as_it_is_changes_nothing(client, boss, slug):
    row = publishing.store(shipped()[slug], NOW)
    definition = row.as_definition()
    whole = ("about", "recruitment", "design", "rules", "plan")
    addresses = [section(row, name) for name in whole]
    addresses += [
        section(row, name, n)
        for name in ("steps", "conditions", "courses", "analyses")
        for n in range(len(getattr(definition, name)))
    ]
    for address in addresses:
        assert send(client, address).status_code == 302, address
        assert (address, Study.objects.get().sha256) == (address, row.sha256)
    assert stored() == definition


def test_invalid_input_is_an_error_of_its_field_and_no_input_is_lost(client, study):
    answer = send(client, section(study, "steps", 0), minutes="soon", title__en="Drive round")
    assert answer.status_code == 422
    page = read(answer)
    values = {e.attributes.get("name"): e.attributes.get("value") for e in page.all("input")}
    assert (values["minutes"], values["title.en"]) == ("soon", "Drive round")
    assert [e.text for e in page.all("li") if "not a number" in e.text] == ["This is not a number."]
    assert stored() == small_study()


def test_an_unfinished_part_is_saved_with_its_problems_above_the_form(client, study):
    answer = send(client, section(study, "conditions", 0), title__en="", controllers=[])
    assert answer.status_code == 302
    found = items_of(client, section(study, "conditions", 0))
    undrivable = (
        "Condition all_open: there is no controller and no action that sends the robot (places, map"
        " or follow): nobody could drive."
    )
    assert undrivable in found
    assert "all_open · Title (English) is missing." in found


def test_a_text_missing_in_several_languages_is_one_problem_with_labels_of_the_page(client, boss):
    row = publishing.begin_empty("mine", "My study", ["en", "es"], NOW)
    found = items_of(client, section(row, "steps"))
    assert found.count("Thanks · Text (English, Spanish) is missing.") == 1
    assert not [text for text in found if "has no text in" in text]
    send(client, section(row, "steps", 0), text__en="You will drive.", text__es="")
    page = read(client.get(section(row, "steps", 0)))
    assert page.text.count("is missing") == 1
    assert "Consent · Text (Spanish) is missing." in page.text
    send(client, section(row, "steps", 2), "add:leaves")
    found = items_of(client, section(row, "steps", 2))
    assert "How it works · Page 1 · Text (English, Spanish) is missing." in found


def test_problems_are_in_the_language_of_the_page(client, boss):
    row = publishing.store(small_study(), NOW)
    found = items_of(client, section(row, "courses", 0), headers={"Accept-Language": "es"})
    assert "Recorrido por el plano de giraff en cabin: no existe el lugar cabin." in found


def test_languages_are_chosen_by_their_names(client, study):
    page = read(client.get(section(study, "about")))
    boxes = [e.attributes for e in page.all("input") if e.attributes.get("name") == "languages"]
    assert {box["value"]: "checked" in box for box in boxes} == {"en": True, "es": False}
    assert {"English", "Spanish"} <= {e.text.strip() for e in page.all("label")}
    assert "Title (English)" in {" ".join(e.text.split()) for e in page.all("label")}


def test_a_study_keeps_one_language_at_least(client, study):
    answer = send(client, section(study, "about"), languages=[])
    assert answer.status_code == 422
    assert "Choose at least one language." in read(answer).text
    assert stored() == small_study()


def test_parts_are_added_copied_moved_and_removed(client, study):
    def do(what: str):
        return press(client, study, "conditions", what)

    assert do("copy:0").headers["Location"] == section(study, "conditions", 1)
    assert [one.key for one in stored().conditions] == ["all_open", "all_open_2", "shut"]
    do("down:0")
    assert [one.key for one in stored().conditions] == ["all_open_2", "all_open", "shut"]
    do("remove:0")
    do("up:1")
    assert [one.key for one in stored().conditions] == ["shut", "all_open"]
    large = "remove:99999999999999999999"
    for nonsense in ("remove:7", "remove:x", "burn:0", "", "up:0", "remove:-1", large):
        do(nonsense)
    assert [one.key for one in stored().conditions] == ["shut", "all_open"]


@pytest.mark.parametrize("page", ["about", "rules", "plan"])
def test_a_list_of_another_page_is_not_changed_by_a_hand_made_button(client, study, page):
    before = stored()
    for name in ("steps", "factors", "conditions"):
        assert send(client, section(study, page), f"add:{name}").status_code == 302
    assert stored() == before


@pytest.mark.parametrize(
    "kind", ["consent", "form", "instructions", "practice", "questionnaire", "debrief"]
)
def test_a_step_of_every_kind_is_added_and_shown(client, study, kind):
    answer = press(client, study, "steps", f"add:{kind}", follow=True)
    assert answer.status_code == 200
    added = [one for one in stored().steps if one.key not in {"task", "experience"}]
    assert [one.kind for one in added] == [kind]


def test_new_steps_are_placed_where_they_belong_and_offered_only_if_allowed(client, study):
    for kind in ("debrief", "consent", "instructions"):
        assert press(client, study, "steps", f"add:{kind}").status_code == 302
    kinds = [one.kind for one in stored().steps]
    assert kinds == ["consent", "task", "questionnaire", "instructions", "debrief"]
    page = read(client.get(section(study, "steps")))
    buttons = {e.attributes.get("value") for e in page.all("button")}
    assert not {"add:debrief", "add:consent", "add:task"} & buttons
    assert "add:practice" in buttons
    assert press(client, study, "steps", "add:task").status_code == 404


def test_own_picture_is_uploaded_for_a_page_of_the_instructions(client, study):
    address = press(client, study, "steps", "add:instructions").headers["Location"]
    send(client, address, "add:leaves", title__en="Read")
    png = b"\x89PNG\r\n\x1a\n" + bytes(50)
    send(client, address, leaves__0__picture__file=SimpleUploadedFile("lab.png", png))
    name = stored().steps[-1].leaves[0].picture
    answer = client.get(reverse("study_media", args=[name]))
    assert (answer.content, answer["Content-Type"]) == (png, "image/png")
    parts = {
        "bytes=0-1": (206, png[:2], "bytes 0-1/58"),
        "bytes=50-": (206, png[50:], "bytes 50-57/58"),
        "bytes=50-900": (206, png[50:], "bytes 50-57/58"),
        "bytes=-3": (206, png[-3:], "bytes 55-57/58"),
        "bytes=58-": (416, b"", "bytes */58"),
        "bytes=-": (200, png, None),
        "bytes=0-1,4-5": (200, png, None),
    }
    for asked, expected in parts.items():
        part = client.get(reverse("study_media", args=[name]), headers={"range": asked})
        assert (part.status_code, part.content, part.get("Content-Range")) == expected, asked
    assert "lab.png" in read(client.get(address)).text
    wrong_type = SimpleUploadedFile("lab.svg", b"<svg/>")
    refused = send(client, address, leaves__0__picture__file=wrong_type)
    assert "Choose a PNG" in read(refused).text
    large = SimpleUploadedFile("large.png", png + bytes(2 * 1024 * 1024))
    assert "at most 2 MB" in read(send(client, address, leaves__0__picture__file=large)).text
    assert stored().steps[-1].leaves[0].picture == name


def test_pictures_of_a_deleted_study_are_deleted_unless_another_study_shows_them(client, study):
    address = press(client, study, "steps", "add:instructions").headers["Location"]
    for number, name in enumerate(("a.png", "b.png")):
        send(client, address, "add:leaves")
        png = SimpleUploadedFile(name, b"\x89PNG\r\n\x1a\n" + name.encode())
        send(client, address, **{f"leaves__{number}__picture__file": png})
    shown, unshown = (leaf.picture for leaf in stored().steps[-1].leaves)
    steps = list(msgspec.to_builtins(stored().steps))
    leaf = {**steps[-1]["leaves"][0], "text": {"en": "Read"}}
    steps[-1] = {**steps[-1], "title": {"en": "Read"}, "leaves": [leaf]}
    publishing.store(small_study(slug="another", steps=steps), NOW)
    Study.objects.get(slug=study.slug).delete()
    assert client.get(reverse("study_media", args=[shown])).status_code == 200
    assert client.get(reverse("study_media", args=[unshown])).status_code == 404


def test_leaves_are_moved_with_what_was_typed_in_them(client, study):
    press(client, study, "steps", "add:instructions")
    address = section(study, "steps", 2)
    send(client, address, "add:leaves")
    send(client, address, "add:leaves", leaves__0__text__en="first")
    send(client, address, "up:leaves:1", leaves__1__text__en="second")
    assert [leaf.text["en"] for leaf in stored().steps[2].leaves] == ["second", "first"]
    send(client, address, "remove:leaves:0")
    assert [leaf.text["en"] for leaf in stored().steps[2].leaves] == ["first"]


def test_removing_a_language_removes_its_texts_and_adding_one_asks_for_them(client, boss):
    row = publishing.store(shipped()["assistance"], NOW)
    send(client, section(row, "about"), languages="en")
    assert list(publishing.problems(stored())) == []
    send(client, section(row, "about"), languages="en, fr")
    page = read(client.get(section(row, "steps", 0)))
    assert "fr" in [e.attributes.get("lang") for e in page.all("textarea")]
    assert any("has no text in fr" in text for text in sentences(publishing.problems(stored())))


def test_of_two_simultaneous_edits_the_second_sees_both(client, study):
    mine = form_of(client.get(section(study, "about")))
    send(client, section(study, "steps", 0), minutes="7")
    mine["title.en"] = "Hut"
    answer = client.post(section(study, "about"), dict(mine.lists()))
    assert answer.status_code == 422
    assert "someone else changed this draft" in read(answer).text
    again = form_of(answer)
    assert again["title.en"] == "Hut"
    assert client.post(section(study, "about"), dict(again.lists())).status_code == 302
    assert (stored().title, stored().task.minutes) == ({"en": "Hut"}, 7.0)


def test_a_list_that_someone_else_has_changed_is_not_changed(client, study):
    stale = {"do": "remove:0", "sha256": "of before"}
    answer = client.post(section(study, "steps"), stale, follow=True)
    assert "someone else changed this draft" in read(answer).text
    assert stored() == small_study()


def test_pages_of_unknown_parts_are_not_found(client, study):
    parts = (("nonsense", None), ("steps", 9), ("about", 0), ("nonsense", 0))
    for address in (section(study, *part) for part in parts):
        assert client.get(address).status_code == 404
        assert client.post(address, {"do": "save"}).status_code == 404
    assert press(client, study, "steps", "add:nonsense").status_code == 404


@pytest.mark.parametrize(
    "forged", [{"slug": "other"}, {"version": "7"}, {"format": "2"}, {"steps": "[]"}]
)
def test_name_version_and_other_parts_cannot_be_slipped_in(client, study, forged):
    send(client, section(study, "about"), **forged)
    assert (stored(), Study.objects.get().slug) == (small_study(), "cabin-study")


# --- courses --------------------------------------------------------------------------------------


def check(client, row: Study, **changes):
    data = form_of(client.get(section(row, "courses", 0))).dict()
    data |= {name.replace("__", "."): value for name, value in changes.items()}
    return client.post(reverse("admin:experiments_study_check", args=[row.pk, "courses", 0]), data)


def test_the_course_page_shows_the_floor_plan(client, study):
    page = read(client.get(section(study, "courses", 0)))
    ground = next(e for e in page.all("script") if e.attributes.get("id") == "course-ground")
    assert '"mapId": "cabin"' in ground.text
    assert page.all("svg")


def test_unreachable_checkpoints_are_shown_before_saving(client, study):
    assert check(client, study).json() == {"problems": [], "checkpoints": []}
    wrong = check(client, study, checkpoints__1__x="20").json()
    assert wrong["checkpoints"] == [1]
    assert "checkpoint 1 is not in a room; move it into one." in wrong["problems"]
    assert check(client, study, checkpoints__0__y="3.5").json()["checkpoints"] == [0]
    assert check(client, study, checkpoints__1__x="here").json() == {
        "problems": ["This is not a number."],
        "checkpoints": [],
    }
    assert stored() == small_study()


def test_the_course_is_checked_with_the_doors_of_each_condition(client, study):
    row = FloorPlan.objects.get()
    wall = {"start": [4.1, 2.6], "end": [4.1, 3.6], "thickness": 0.2}
    row.plan |= {"passages": [], "walls": [*row.plan["walls"], wall]}
    row.save()
    found = check(client, study).json()
    assert found["checkpoints"] == [2]
    unreachable = "checkpoint 2 cannot be reached from the charging station with door closed."
    assert f"Condition shut: {unreachable}" in found["problems"]


def test_moved_checkpoints_are_renumbered_and_the_photo_keeps_its_checkpoint(client, study):
    send(client, section(study, "courses", 0), "up:checkpoints:2")
    course = stored().courses[0]
    assert [(one.number, one.x) for one in course.checkpoints] == [(0, 0.5), (1, 7.0), (2, 3.0)]
    assert course.photo.checkpoint == 1


def test_a_zone_is_added_where_the_map_was_clicked(client, study):
    answer = send(client, section(study, "courses", 0), "add:zones", at="2 3")
    assert answer.headers["Location"].endswith("#course")
    assert stored().courses[0].zones[0].polygon == ((1.5, 2.5), (2.5, 2.5), (2.5, 3.5), (1.5, 3.5))


def test_course_without_a_floor_plan_has_a_note_and_can_be_edited(client, boss):
    row = publishing.store(small_study(), NOW)
    assert "This site has no floor plan" in read(client.get(section(row, "courses", 0))).text
    assert send(client, section(row, "courses", 0), checkpoints__1__x="2.5").status_code == 302
    assert stored().courses[0].checkpoints[1].x == 2.5


def test_check_of_a_course_needs_a_role_in_the_study(client, study):
    address = reverse("admin:experiments_study_check", args=[study.pk, "courses", 0])
    assert client.get(address).status_code == 404
    client.force_login(person("eve", is_staff=True))
    assert client.post(address, {}).status_code == 404


# --- around the builder ---------------------------------------------------------------------------


def test_every_page_of_the_small_study_is_reached_from_the_others(client, study):
    for name in SECTIONS:
        links = hrefs(read(client.get(section(study, name))))
        assert {section(study, other) for other in SECTIONS} <= set(links)
    assert len(STUDY["steps"]) == len(stored().steps)


def test_a_draft_with_participants_proposes_a_new_version(client, study):
    words = "Create a new version to keep it separate"
    assert words not in read(client.get(section(study, "steps"))).text
    comer(study, person("pilot"), kind=ParticipantKind.PILOT)
    assert words in read(client.get(section(study, "steps"))).text
    send(client, section(study, "steps", 0), title__en="Drive round")
    assert study.participants.filter(kind=ParticipantKind.PILOT).exists(), "what pilots did is kept"


def test_questionnaire_editor_links_back_to_the_step(client, study):
    steps = study.as_definition().steps
    n = next(n for n, step in enumerate(steps) if getattr(step, "questionnaire", ""))
    step = section(study, "steps", n)
    write = reverse("admin:surveys_questionnaire_write")
    assert write in hrefs(read(client.get(step)))

    def links_back(answer):
        links = [a for a in read(answer).all("a") if a.text == f"Back to the study “{study.title}”"]
        return [a.attributes["href"] for a in links]

    assert links_back(client.get(write)) == [step]
    begun = client.post(write, {"title": "Doors", "languages": ["en"]})
    assert links_back(client.get(begun.url)) == [step]
    row = Questionnaire.objects.get(slug="doors")
    about = reverse("admin:surveys_questionnaire_section", args=[row.pk, "about"])
    saved = send(client, about, title__en="All doors")
    assert links_back(client.get(saved.url)) == [step]
    client.get(reverse("admin:surveys_questionnaire_changelist"))
    assert links_back(client.get(about)) == [], "opened from the list"


def test_page_of_a_study_starts_with_tasks_before_publishing(client, boss):
    row = publishing.begin_empty("mine", "My study", ["en"], NOW)
    text = read(client.get(reverse("admin:experiments_study_change", args=[row.pk]))).text
    assert text.index("To do before publishing") < text.index("Link (draft")


def test_consent_of_a_study_with_observers_should_mention_them(client, boss):
    study = publishing.begin_empty("mine", "My study", ["en"], NOW)
    consent, advised = section(study, "steps", 0), "The consent should say that others can see"
    assert advised not in read(client.get(consent)).text
    send(client, section(study, "about"), observers_allowed="on")
    assert stored().observers_allowed
    page = read(client.get(consent))
    assert advised in page.text
    assert section(study, "about") in hrefs(page)


EXACT = (0.1 + 0.2, 0.9000000000000001, 0.7853981633974483, 1 / 3, 0.5)


@pytest.mark.parametrize("angular", EXACT)
def test_speeds_of_turning_are_shown_in_degrees_and_stay_the_same_number(client, boss, angular):
    cabin_with_giraff()
    speed = {"linear": angular / 2, "angular": angular}
    path = [[0.1 + 0.2, 12.3456789], [1.0, 2.0]]
    first, *others = STUDY["conditions"]
    courses = [{**STUDY["courses"][0], "path": path}]
    conditions = [{**first, "speed": speed}, *others]
    document = small_study(conditions=conditions, start={"heading": 3.2}, courses=courses)
    study = publishing.store(document, NOW)
    page = client.get(section(study, "conditions", 0))
    shown = form_of(page)["speed.angular"]
    assert float(shown) == round(math.degrees(angular), 2)
    assert "Turning speed (°/s)" in read(page).text
    for name, n in (("conditions", 0), ("rules", None), ("courses", 0)):
        answer = send(client, section(study, name, n))
        assert answer.status_code == 302, [one.text for one in read(answer).all("li")]
    assert stored() == document, "bit for bit"
    assert send(client, section(study, "conditions", 0), speed__angular="45").status_code == 302
    assert stored().conditions[0].speed.angular == math.radians(45)


def test_invalid_angle_stays_as_typed_and_limits_are_in_degrees(client, study):
    rules = section(study, "rules")
    page = read(send(client, rules, start__heading="fast"))
    assert "This is not a number." in page.text
    inputs = [e.attributes for e in page.all("input") if e.attributes.get("type") != "hidden"]
    values = [one["value"] for one in inputs if one.get("name") == "start.heading"]
    assert values == ["fast"]
    refused = send(client, rules, start__heading="200")
    assert "Write a number of at most 183.3." in read(refused).text


# --- a whole study --------------------------------------------------------------------------------


def test_a_study_is_copied_as_a_new_one(client, study, boss):
    designed(client, study, "assist")
    page = reverse("admin:experiments_study_copy", args=[study.pk])
    taken = client.post(page, {"name": study.slug, "title": "Again"})
    assert "There is a study cabin-study already." in read(taken).text
    answer = client.post(page, {"name": "cabin-again", "title": "Again"})
    copy = Study.objects.get(slug="cabin-again")
    assert answer.headers["Location"] == reverse("admin:experiments_study_change", args=[copy.pk])
    original, made = Study.objects.get(slug="cabin-study").as_definition(), copy.as_definition()
    named = msgspec.structs.replace(original, slug="cabin-again", title={"en": "Again"})
    assert (made, copy.version, copy.status) == (named, 1, Study.Status.DRAFT)
    assert not copy.participants.exists()


def test_problems_of_the_study_and_of_this_site_are_listed_at_once(client, study):
    send(client, section(study, "steps", 0), title__en="")
    send(client, section(study, "courses", 0), checkpoints__1__x="20")
    text = " ".join(wrong())
    assert "has no text in en" in text
    assert "checkpoint 1 is not in a room" in text


def test_questionnaire_asked_once_is_no_measure_of_a_within_study(client, study):
    designed(client, study, "assist")
    send(client, section(study, "design"), factors__0__design="within")
    press(client, study, "analyses", "add:")
    analysis = section(study, "analyses", 0)
    send(client, analysis, title__en="Main", measures=["experience.q1"])
    untick(client, section(study, "steps", 1), "repeat")
    assert any("experience is asked only once, so it cannot be compared" in one for one in wrong())


def test_expectations_are_sentences_about_levels_and_about_contrasts(client, study):
    designed(client, study, "video_delay")
    send(client, section(study, "design"), factors__0__levels__1__sets__video_delay="0.3")
    press(client, study, "analyses", "add:")
    analysis = section(study, "analyses", 0)
    send(client, analysis, "add:contrasts", title__en="Doors", measures=["task_time"])
    first, second = (one.key for one in stored().conditions)
    sides = {"contrasts__0__first": [first], "contrasts__0__second": [second]}
    send(client, analysis, **sides)
    assert stored().analyses[0].contrasts[0].title == {"en": "Open – Shut"}
    send(client, section(study, "plan"), "add:hypotheses")
    page = client.get(section(study, "plan"))
    offered = [one.text for one in read(page).all("option")]
    assert "Open – Shut: greater with Open than with Shut" in offered
    send(client, section(study, "plan"), hypotheses__0__direction="less:analysis:1:")
    (one,) = stored().plan.hypotheses
    assert (one.contrast, one.direction) == (1, "less")
    assert one.text == "Task time (s) – Open – Shut: smaller with Open than with Shut."


def test_robot_that_is_at_another_site_is_listed_with_the_page_of_its_condition(client, study):
    other = FloorPlan.objects.get()
    other.pk, other.name = None, "barn"
    other.save()
    Robot.objects.update(floor_plan=other)
    page = read(client.get(reverse("admin:experiments_study_change", args=[study.pk])))
    found = "Condition shut: there is no giraff at the site cabin."
    (link,) = [a for a in page.all("a") if a.text == found]
    assert link.attributes["href"] == section(study, "conditions", 1)
