"""Raised hands and questions on the WebSockets of watchers, a driver, an operator, and the robot's
screen.
"""

import pytest
from asgiref.sync import sync_to_async
from django.contrib.auth import get_user_model
from django.db import OperationalError

from robots.models import RobotPermit
from sessions import page_channel, protocol
from sessions.audience import audience as audiences
from sessions.leases.terms import Terms
from tests.support.browsers.pages import Page
from tests.support.patience import until
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture
def eve(db):
    return get_user_model().objects.create_user("eve", display_name="Eve", password="x")


@pytest.fixture
async def third(bridge, robot, eve):
    """Eve's page of the robot."""
    async with Page("giraff", eve) as page:
        yield page


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(audiences, "PAUSE_SECONDS", 0.01)


async def watch(page):
    await page.observe()
    await page.expect("audience", lambda audience: audience.open)


async def ask(page, text="Why?"):
    await page.say("audience/ask", protocol.AskQuestion(text=text))


async def mark(page, question, state):
    await page.say("audience/mark", protocol.MarkQuestion(question=question.id, state=state))


async def raise_hand(page, *, raised=True):
    await page.say("audience/hand", protocol.RaiseHand(raised=raised))


def shows(**questions):
    """Return whether an audience has exactly these questions, by their texts."""
    return lambda audience: {one.text: one.state for one in audience.questions} == questions


async def test_driver_sees_hands_and_questions_and_watchers_what_is_being_answered(
    bridge, driver, other, third
):
    await watch(other)
    await watch(third)
    await raise_hand(other)
    await raise_hand(third)
    seen = await driver.expect("audience", lambda audience: audience.hands == 2)
    assert (seen.moderates, seen.names) == (True, ("Bob", "Eve"))
    await other.expect("audience", lambda audience: audience.raised)
    await ask(other, "One?")
    await driver.expect("audience", shows(**{"One?": "waiting"}))
    await ask(third, "<i>Two?</i>")
    seen = await driver.expect("audience", shows(**{"One?": "waiting", "<i>Two?</i>": "waiting"}))
    first, second = seen.questions
    assert (first.who, second.who) == ("Bob", "Eve")
    await third.expect("audience", shows(**{"<i>Two?</i>": "waiting"}))

    await mark(driver, first, "answering")
    shown = await third.expect("audience", lambda audience: len(audience.questions) == 2)
    assert [(q.text, q.state, q.who, q.own) for q in shown.questions] == [
        ("One?", "answering", "", False),
        ("<i>Two?</i>", "waiting", "", True),
    ]
    assert (shown.names, shown.hands) == ((), 0)
    await mark(driver, second, "declined")
    await third.expect("audience", shows(**{"One?": "answering", "<i>Two?</i>": "declined"}))
    await mark(driver, first, "answered")
    await other.expect("audience", shows(**{"One?": "answered"}))

    await driver.say("audience/lower", protocol.LowerHands())
    await driver.expect("audience", lambda audience: audience.hands == 0)
    await other.expect("audience", lambda audience: not audience.raised)


async def test_closed_page_lowers_its_hand_and_keeps_its_question(bridge, other, driver, bob):
    await watch(other)
    await raise_hand(other)
    await ask(other)
    await driver.expect("audience", lambda audience: audience.hands == 1 and audience.questions)
    await other.close()
    left = await driver.expect("audience", lambda audience: audience.hands == 0)
    assert [one.text for one in left.questions] == ["Why?"]
    async with Page("giraff", bob) as back:
        await back.say("session/observe", protocol.Observe())
        await back.expect("audience", shows(**{"Why?": "waiting"}))
        await raise_hand(back)
        await driver.expect("audience", lambda audience: audience.hands == 1)
        await back.say("session/leave", protocol.Leave())
        await driver.expect("audience", lambda audience: audience.hands == 0)


async def test_watcher_lowers_their_own_hand(bridge, driver, other):
    await watch(other)
    await raise_hand(other)
    await driver.expect("audience", lambda audience: audience.hands == 1)
    await raise_hand(other, raised=False)
    await driver.expect("audience", lambda audience: audience.hands == 0)
    await other.expect("audience", lambda audience: not audience.raised)


async def test_updates_of_a_web_process_of_another_version_are_ignored(
    bridge, driver, other, caplog
):
    await watch(other)
    event = {"type": audiences.BOARD, "frame": '{"version": "of tomorrow"}'}
    await page_channel.tell("audience.giraff", event)
    await until(lambda: "board_rejected" in caplog.text)
    await raise_hand(other)
    await driver.expect("audience", lambda audience: audience.hands == 1)


async def test_questions_are_closed_while_the_database_fails(
    bridge, robot, ada, bob, monkeypatch, caplog
):
    def fail(_session):
        raise OperationalError("the database is unavailable")

    monkeypatch.setattr(audiences, "BEAT_SECONDS", 0.01)
    async with Page("giraff", ada) as driver, Page("giraff", bob) as page:
        with monkeypatch.context() as patched:
            patched.setattr(audiences.store, "is_study", fail)
            await driver.take()
            await page.observe()
            await until(lambda: "audience_closed" in caplog.text)
            await ask(page)
            assert (await page.expect("denied")).reason == "closed"
        await page.expect("audience", lambda audience: audience.open)
        await ask(page)
        await driver.expect("audience", shows(**{"Why?": "waiting"}))


async def test_pages_are_limited_to_their_role(bridge, page, other, third):
    await other.observe()
    await ask(other)
    assert (await other.expect("denied")).reason == "closed"
    await page.take()
    await other.expect("audience", lambda audience: audience.open)
    await ask(other)
    seen = await page.expect("audience", lambda audience: audience.questions)
    answered = protocol.MarkQuestion(question=seen.questions[0].id, state="answered")
    unknown = protocol.MarkQuestion(question="none", state="answered")
    for sender, suffix, message, reason in (
        (other, "audience/ask", protocol.AskQuestion(text="And?"), "rate"),
        (other, "audience/lower", protocol.LowerHands(), "not_allowed"),
        (other, "audience/mark", answered, "not_allowed"),
        (page, "audience/hand", protocol.RaiseHand(raised=True), "not_watching"),
        (third, "audience/ask", protocol.AskQuestion(text="Me?"), "not_watching"),
        (page, "audience/mark", unknown, "unknown"),
    ):
        await sender.say(suffix, message)
        assert await sender.denied() == (suffix, reason)
    for frame in (
        'audience/ask\n{"text": ""}',
        'audience/ask\n{"text": "%s"}' % ("x" * 281),
        'audience/mark\n{"question": "q", "state": "waiting"}',
        'audience/hand\n{"raised": 1}',
        'audience/ask\n{"text": "\\ud800"}',
    ):
        await other.say_frame(frame)
    for suffix in ("audience/ask", "audience/mark", "audience/hand"):
        assert await other.denied() == (suffix, "malformed")
    await other.settle(bridge)
    (question,) = audiences.audience_of("giraff", bridge).board.questions
    assert question.text == "Why?"
    assert third.told("audience") == []


@pytest.fixture
def permit(robot, eve):
    kind = RobotPermit.Privilege.OPERATOR
    return RobotPermit.objects.create(robot=robot, user=eve, kind=kind)


async def test_operator_who_watches_moderates_until_they_lose_the_permit(
    driver, other, permit, third
):
    await watch(other)
    await watch(third)
    await ask(other)
    seen = await third.expect("audience", lambda audience: audience.questions)
    assert (seen.moderates, seen.questions[0].who) == (True, "Bob")
    await mark(third, seen.questions[0], "answering")
    await other.expect("audience", shows(**{"Why?": "answering"}))
    # without the signal on which pages check at once
    await sync_to_async(RobotPermit.objects.filter(pk=permit.pk)._raw_delete)("default")
    await mark(third, seen.questions[0], "answered")
    assert await third.denied() == ("audience/mark", "not_allowed")


async def test_questions_end_with_their_drive(bridge, driver, other, third):
    await watch(other)
    await watch(third)
    await ask(other)
    await driver.expect("audience", lambda audience: audience.questions)
    await driver.say("session/leave", protocol.Leave())
    await other.expect("audience", lambda audience: not audience.open)
    await third.take()
    again = await other.expect("audience", lambda audience: audience.open)
    assert again.questions == ()


async def test_study_has_no_questions(bridge, robot, ada, bob):
    with provided() as fixed:
        fixed.terms = Terms(study={"slug": "office"})
        async with Page("giraff", ada) as driver, Page("giraff", bob) as page:
            session = (await driver.take()).session
            await page.observe()
            await until(lambda: audiences.audience_of("giraff", bridge)._begun == session)
            await ask(page)
            assert (await page.expect("denied")).reason == "closed"
            shown = page.told("audience") + driver.told("audience")
            assert not any(audience.open for audience in shown)


async def test_robots_screen_shows_the_question_without_its_author(display, driver, other):
    await watch(other)
    await raise_hand(other)
    await ask(other)
    seen = await driver.expect("audience", lambda audience: audience.questions)
    await mark(driver, seen.questions[0], "answering")
    shown = await display.expect("audience", shows(**{"Why?": "answering"}))
    assert (shown.hands, shown.names, shown.questions[0].who) == (0, (), "")
    await mark(driver, seen.questions[0], "answered")
    await display.expect("audience", shows())
    await display.say("audience/ask", protocol.AskQuestion(text="And the screen?"))
    assert (await display.expect("denied")).reason == "not_allowed"
