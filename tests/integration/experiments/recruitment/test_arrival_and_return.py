"""From the recruitment site and back: every ending, every device, with nothing but its id."""

from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import msgspec
import pytest
from django.test import Client
from django.utils import timezone

from accounts.models import EntryCode, User
from experiments.definition.shipped import shipped
from experiments.models import Participant, Study
from experiments.participation import completion, progress
from experiments.recruitment import recognition, screening
from sessions.leases.absences import note_page_closed
from surveys.models import Answer, Response
from tests.support.browsers.html_page import Page, faults, read
from tests.support.people import person
from tests.support.studies import participants as p, task_session
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.study_walk import Walker

pytestmark = pytest.mark.django_db
FRONT, STEP = "/studies/exploration/", "/studies/exploration/step/"
RETURN = "/studies/exploration/return/"
CAME = {"PROLIFIC_PID": "5f0c", "STUDY_ID": "60ac", "SESSION_ID": "625d"}
COMPLETE = "https://app.prolific.com/submissions/complete?cc="
PHONE = (
    "Mozilla/5.0 (iPhone; CPU iPhone OS 17_0 like Mac OS X) AppleWebKit/605.1.15 "
    "(KHTML, like Gecko) Version/17.0 Mobile/15E148 Safari/604.1"
)
COMPUTER = (
    "Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 (KHTML, like Gecko) Chrome/120.0 "
    "Safari/537.36"
)


@pytest.fixture
def robot():
    return p.site()


@pytest.fixture
def publish(robot):
    def make(**changes: Any) -> Study:
        return p.published(p.of("exploration", **changes), entry="code")

    return make


@dataclass
class Recruit:
    """A participant from Prolific; another browser is another person with the same id."""

    study: Study
    robot: Any
    came: dict[str, str]

    def __post_init__(self) -> None:
        self.client = Client()

    def arrive(self) -> Page:
        return read(self.client.get(FRONT, self.came))

    def join(self) -> Any:
        self.arrive()
        return self.client.post(FRONT)

    @property
    def participant(self) -> Participant:
        return Participant.objects.get(recruitment_id=self.came["PROLIFIC_PID"])

    @property
    def walker(self) -> Walker:
        assert self.participant.user is not None
        walker = Walker(self.study, self.participant.user, self.robot)
        walker.client = self.client
        return walker

    def go_to(self, step: str) -> None:
        while self.participant.step != step:
            before = progress.place(self.participant)
            self.walker.do()
            assert progress.place(self.participant) != before

    def finish(self, outcome: str = "completed", *, moved: bool = True, reason: str = "") -> Page:
        """Drive with this outcome, answer the rest, and return the last page."""
        self.go_to("task")
        drive = self.walker.drive(outcome, moved=moved)
        drive.session.outcome_reason = reason
        drive.session.save()
        self.walker.look()
        if not moved:
            self.walker.send(go="without")
        self.go_to("thanks")
        return read(self.client.get(STEP))


@pytest.fixture
def recruit(publish, robot):
    def make(study: Study | None = None, **came: str) -> Recruit:
        return Recruit(study or publish(), robot, {**CAME, **came})

    return make


@pytest.fixture
def joined(recruit):
    """A participant who has joined a study and is at a step of it."""

    def make(study: Study | None = None, step: str = "consent", **came: str) -> Recruit:
        one = recruit(study, **came)
        one.join()
        one.go_to(step)
        return one

    return make


@pytest.fixture
def ada(joined) -> Recruit:
    return joined()


# --- arriving -------------------------------------------------------------------------------------


def test_a_recruited_participant_is_shown_no_code_to_write_down(recruit):
    ada = recruit()
    page = ada.arrive()
    assert faults(page) == []
    assert "Do you already have a code?" not in page.text
    assert ada.join().url == STEP
    assert not EntryCode.objects.exists()
    assert ada.participant.recruitment == CAME
    ada.go_to("instructions")
    assert "open the study again from the site that sent you" in read(ada.client.get(STEP)).text


def test_the_same_id_on_another_device_continues_the_same_participation(recruit, ada):
    ada.go_to("instructions")
    phone = recruit(ada.study)
    page = phone.arrive()
    assert faults(page) == []
    assert "Continue where you left off" in page.text
    assert phone.client.get(STEP).url == FRONT, "reading the page signs nobody in"
    assert phone.client.post(FRONT).url == STEP
    assert phone.client.get(STEP).status_code == 200
    assert Participant.objects.count() == User.objects.count() == 1
    assert ada.participant.step == "instructions"


def test_two_browsers_that_join_at_once_become_one_participant(recruit, monkeypatch):
    ada = recruit()
    other = recruit(ada.study)
    ada.arrive()
    other.arrive()
    monkeypatch.setattr(recognition, "known", lambda *_: None)  # both looked before either joined
    assert ada.client.post(FRONT).url == STEP
    assert other.client.post(FRONT).url == STEP
    assert Participant.objects.count() == User.objects.count() == 1
    assert other.client.get(STEP).status_code == ada.client.get(STEP).status_code == 200


def test_another_id_at_the_same_computer_is_another_participant(recruit, ada):
    bob = recruit(ada.study, PROLIFIC_PID="b0b", SESSION_ID="other")
    bob.client = ada.client
    assert "Take part" in bob.arrive().text
    assert "Continue where you left off" not in bob.arrive().text
    bob.join()
    assert Participant.objects.count() == 2
    assert bob.participant.user != ada.participant.user


def test_the_id_continues_the_version_in_which_it_took_part(recruit, ada, publish):
    ada.finish()
    Study.objects.update(status="closed")
    publish(version=2)
    again = recruit(ada.study)
    assert "You have already taken part in this study" in again.arrive().text
    again.client.post(FRONT)
    assert ada.participant.completion_code in read(again.client.get(STEP)).text
    assert Participant.objects.count() == 1


def test_an_id_that_joined_with_an_account_is_not_let_in_without_its_password(recruit, client):
    study = p.published(p.of("exploration"), entry="open")
    client.force_login(person())
    client.get(FRONT, CAME)
    client.post(FRONT)
    stranger = recruit(study)
    page = stranger.arrive()
    assert faults(page) == []
    assert "Log in with that account" in page.text
    assert stranger.client.post(FRONT).url == FRONT
    assert stranger.client.get(STEP).url == FRONT
    assert Participant.objects.count() == 1


def test_an_id_alone_does_not_show_the_participants_data(recruit, ada):
    code = ada.participant.code
    pages = ("/profile/data/", "/profile/data.json", f"/taking-part/{code}/consent/consent.txt")
    thief = recruit(ada.study, SESSION_ID="")
    thief.join()
    assert thief.client.get(STEP).status_code == 200
    for page in pages:
        answer = thief.client.get(page)
        assert answer.status_code == 403, page
        assert faults(read(answer)) == []
    assert thief.client.post("/profile/data/delete/", {"sure": "on"}).status_code == 403
    same = recruit(ada.study)
    same.join()
    for client in (ada.client, same.client):
        assert client.get(pages[0]).status_code == client.get(pages[1]).status_code == 200


def test_a_second_submission_continues_and_returns_for_itself(recruit):
    first = recruit().client
    first.get(FRONT, {"workerId": "5f0c", "assignmentId": "first"})
    first.post(FRONT)
    again = Client()
    again.get(FRONT, {"workerId": "5f0c", "assignmentId": "second"})
    again.post(FRONT)
    row = Participant.objects.get()
    assert row.recruitment["assignmentId"] == "second"
    completion.conclude(row, timezone.now())
    assert "assignmentId=second" in again.get(RETURN).url
    assert again.get("/profile/data/").status_code == 403
    assert first.get("/profile/data/").status_code == 200


def test_pilots_may_use_one_id_again_and_again(publish, client):
    study = publish()
    for name in ("rita", "rob"):
        researcher = person(name)
        study_member(study, researcher)
        client.force_login(researcher)
        client.get(FRONT, CAME)
        client.post(FRONT)
    assert [one.kind for one in Participant.objects.all()] == ["pilot", "pilot"]


def study_member(study, user, role="researcher"):
    from experiments.models import StudyMember

    StudyMember.objects.create(slug=study.slug, user=user, role=role)


# --- endings --------------------------------------------------------------------------------------


def leads_back(one: Recruit, ending: str) -> None:
    code = completion.code(one.study, ending)
    assert one.participant.completion == ending
    assert one.client.get(RETURN).url == COMPLETE + code
    page = read(one.client.get(STEP))
    assert faults(page) == []
    assert "Return to Prolific" in page.text
    assert code in page.text


def test_a_finished_participant_returns_with_the_code_of_completion(ada):
    page = ada.finish()
    leads_back(ada, "done")
    assert "Take part again" not in page.text
    assert "Take part again" not in read(ada.client.get(FRONT)).text
    assert ada.client.post(FRONT).url == STEP
    assert ada.participant.visit == 1, "paid once, taken part once"


def test_a_timed_out_participant_returns_with_another_code(joined, publish):
    ada = joined(publish(recruiting={"site": "prolific"}))
    assert "Your driving time ran out" in ada.finish("timed_out").text
    leads_back(ada, "timed_out")
    assert completion.code(ada.study, "timed_out") != completion.code(ada.study, "done")


def test_a_study_without_a_site_gives_one_code_to_all_who_drove(ada):
    ada.finish("timed_out")
    assert completion.code(ada.study, "timed_out") == completion.code(ada.study, "done")
    leads_back(ada, "timed_out")


def test_leaving_without_moving_the_robot_is_shown_and_allows_another_try(ada):
    page = ada.finish("cancelled", moved=False, reason="left")
    assert "You left before you moved the robot" in page.text
    assert "technical failure" not in page.text
    leads_back(ada, "left")
    ada.client.post(FRONT)
    assert ada.participant.visit == 2
    ada.finish()
    leads_back(ada, "done")


@pytest.mark.parametrize(("outcome", "reason"), [("cancelled", "left"), ("timed_out", "idle")])
def test_leaving_after_the_first_motion_is_not_completion(ada, outcome, reason):
    page = ada.finish(outcome, reason=reason)
    assert faults(page) == []
    assert "You left before the task was done" in page.text
    assert "Try the drive again" not in page.text
    leads_back(ada, "left")
    assert ada.client.post(FRONT).url == STEP
    assert ada.participant.visit == 1, "drives that displease are not repeated"


def test_closing_the_page_after_the_first_motion_is_leaving(ada):
    ada.go_to("task")
    drive = ada.walker.drive("connection_lost", moved=True)
    note_page_closed(str(drive.session_id), 1001, timezone.now())
    ada.walker.look()
    ada.go_to("thanks")
    leads_back(ada, "left")


@pytest.mark.parametrize(
    ("outcomes", "ending"),
    [
        ("completed completed", "done"),
        ("completed timed_out", "done"),
        ("timed_out timed_out", "timed_out"),
        ("completed cancelled", "left"),
        ("cancelled completed", "left"),
        ("completed robot_fault", "done"),
        ("robot_fault robot_fault", "technical_failure"),
        ("cancelled,completed completed", "done"),
        ("completed queue", "left"),
        ("completed -", "done"),
    ],
)
def test_completion_needs_a_fair_drive_in_every_condition(robot, outcomes, ending):
    study = p.published(p.of("assistance"))
    one = p.assign(p.comer(study, person("ada")), "alone", "assisted")
    for number, some in enumerate(outcomes.split()):
        Participant.objects.filter(pk=one.pk).update(round=number, step="task")
        one.refresh_from_db()
        progress.see(one, timezone.now())
        for outcome in some.split(","):
            if outcome == "queue":
                p.session_of(robot, one, outcome="cancelled", granted=False, reason="left")
            elif outcome != "-":
                p.drive_of(robot, one, outcome=outcome, moved=True)
    assert completion.ending_of(one) == ending


def test_a_participant_idle_until_the_page_gave_up_has_left(ada):
    ada.finish("timed_out", moved=False, reason="idle")
    leads_back(ada, "left")


@pytest.mark.parametrize("outcome", ["connection_refused", "robot_fault", "stopped_by_operator"])
@pytest.mark.parametrize("moved", [False, True])
def test_a_failure_that_is_not_the_participants_is_technical(ada, outcome, moved):
    page = ada.finish(outcome, moved=moved)
    assert "It was not your fault" in page.text
    assert "Try the drive again" in page.text
    leads_back(ada, "technical_failure")


def test_a_participant_who_stopped_waiting_has_left(ada):
    ada.go_to("task")
    p.session_of(ada.robot, ada.participant, outcome="cancelled", granted=False, reason="left")
    ada.walker.send(go="without")
    ada.go_to("thanks")
    leads_back(ada, "left")


def test_an_unavailable_robot_is_a_technical_failure(ada):
    ada.go_to("task")
    Study.objects.update(status="closed")
    ada.walker.send(go="without")
    ada.go_to("thanks")
    leads_back(ada, "technical_failure")


def test_a_withdrawal_after_the_end_keeps_the_completion_code(ada):
    ada.finish()
    code = ada.participant.completion_code
    page = read(ada.client.post(f"/taking-part/{ada.participant.code}/withdraw/"))
    assert faults(page) == []
    assert COMPLETE + code in [one.attributes.get("href") for one in page.all("a")]
    left = Participant.objects.get()
    # all participants with this ending have the code, so it does not identify one
    assert (left.recruitment, left.completion_code) == ({}, code)
    assert "5f0c" not in left.recruited_as + left.recruitment_id
    assert sha256(b"5f0c").hexdigest() not in left.recruited_as + left.recruitment_id


def test_an_id_that_withdraws_after_the_draw_cannot_join_again(recruit, ada, publish):
    ada.finish()
    receipt = read(ada.client.post(f"/taking-part/{ada.participant.code}/withdraw/"))
    assert "it also keeps you from taking part a second time" in receipt.text
    Study.objects.update(status="closed")
    for study in (ada.study, publish(version=2)):
        again = recruit(study)
        page = again.arrive()
        assert faults(page) == []
        assert "You have left this study" in page.text
        assert again.client.post(FRONT).url == FRONT
    assert Participant.objects.count() == 1
    assert recruit(ada.study, PROLIFIC_PID="b0b").join().url == STEP


def test_an_account_that_withdraws_after_the_draw_cannot_join_again(publish, client):
    study, user = publish(), person("ada")
    client.force_login(user)
    for status in ("withdrawn", "welcome"):
        one = p.comer(study, user)
        if status == "withdrawn":
            p.assign(one, "giraff_open")
        asked = read(client.get(f"/taking-part/{one.code}/withdraw/"))
        assert ("can't take part in this study again" in asked.text) == (status == "withdrawn")
        client.post(f"/taking-part/{one.code}/withdraw/")
        assert client.get(FRONT).context["page"]["admission"] == status
        Participant.objects.all().delete()


def test_declining_the_consent_returns_the_code_of_leaving(recruit, ada):
    page = read(ada.walker.send(go="decline"))
    code = completion.code(ada.study, "left")
    assert COMPLETE + code in [one.attributes.get("href") for one in page.all("a")]
    assert recruit(ada.study).join().url == STEP, "and may come again, as somebody new"
    assert Participant.objects.filter(recruitment_id="5f0c").count() == 1


def test_withdrawal_after_being_turned_away_keeps_the_code_and_the_refusal(recruit, publish):
    rule = publish(screening=[RULE], turned_away_code=True)
    ada = recruit(rule)
    ada.join()
    ada.go_to("about_you")
    answered(ada, "age", 3)
    ada.walker.look()
    page = read(ada.client.post(f"/taking-part/{ada.participant.code}/withdraw/"))
    assert completion.code(rule, "screened_out") in page.text
    assert "You could not take part. You keep the code that you got." in page.text
    assert "You had finished" not in page.text
    assert recruit(rule).join().url == FRONT, "the same answers cannot be given again"


def test_a_participant_of_no_site_gets_the_code_to_copy_as_before(publish, client):
    study = publish()
    client.post(FRONT)
    user = User.objects.get()
    walker = Walker(study, user, p.Robot.objects.get())
    walker.client = client
    while walker.participant.step != "thanks":
        walker.do()
    page = read(client.get(STEP))
    assert "Return to" not in page.text
    assert completion.code(study, "done") in page.text
    assert client.get(RETURN).url == STEP


# --- codes ----------------------------------------------------------------------------------------


def test_codes_stay_the_same_in_a_new_version_unless_entered(publish):
    first = publish()
    second = p.publishing.new_version(first, timezone.now())
    assert completion.codes(second) == completion.codes(first)
    third = publish(version=3, recruiting={"codes": {"done": "C1ABC"}})
    assert completion.code(third, "done") == "C1ABC"
    assert completion.code(third, "left") == completion.code(first, "left")
    other = p.published(p.of("exploration", slug="another"))
    assert not set(completion.codes(other).values()) & set(completion.codes(first).values())


# --- screening ------------------------------------------------------------------------------------


def answered(one: Recruit, item: str, value: Any) -> None:
    """Finish the questionnaire of the current step with one answer."""
    one.walker.look()
    response = Response.objects.get(user=one.participant.user, finished_at=None)
    now = timezone.now()
    asked = {"language": "en", "text_version": "x", "position": 1, "first_at": now}
    Answer.objects.create(response=response, item=item, value=value, answered_at=now, **asked)
    Response.objects.filter(pk=response.pk).update(finished_at=now)


RULE = {"questionnaire": "ict", "item": "age", "at_least": 18}


@pytest.mark.parametrize(("value", "goes_on"), [(18, True), (17, False), (None, False)])
def test_an_answer_that_a_rule_excludes_turns_away_with_a_code(joined, publish, value, goes_on):
    ada = joined(publish(screening=[RULE], turned_away_code=True), "about_you")
    answered(ada, "age", value)
    page = read(ada.client.get(STEP, follow=True))
    if goes_on:
        assert ada.participant.step == "instructions"
        return
    assert "You can't take part" in page.text
    leads_back(ada, "screened_out")


def test_a_screened_out_participant_without_a_code_gets_no_return_button(joined, publish):
    ada = joined(publish(screening=[RULE]), "about_you")
    answered(ada, "age", 3)
    page = read(ada.client.get(STEP))
    assert faults(page) == []
    assert "Return to Prolific" not in page.text
    assert ada.client.get(RETURN).url == STEP


def test_a_quota_takes_the_first_who_answer_and_refills_when_one_leaves(recruit, publish):
    quota = {"questionnaire": "ict", "item": "gender", "answers": ["f"], "most": 2}
    study = publish(answer_quotas=[quota])
    people = [recruit(study, PROLIFIC_PID=f"id{n}") for n in range(5)]
    values = ["f", "m", "f", "f", "f"]
    states = []
    for number, (one, value) in enumerate(zip(people, values, strict=True)):
        if number == len(people) - 1:
            people[0].client.post(f"/taking-part/{people[0].participant.code}/withdraw/")
        one.join()
        one.go_to("about_you")
        answered(one, "gender", value)
        one.client.get(STEP)
        states.append(one.participant.status)
    assert states == ["active", "active", "active", "screened_out", "active"]


SECOND_SESSION = {"required": False, "second_after_days": 1}


def before_and_after(**changes: Any) -> dict[str, Any]:
    """The study with one questionnaire before the task and after it."""
    steps = msgspec.to_builtins(shipped()["exploration"])["steps"]
    asked = next(one for one in steps if one["kind"] == "questionnaire")
    task = next(n for n, one in enumerate(steps) if one["kind"] == "task")
    steps = [*steps[:task], {**asked, "key": "before"}, *steps[task:]]
    return {"steps": steps, "analyses": [], "appointments": SECOND_SESSION, **changes}


LIKED = {"questionnaire": "experience", "item": "q1", "at_least": 0}


def test_only_the_first_answers_before_the_task_screen_out(joined, publish):
    ada = joined(publish(**before_and_after(screening=[LIKED])), "before")
    answered(ada, "q1", 2)
    ada.go_to("task")
    ada.walker.drive()
    ada.go_to("experience")
    answered(ada, "q1", -2)
    ada.walker.look()
    assert ada.participant.step == "thanks"
    leads_back(ada, "done")
    ada.client.post(FRONT)
    assert (ada.participant.visit, ada.participant.step) == (2, "instructions")
    ada.go_to("before")
    answered(ada, "q1", -2)
    ada.walker.look()
    assert (ada.participant.status, ada.participant.step) == ("active", "task")
    assert ada.participant.completion_code == completion.code(ada.study, "done")


def test_a_quota_counts_only_the_first_answers_before_the_task(joined, publish):
    quota = {"questionnaire": "experience", "item": "q1", "answers": ["2"], "most": 1}
    study = publish(**before_and_after(answer_quotas=[quota]))
    ada, bob = joined(study, "before"), joined(study, "before", PROLIFIC_PID="bob")
    answered(ada, "q1", 1)
    ada.go_to("task")
    ada.walker.drive()
    ada.go_to("experience")
    answered(ada, "q1", 2)
    ada.walker.look()
    answered(bob, "q1", 2)
    bob.walker.look()
    assert bob.participant.status == "active"


def test_leaving_the_drive_of_another_try_keeps_the_code_and_ends_the_tries(ada):
    ada.finish("robot_fault", moved=False)
    leads_back(ada, "technical_failure")
    ada.client.post(FRONT)
    assert ada.participant.status == "active"
    page = ada.finish("cancelled")
    leads_back(ada, "technical_failure")
    assert "Try the drive again" not in page.text
    ada.client.post(FRONT)
    assert ada.participant.status == "finished"


@pytest.mark.parametrize(("number", "is_judged"), [(0, True), (1, False)])
def test_only_the_first_of_several_rounds_screens_out(number, is_judged):
    task_session.cabin_robot()
    task, asked = ({**step, "repeat": True} for step in STUDY["steps"])
    allocation = {"design": "within", "order": "fixed"}
    rounds = {"steps": [asked, task], "allocation": allocation, "screening": [LIKED]}
    ada = p.comer(p.published(small_study(**rounds)), person("ada"))
    for passed in range(number + 1):
        p.respond(ada, "experience", {"q1": -2}, number=passed)
    Participant.objects.update(round=number)
    ada.refresh_from_db()
    step = progress.step_of(ada)
    assert screening.is_screened_out(ada, step, timezone.now()) is is_judged


def test_being_turned_away_from_a_later_visit_keeps_the_first_ending(joined, publish):
    ada = joined(publish(appointments=SECOND_SESSION))
    ada.finish()
    ada.client.post(FRONT)
    assert ada.participant.status == "active"
    progress.screen_out(ada.participant, timezone.now())
    assert ada.participant.status == "finished"
    leads_back(ada, "done")


def test_a_study_for_computers_sends_phones_elsewhere_before_anything_is_stored(recruit, publish):
    ada = recruit(publish(devices=["computer"], turned_away_code=True))
    phone = Client(headers={"user-agent": PHONE})
    page = read(phone.get(FRONT, CAME))
    assert faults(page) == []
    assert "This study needs another device" in page.text
    assert phone.post(FRONT).url == FRONT
    assert not Participant.objects.exists()
    ada.client = Client(headers={"user-agent": COMPUTER})
    assert ada.join().url == STEP


def test_a_participant_without_the_device_is_screened_out_with_a_code(recruit, publish):
    ada = recruit(publish(devices=["computer"], turned_away_code=True))
    ada.client = Client(headers={"user-agent": PHONE})
    ada.arrive()
    assert ada.client.post(FRONT, {"go": "none"}).url == STEP
    leads_back(ada, "screened_out")


# --- answers in later texts -----------------------------------------------------------------------


def test_an_answer_is_shown_on_a_later_page_as_text(joined, publish):
    whole = p.msgspec.to_builtins(p.of("exploration"))["steps"]
    keys = [step["key"] for step in whole]
    whole[keys.index("instructions")]["leaves"][0]["text"]["en"] = "Hello {{ict.nickname|you}}!"
    ada = joined(publish(steps=whole), "about_you")
    answered(ada, "nickname", "<b>Ada</b>")
    body = ada.client.get(STEP, follow=True).content.decode()
    assert "Hello you!" in body, "an item that the questionnaire does not have is no answer"
    Answer.objects.update(item="gender", value="other")
    whole[keys.index("instructions")]["leaves"][0]["text"]["en"] = "Said: {{ict.gender}}."
    Study.objects.update(definition={**ada.study.definition, "steps": whole})
    assert "Said: Another." in ada.client.get(STEP).content.decode(), "by the label of the choice"


# --- guardians ------------------------------------------------------------------------------------


def test_only_a_minor_is_asked_for_a_guardian(ada):
    assert "guardian" not in read(ada.client.get(STEP)).text
    page = read(ada.walker.send(age="17", agree="on"))
    assert "Name of the parent or guardian" in page.text
    assert ada.participant.step == "consent"
    ada.walker.send(age="17", agree="on", guardian="Grandma")
    assert ada.participant.step != "consent"
