import pytest
from django.urls import reverse
from django.utils import timezone

from experiments.bots.browser import HttpAnswer
from experiments.bots.page import HtmlPage
from experiments.bots.participant import heading_of
from experiments.definition.shipped import shipped
from experiments.definition.steps.consent import SHARING
from experiments.models import ConsentReceipt, Participant, StepVisit, Study
from experiments.participation import completion, journey, progress
from robots.models import Robot, RobotPresence
from sessions.models import Session
from surveys import questionnaires
from surveys.models import Response
from surveys.responses import Context, Respondent, begin
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.study_pages import buttons
from tests.support.studies.study_walk import Walker

pytestmark = pytest.mark.django_db
PLACES = [
    (name, place)
    for name, study in shipped().items()
    for place in journey.route(study, journey.rounds(study, "open"), 1)
]

# the study of the paper covers the others, which have more of the same steps
STUDIES = [
    pytest.param(name, marks=[] if name == "exploration" else pytest.mark.nightly)
    for name in shipped()
]


@pytest.fixture
def robot():
    return p.site()


@pytest.fixture
def walk(robot):
    def start(name: str = "exploration", username: str = "ada", **fields) -> Walker:
        walker = Walker(
            Study.objects.filter(slug=name).first() or p.published(p.of(name), **fields),
            person(username),
            robot,
        )
        walker.come()
        return walker

    return start


def bring(walker: Walker, place: journey.JourneyPlace) -> None:
    while progress.place(walker.participant) != place:
        before = progress.place(walker.participant)
        walker.do()
        assert progress.place(walker.participant) != before, f"stuck at {before.word}"


# --- every step, whatever a participant does in the browser ---------------------------------------


def check_reload_and_back(walker: Walker, past: list[dict[str, str]]) -> None:
    """Nothing changes by looking again, on another device, or by sending again what was sent
    before.
    """
    place = progress.place(walker.participant)
    shown = walker.look()
    assert faults(shown) == [], place.word
    assert walker.look().text == shown.text, f"{place.word}: reload"
    assert walker.look(walker.browser()).text == shown.text, f"{place.word}: another device"
    for fields in past:
        for more in ({}, {"go": "decline"}, {"go": "without"}):
            walker.client.post(walker.url(), {**fields, **more})
    assert progress.place(walker.participant) == place, f"{place.word}: back, and sent once more"
    assert walker.participant.status != Participant.Status.WITHDRAWN, place.word
    assert walker.look().text == shown.text, f"{place.word}: after going back"


@pytest.mark.parametrize("name", STUDIES)
def test_reload_back_second_tab_and_other_device_neither_lose_nor_repeat_a_step(walk, name):
    walker, other = walk(name), None
    past: list[dict[str, str]] = []
    route = progress.route_of(walker.participant)
    assert len(route) == len([place for place in PLACES if place[0] == name])
    for number, place in enumerate(route):
        assert progress.place(walker.participant) == place
        check_reload_and_back(walker, past)
        assert StepVisit.objects.count() == number + 1, place.word
        if place == route[-1]:
            break
        past.append(walker.answers())
        other = walker.browser()
        walker.look(other)
        walker.do()
        other.post(walker.url(), past[-1])
        walker.look(other)
        assert progress.place(walker.participant) == route[number + 1], (
            f"{place.word}: answered in two tabs"
        )
    assert StepVisit.objects.filter(finished_at=None).count() == 1  # the thanks
    assert ConsentReceipt.objects.count() == 1
    contexts = [context for (context,) in Response.objects.values_list("context")]
    assert len(contexts) == len(set(contexts))


def titles(page) -> str:
    return page.all("title")[0].text.strip()


def test_every_page_of_a_participant_names_the_study_and_the_step(walk):
    walker = walk("assistance")
    assert not titles(read(walker.client.get(walker.url("study")))).startswith("Step")
    total = len(progress.route_of(walker.participant))
    for number in range(1, total + 1):
        page = walker.look()
        assert faults(page) == []
        assert titles(page).startswith(f"Step {number} of {total} · {walker.study.title}")
        assert f"Step {number} of {total}" in page.all("main")[0].text
        assert walker.study.title in page.all("main")[0].text
        if walker.step.kind in {"task", "practice"}:
            drive = read(walker.client.get(walker.url("study_drive")))
            assert titles(drive).startswith(f"Step {number} of {total} · {walker.study.title}")
            shown = next(e for e in drive.all("p") if e.attributes.get("class") == "task__study")
            assert shown.text == f"{walker.study.title} · Step {number} of {total}"
        if number < total:
            walker.do()
    assert walker.participant.status == "finished"
    walker.come()
    assert titles(walker.look()).startswith(f"Step 1 of {total - 2} · "), (
        "consent and form are done"
    )


def test_the_page_to_leave_a_study_names_its_step_too(walk):
    walker = walk()
    page = read(walker.client.get(reverse("study_withdraw", args=[walker.participant.code])))
    assert titles(page).startswith("Step 1 of 6 · ")


def test_a_questionnaire_outside_of_any_study_names_no_step(client):
    user = person()
    client.force_login(user)
    row = begin(
        questionnaires.current("ict", timezone.now()),
        Respondent(user=user),
        Context(key="k", return_to="/about/"),
        language="en",
        seed=1,
        now=timezone.now(),
    )
    page = read(client.get(reverse("survey", args=[row.pk]), follow=True))
    assert titles(page).startswith("About you")
    assert "Step" not in page.all("main")[0].text


def assert_codes_are_distinguished(page, walker):
    """The code for the recruitment site comes first; each has its heading, use and button."""
    headings = [one.text for one in page.all("h2")]
    first, last = "Your completion code", "Your participant code, for questions about your data"
    assert headings[-1] == last
    assert headings.index(first) < headings.index("Another visit")
    copying = {one.attributes.get("data-copy"): one.text for one in page.all("button")}
    copying.pop(None, None)
    assert copying == {
        "code": "Copy the completion code",
        "participant-code": "Copy the participant code",
    }
    copied = {one.attributes.get("id"): one.text for one in page.elements}
    assert copied["code"] == completion.code(walker.study, "done")
    assert copied["participant-code"] == walker.participant.code
    assert "don't enter it on a recruitment site" in page.text


@pytest.mark.parametrize("name", STUDIES)
def test_a_whole_study_and_a_second_visit_without_the_questions_about_the_person(walk, name):
    walker = walk(name)
    bring(walker, progress.route_of(walker.participant)[-1])
    page = walker.look()
    assert completion.code(walker.study, "done") in page.text
    assert_codes_are_distinguished(page, walker)
    assert walker.participant.status == "finished"
    walker.come()
    assert walker.participant.visit == 2
    passed = []
    while walker.participant.status == "active":
        passed.append(progress.place(walker.participant).step)
        walker.do()
    assert "consent" not in passed
    assert "about_you" not in passed
    assert passed.count("task") == len(walker.participant.conditions)
    asked = (
        Response.objects.filter(questionnaire__slug="ict").count(),
        Response.objects.filter(questionnaire__slug="experience").count(),
    )
    assert asked == (1, 2 * len(walker.participant.conditions))


# --- consent --------------------------------------------------------------------------------------


def test_the_receipt_holds_the_text_as_it_was_shown_and_can_be_taken_along(walk):
    walker = walk()
    page = read(walker.client.get(walker.url(), headers={"accept-language": "es"}))
    assert "Conducirás un robot real" in page.text
    walker.client.post(
        walker.url(),
        {"place": "1.0.consent", "age": "17", "guardian": "Grandma  Ada", "agree": "on"},
        headers={"accept-language": "es"},
    )
    row = ConsentReceipt.objects.get()
    assert (row.language, row.version, row.guardian) == ("es", 1, "Grandma Ada")
    assert row.text.startswith("Conducirás un robot real")
    assert (walker.participant.age, walker.participant.language) == (17, "es")
    answer = walker.client.get(reverse("study_receipt", args=[walker.participant.code, "consent"]))
    assert row.text_sha256 in answer.content.decode()
    assert "attachment" in answer["Content-Disposition"]


@pytest.mark.parametrize(
    ("asks", "ticked", "stored"), [(True, True, True), (True, False, False), (False, True, None)]
)
def test_agreement_to_publishing_is_an_optional_tick_of_its_own(robot, asks, ticked, stored):
    definition = p.of("exploration")
    consent = p.msgspec.structs.replace(definition.consent, sharing=dict(SHARING) if asks else {})
    whole = p.msgspec.structs.replace(definition, steps=(consent, *definition.steps[1:]))
    walker = Walker(p.published(whole), person(), robot)
    walker.come()
    assert ("My data may be published" in walker.look().text) == asks
    walker.send(age="30", agree="on", **({"sharing": "on"} if ticked else {}))
    row = ConsentReceipt.objects.get()
    assert (row.sharing, row.sharing_text) == (stored, SHARING["en"] if asks else "")
    address = reverse("study_receipt", args=[walker.participant.code, "consent"])
    receipt = walker.client.get(address).content.decode()
    assert (f"[{'x' if ticked else ' '}] My data may be published" in receipt) == asks


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"age": "30"},
        {"agree": "on"},
        {"age": "0", "agree": "on"},
        {"age": "-5", "agree": "on"},
        {"age": "121", "agree": "on"},
        {"age": "1e3", "agree": "on"},
        {"age": "٣٠x", "agree": "on"},
        {"age": "17", "agree": "on"},
        {"age": "17", "agree": "on", "guardian": "\u202ex"},
    ],
)
def test_an_invalid_consent_is_asked_again_and_not_stored(walk, fields):
    walker = walk()
    response = walker.send(**fields)
    assert response.status_code == 422
    page = read(response)
    assert faults(page) == []
    assert any(e.attributes.get("role") == "alert" for e in page.elements)
    assert (ConsentReceipt.objects.count(), walker.participant.step) == (0, "consent")


def test_declining_leaves_a_row_without_a_name_and_allows_a_return(walk):
    walker = walk()
    assert "You have left the study" in read(walker.send(go="decline")).text
    row = Participant.objects.get()
    assert (row.status, row.user, row.withdrawn_step) == ("withdrawn", None, "consent")
    walker.come()
    assert walker.participant.status == "active"


@pytest.mark.parametrize("gives_code", [False, True])
def test_a_refused_minor_gets_a_code_only_if_the_study_gives_one(robot, gives_code):
    definition = p.of("exploration")
    consent, *others = p.msgspec.to_builtins(definition)["steps"]
    steps = [consent | {"minimum_age": 18, "minors": "refused"}, *others]
    study = p.published(p.of("exploration", steps=steps, turned_away_code=gives_code))
    walker = Walker(study, person(), robot)
    walker.come()
    assert "at least 18" in walker.look().text
    walker.send(age="17", agree="on")
    assert walker.participant.status == walker.participant.completion == "screened_out"
    page = walker.look()
    assert "You can't take part" in page.text
    code = completion.code(walker.study, "screened_out")
    assert (code in page.text, walker.participant.completion_code == code) == (gives_code,) * 2
    assert ("Code for the recruitment site" in page.text) == gives_code
    assert "completion code" not in page.text
    walker.send(age="18", agree="on")
    assert walker.participant.status == "screened_out"
    assert ConsentReceipt.objects.count() == 0


# --- instructions ---------------------------------------------------------------------------------


def test_instructions_are_one_page_each_with_a_picture_and_only_those_of_the_robot(walk):
    walker = walk()
    bring(walker, journey.JourneyPlace(1, 0, "instructions"))
    texts = []
    for number in ("1", "2", "3", "4"):
        page = read(walker.client.get(walker.url(), {"leaf": number}))
        texts.append(page.text)
        assert f"Page {number} of 4" in page.text
        pictures = [e.attributes.get("src", "") for e in page.all("img")]
        assert len([one for one in pictures if "instructions" in one]) == 1
    assert "arrow keys" in texts[0]
    assert "Next" in texts[0]
    assert "I have read this, continue" in texts[3]
    for wrong in ("0", "99", "-1", "x", "9" * 500, "²"):
        assert "of 4" in read(walker.client.get(walker.url(), {"leaf": wrong})).text
    Participant.objects.update(access="invitation")
    assert "Page 1 of 3" in walker.look().text


def read_by_condition(*keys: str) -> list[dict]:
    """The steps of the paper's study with a page of the instructions for each of some conditions,
    and one for all.
    """
    steps = p.msgspec.to_builtins(p.of("exploration"))["steps"]
    pages = [
        {"text": dict.fromkeys(("en", "es"), f"For {key}."), "conditions": [key]} for key in keys
    ]
    everybody = {"text": dict.fromkeys(("en", "es"), "For everybody.")}
    return [
        {**one, "leaves": [everybody, *pages]} if one["key"] == "instructions" else one
        for one in steps
    ]


def test_a_page_for_some_conditions_is_shown_only_to_participants_assigned_to_them(robot):
    keys = ("giraff_open", "giraff_lab_closed", "giraff_lounge_closed")
    even = {"best_probability": 1.0}
    study = p.published(p.of("exploration", steps=read_by_condition(*keys), allocation=even))
    for n in range(3):
        walker = Walker(study, person(f"p{n}"), robot)
        walker.come()
        bring(walker, journey.JourneyPlace(1, 0, "instructions"))
        walker.look()
        own = walker.participant
        assert (own.stage, own.conditions) == ("under_way", [own.cell])
        page = read(walker.client.get(walker.url(), {"leaf": "2"}))
        assert f"For {own.cell}." in page.text
        assert "Page 2 of 2" in page.text
        walker.look()
        assert walker.participant.cell == own.cell
    # one each: the draw is that of the first grant
    assert sorted(Participant.objects.values_list("cell", flat=True)) == sorted(keys)


def test_a_step_without_a_page_for_ones_condition_is_passed_over(robot):
    steps = read_by_condition("giraff_open")
    for one in steps:
        if one["key"] == "instructions":
            one["leaves"] = one["leaves"][1:]
    walker = Walker(p.published(p.of("exploration", steps=steps)), person(), robot)
    walker.come()
    p.assign(walker.participant, "giraff_lab_closed")
    bring(walker, journey.JourneyPlace(1, 0, "task"))


def test_a_reader_is_screened_out_when_every_cell_is_full(robot):
    study = p.published(p.of("exploration", steps=read_by_condition("giraff_open")))
    walker = Walker(study, person(), robot)
    walker.come()
    p.fill(study)
    for _ in range(3):
        if walker.participant.status == "active":
            walker.do()
    assert walker.participant.status == "screened_out"


# --- driving --------------------------------------------------------------------------------------


@pytest.fixture
def at_task(walk):
    def bring_there(name: str = "exploration", step: str = "task") -> Walker:
        walker = walk(name)
        bring(walker, journey.JourneyPlace(1, 0, step))
        return walker

    return bring_there


def test_the_page_shows_the_wait_while_another_drives_and_that_the_place_is_kept(
    at_task, robot, settings
):
    settings.TURN_MINUTES = 7.0
    walker = at_task()
    busy = "The robot is in use right now."
    assert busy not in walker.look().text
    assert busy not in read(walker.client.get(walker.url("study"))).text
    now = timezone.now()
    other = {"robot": robot, "visitor": person("another"), "state": Session.State.DRIVING}
    driving = Session.objects.create(**other, queued_at=now, granted_at=now)
    wait = f"{busy} You may have to wait up to about 7 minutes. Your place in the study is kept"
    assert wait in walker.look().text
    front = read(walker.client.get(walker.url("study")))
    assert faults(front) == []
    assert f"{busy} If you came to the drive now, you would wait up to about 7 min" in front.text
    waiting = read(walker.client.get(walker.url("study_drive")))
    assert "Your place in the study is kept while you wait." in waiting.text
    Session.objects.filter(pk=driving.pk).update(state=Session.State.ENDED)
    assert busy not in walker.look().text


def test_only_progress_is_kept_where_the_last_place_may_go_to_another(at_task):
    walker = at_task()
    limited = {**walker.study.definition, "allocation": {"quota": 1}}
    Study.objects.update(definition=limited)
    waiting = read(walker.client.get(walker.url("study_drive")))
    assert "Your progress in the study is kept while you wait." in waiting.text
    assert "Your place in the study is kept" not in waiting.text


def test_drive_page_receives_the_study(at_task, robot):
    walker = at_task()
    page = walker.look()
    assert "Now it's your turn to drive. You have 15 minutes" in page.text
    assert "without driving" not in page.text
    response = walker.client.get(walker.url("study_drive"))
    assert response.status_code == 200
    guide = response.context["config"]["study"]
    read_by_a_bot = HttpAnswer("http://x/drive/", 200, HtmlPage(response.content.decode()))
    assert heading_of(read_by_a_bot) == page.all("h1")[0].text, "not what scripts show at times"
    assert (guide["kind"], len(guide["checkpoints"])) == ("task", 5)
    assert guide["urls"]["step"] == walker.url()
    assert response.context["robot"] == robot


FAILURES = ("timed_out", "cancelled", "stopped_by_operator", "robot_fault", "connection_lost")


@pytest.mark.parametrize("outcome", ["completed", *FAILURES])
def test_questions_follow_a_drive_with_motion_whatever_its_outcome(at_task, robot, outcome):
    walker = at_task()
    walker.drive(outcome)
    response = walker.client.get(walker.url())
    assert response.url.startswith("/questions/")
    assert walker.participant.step == "experience"
    asked = Response.objects.get(questionnaire__slug="experience")
    assert (asked.outcome, asked.robot) == (outcome, [robot.name, "giraff"])


@pytest.mark.parametrize("outcome", ["connection_refused", *FAILURES])
def test_after_a_drive_that_never_moved_one_may_try_again_or_answer_without(at_task, outcome):
    walker = at_task()
    walker.drive(outcome, moved=False)
    page = walker.look()
    words = buttons(page)
    assert words.index("Try again") < words.index("Continue without driving")
    assert walker.participant.step == "task"
    assert walker.client.get(walker.url("study_drive")).status_code == 200
    walker.send(go="without")
    assert walker.client.get(walker.url()).url.startswith("/questions/")
    assert Response.objects.get(questionnaire__slug="experience").outcome == outcome
    assert walker.participant.step == "experience"


def test_a_second_try_that_moves_goes_on_and_both_drives_are_there(at_task):
    walker = at_task()
    walker.drive("connection_lost", moved=False)
    walker.look()
    walker.drive("completed")
    walker.look()
    assert walker.participant.step == "experience"
    assert sorted(walker.participant.drives.values_list("number", flat=True)) == [1, 2]


def test_while_a_drive_lives_no_answer_skips_it_and_the_page_leads_back(at_task):
    walker = at_task()
    walker.drive("", moved=True)
    assert "Back to the robot" in walker.look().text
    walker.send(go="without")
    assert walker.participant.step == "task"
    assert walker.client.get(walker.url("study_drive")).status_code == 200


def test_a_visit_that_never_got_the_robot_may_be_tried_again(at_task, robot):
    walker = at_task()
    p.session_of(robot, walker.participant, outcome="cancelled", granted=False, reason="left_queue")
    assert "Try again" in walker.look().text


def test_a_drive_outside_of_the_study_before_the_step_changes_nothing(walk, robot):
    walker = walk()
    p.session_of(robot, walker.participant, outcome="completed", moved=True)
    bring(walker, journey.JourneyPlace(1, 0, "task"))
    assert "Try again" not in walker.look().text
    p.session_of(robot, walker.participant, outcome="completed", moved=True)
    assert walker.participant.step == "task"


def test_the_drive_can_be_skipped_only_while_the_robot_is_offline(at_task, robot):
    walker = at_task()
    walker.send(go="without")
    assert walker.participant.step == "task"
    RobotPresence.objects.update(connection="OFFLINE")
    page = walker.look()
    assert "can't be reached" in page.text
    walker.send(go="without")
    walker.look()
    assert walker.participant.step == "experience"
    Response.objects.update(finished_at=p.later(0))
    assert completion.code(walker.study, "technical_failure") in walker.look().text


def test_practice_may_be_left_out_and_ends_like_a_drive(at_task):
    walker = at_task("assistance", "practice")
    assert "Continue without practising" in walker.look().text
    walker.drive("completed")
    walker.look()
    assert walker.participant.step == "task"


def test_a_full_study_turns_away_who_has_no_place(at_task):
    walker = at_task()
    p.fill(walker.study)
    assert "You can't take part" in walker.look().text
    assert walker.participant.status == "screened_out"


def test_a_freed_participant_answers_when_all_other_places_are_taken(at_task):
    walker = at_task()
    walker.drive("connection_refused", moved=False)
    Participant.objects.update(stage="freed")
    p.fill(walker.study)
    page = walker.look()
    assert "All places are taken" in page.text
    assert "Try again" not in page.text
    walker.send(go="without")
    assert walker.participant.step == "experience"


def test_outside_of_the_opening_hours_the_page_shows_when_the_study_opens(at_task):
    walker = at_task()
    Study.objects.update(opening_hours=p.in_two_days(), time_zone="Pacific/Auckland")
    page = walker.look()
    assert "be driven right now" in page.text
    assert "09:00 (Pacific/Auckland)" in page.text
    assert walker.client.get(walker.url("study_drive")).url == walker.url()


def test_a_robot_that_this_visitor_may_not_drive_is_named_as_the_studys_mistake(at_task):
    walker = at_task()
    Robot.objects.update(access="trained")
    page = read(walker.client.get(walker.url("study_drive")))
    assert faults(page) == []
    assert "have permission to drive this study" in page.text


def test_a_questionnaire_that_is_not_there_is_named_as_the_studys_mistake(walk):
    walker = walk()
    definition = p.msgspec.to_builtins(walker.study.as_definition())
    definition["steps"][1]["questionnaire"] = "gone"
    Study.objects.update(definition=definition)
    walker.send(age="30", agree="on")
    page = walker.look()
    assert faults(page) == []
    assert "The questions for this step are missing" in page.text


# --- what does not fit ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "place", ["", "1.0.nothing", "9.0.consent", "1.5.task", "x" * 5000, "1.0.task\n", "0.0.consent"]
)
def test_a_forged_step_is_a_clear_page_and_changes_nothing(walk, place):
    walker = walk()
    response = walker.client.post(walker.url(), {"place": place, "age": "30", "agree": "on"})
    assert response.status_code == 400
    page = read(response)
    assert faults(page) == []
    assert "Page not available" in page.text
    assert walker.participant.step == "consent"


def test_a_step_ahead_cannot_be_answered(walk):
    walker = walk()
    for place in progress.route_of(walker.participant)[1:]:
        walker.client.post(
            walker.url(), {"place": place.word, "go": "without", "agree": "on", "age": "30"}
        )
        walker.client.get(walker.url("study_drive"))
    assert walker.participant.step == "consent"
    assert ConsentReceipt.objects.count() == 0


def test_the_participation_of_another_user_cannot_be_reached(walk, client):
    walker = walk()
    walker.send(age="30", agree="on")
    code = walker.participant.code
    client.force_login(person("eve"))
    for name, arguments in (("study_withdraw", [code]), ("study_receipt", [code, "consent"])):
        assert client.get(reverse(name, args=arguments)).status_code == 404
    assert client.post(reverse("study_withdraw", args=[code])).status_code == 404
    assert client.get(walker.url()).url == walker.url("study")
    assert client.post(walker.url(), {"place": "1.0.about_you"}).url == walker.url("study")
    assert client.get(walker.url("study_drive")).url == walker.url("study")
    assert walker.participant.status == "active"
    walker.look()
    theirs = Response.objects.get()
    assert client.get(reverse("survey", args=[theirs.pk])).status_code == 404


def test_a_stranger_is_led_to_the_front_page(walk, client):
    walker = walk()
    for name in ("study_step", "study_drive"):
        assert client.get(walker.url(name)).url == walker.url("study")
    assert client.get("/studies/nothing/step/").status_code == 404


def test_a_closed_study_lets_its_participants_finish(walk):
    walker = walk()
    bring(walker, journey.JourneyPlace(1, 0, "task"))
    Study.objects.update(status="closed")
    page = walker.look()
    assert "Driving has ended" in page.text
    assert walker.client.get(walker.url("study_drive")).url == walker.url()
    walker.send(go="without")
    assert walker.participant.step == "experience"


def test_every_page_is_sound_in_spanish(walk):
    walker = walk()
    for place in progress.route_of(walker.participant):
        bring(walker, place)
        page = walker.client.get(walker.url(), headers={"accept-language": "es"}, follow=True)
        assert page.status_code == 200
        assert faults(read(page)) == []
