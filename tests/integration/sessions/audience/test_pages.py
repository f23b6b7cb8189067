"""Raised hands and questions on the WebSockets of watchers, a driver, an operator, and the robot's
screen.
"""

import pytest
from asgiref.sync import sync_to_async
from django.contrib.auth import get_user_model
from django.db import OperationalError
from django.utils import timezone

from robots.models import Robot, RobotPermit
from robots.screens import make_screen_key
from sessions import page_channel, protocol
from sessions.audience import audience as audiences
from sessions.leases.terms import Terms
from tests.support.browsers.pages import Display, Page, until
from tests.support.robots import create_robot
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture
def people(db):
    create = get_user_model().objects.create_user
    return [create(name, display_name=name.title(), password="x") for name in ("ada", "bob", "eve")]


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
    bridge, robot, people
):
    ada, bob, eve = people
    async with (
        Page("giraff", ada) as driver,
        Page("giraff", bob) as one,
        Page("giraff", eve) as two,
    ):
        await driver.take()
        await watch(one)
        await watch(two)
        await raise_hand(one)
        await raise_hand(two)
        seen = await driver.expect("audience", lambda audience: audience.hands == 2)
        assert (seen.moderates, seen.names) == (True, ("Bob", "Eve"))
        await one.expect("audience", lambda audience: audience.raised)
        await ask(one, "One?")
        await driver.expect("audience", shows(**{"One?": "waiting"}))
        await ask(two, "<i>Two?</i>")
        seen = await driver.expect(
            "audience", shows(**{"One?": "waiting", "<i>Two?</i>": "waiting"})
        )
        first, second = seen.questions
        assert (first.who, second.who) == ("Bob", "Eve")
        await two.expect("audience", shows(**{"<i>Two?</i>": "waiting"}))

        await mark(driver, first, "answering")
        shown = await two.expect("audience", lambda audience: len(audience.questions) == 2)
        assert [(q.text, q.state, q.who, q.own) for q in shown.questions] == [
            ("One?", "answering", "", False),
            ("<i>Two?</i>", "waiting", "", True),
        ]
        assert (shown.names, shown.hands) == ((), 0)
        await mark(driver, second, "declined")
        await two.expect("audience", shows(**{"One?": "answering", "<i>Two?</i>": "declined"}))
        await mark(driver, first, "answered")
        await one.expect("audience", shows(**{"One?": "answered"}))

        await driver.say("audience/lower", protocol.LowerHands())
        await driver.expect("audience", lambda audience: audience.hands == 0)
        await one.expect("audience", lambda audience: not audience.raised)


async def test_closed_page_lowers_its_hand_and_keeps_its_question(bridge, robot, people):
    ada, bob, _ = people
    async with Page("giraff", ada) as driver:
        await driver.take()
        async with Page("giraff", bob) as page:
            await watch(page)
            await raise_hand(page)
            await ask(page)
            await driver.expect(
                "audience", lambda audience: audience.hands == 1 and audience.questions
            )
        left = await driver.expect("audience", lambda audience: audience.hands == 0)
        assert [one.text for one in left.questions] == ["Why?"]
        async with Page("giraff", bob) as page:
            await page.say("session/observe", protocol.Observe())
            await page.expect("audience", shows(**{"Why?": "waiting"}))
            await raise_hand(page)
            await driver.expect("audience", lambda audience: audience.hands == 1)
            await page.say("session/leave", protocol.Leave())
            await driver.expect("audience", lambda audience: audience.hands == 0)


async def test_watcher_lowers_their_own_hand(bridge, robot, people):
    ada, bob, _ = people
    async with Page("giraff", ada) as driver, Page("giraff", bob) as page:
        await driver.take()
        await watch(page)
        await raise_hand(page)
        await driver.expect("audience", lambda audience: audience.hands == 1)
        await raise_hand(page, raised=False)
        await driver.expect("audience", lambda audience: audience.hands == 0)
        await page.expect("audience", lambda audience: not audience.raised)


async def test_updates_of_a_web_process_of_another_version_are_ignored(
    bridge, robot, people, caplog
):
    ada, bob, _ = people
    async with Page("giraff", ada) as driver, Page("giraff", bob) as page:
        await driver.take()
        await watch(page)
        event = {"type": audiences.BOARD, "frame": '{"version": "of tomorrow"}'}
        await page_channel.tell("audience.giraff", event)
        await until(lambda: "board_rejected" in caplog.text)
        await raise_hand(page)
        await driver.expect("audience", lambda audience: audience.hands == 1)


async def test_questions_are_closed_while_the_database_fails(
    bridge, robot, people, monkeypatch, caplog
):
    def fail(_session):
        raise OperationalError("the database is unavailable")

    ada, bob, _ = people
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


async def test_pages_are_limited_to_their_role(bridge, robot, people):
    ada, bob, eve = people
    async with Page("giraff", ada) as driver, Page("giraff", bob) as page, Page("giraff", eve) as g:
        await page.observe()
        await ask(page)
        assert (await page.expect("denied")).reason == "closed"
        await driver.take()
        await page.expect("audience", lambda audience: audience.open)
        await ask(page)
        seen = await driver.expect("audience", lambda audience: audience.questions)
        answered = protocol.MarkQuestion(question=seen.questions[0].id, state="answered")
        unknown = protocol.MarkQuestion(question="none", state="answered")
        for sender, suffix, message, reason in (
            (page, "audience/ask", protocol.AskQuestion(text="And?"), "rate"),
            (page, "audience/lower", protocol.LowerHands(), "not_allowed"),
            (page, "audience/mark", answered, "not_allowed"),
            (driver, "audience/hand", protocol.RaiseHand(raised=True), "not_watching"),
            (g, "audience/ask", protocol.AskQuestion(text="Me?"), "not_watching"),
            (driver, "audience/mark", unknown, "unknown"),
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
            await page.say_frame(frame)
        for suffix in ("audience/ask", "audience/mark", "audience/hand"):
            assert await page.denied() == (suffix, "malformed")
        await page.settle(bridge)
        (question,) = audiences.audience_of("giraff", bridge).board.questions
        assert question.text == "Why?"
        assert g.told("audience") == []


async def test_operator_who_watches_moderates_until_they_lose_the_permit(bridge, robot, people):
    ada, bob, eve = people
    permit = await RobotPermit.objects.acreate(
        robot=robot, user=eve, kind=RobotPermit.Privilege.OPERATOR
    )
    async with (
        Page("giraff", ada) as driver,
        Page("giraff", bob) as page,
        Page("giraff", eve) as op,
    ):
        await driver.take()
        await watch(page)
        await watch(op)
        await ask(page)
        seen = await op.expect("audience", lambda audience: audience.questions)
        assert (seen.moderates, seen.questions[0].who) == (True, "Bob")
        await mark(op, seen.questions[0], "answering")
        await page.expect("audience", shows(**{"Why?": "answering"}))
        # without the signal on which pages check at once
        await sync_to_async(RobotPermit.objects.filter(pk=permit.pk)._raw_delete)("default")
        await mark(op, seen.questions[0], "answered")
        assert await op.denied() == ("audience/mark", "not_allowed")


async def test_questions_end_with_their_drive(bridge, robot, people):
    ada, bob, eve = people
    async with Page("giraff", ada) as driver, Page("giraff", bob) as page, Page("giraff", eve) as w:
        await driver.take()
        await watch(page)
        await watch(w)
        await ask(page)
        await driver.expect("audience", lambda audience: audience.questions)
        await driver.say("session/leave", protocol.Leave())
        await page.expect("audience", lambda audience: not audience.open)
        await w.take()
        again = await page.expect("audience", lambda audience: audience.open)
        assert again.questions == ()


async def test_study_has_no_questions(bridge, robot, people):
    ada, bob, _ = people
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


async def test_robots_screen_shows_the_question_without_its_author(bridge, robot, people):
    ada, bob, _ = people
    key = await sync_to_async(make_screen_key)(robot, timezone.now())
    async with (
        Display(key) as display,
        Page("giraff", ada) as driver,
        Page("giraff", bob) as page,
    ):
        await driver.take()
        await watch(page)
        await raise_hand(page)
        await ask(page)
        seen = await driver.expect("audience", lambda audience: audience.questions)
        await mark(driver, seen.questions[0], "answering")
        shown = await display.expect("audience", shows(**{"Why?": "answering"}))
        assert (shown.hands, shown.names, shown.questions[0].who) == (0, (), "")
        await mark(driver, seen.questions[0], "answered")
        await display.expect("audience", shows())
        await display.say("audience/ask", protocol.AskQuestion(text="And the screen?"))
        assert (await display.expect("denied")).reason == "not_allowed"
