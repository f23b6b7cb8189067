"""One running site and one browser for each module, and visitors with pages."""

import pytest
from django.test import Client
from playwright._impl import timeout_settings
from playwright.async_api import expect as expect_of_async
from playwright.sync_api import Page, expect, sync_playwright

from accounts.models import User
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.patience import patient
from tests.support.programs.namespace import HERE
from tests.support.sessions.site import LOOPBACK, running_site

# Of every click and page; there is no public setting for all contexts.
timeout_settings.DEFAULT_PLAYWRIGHT_TIMEOUT = patient(30.0) * 1000
expect.set_options(timeout=patient(5.0) * 1000)
expect_of_async.set_options(timeout=patient(15.0) * 1000)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    # Every address, so that a browser in a namespace of its own reaches it too.
    with running_site(
        tmp_path_factory.mktemp("site"), bind="0.0.0.0", ALLOWED_HOSTS=f"{LOOPBACK},{HERE}"
    ) as site:
        yield site


@pytest.fixture(scope="module")
def playwright():
    # Its synchronous interface runs an event loop in this thread, which Django takes for
    # asynchronous code.
    with pytest.MonkeyPatch.context() as patch, sync_playwright() as playwright:
        patch.setenv("DJANGO_ALLOW_ASYNC_UNSAFE", "1")
        yield playwright


@pytest.fixture(scope="module")
def browser(playwright):
    with chromium(playwright) as browser:
        yield browser


@pytest.fixture
def visitor(browser, site):
    """Make visitors, and close them at the end; no script of their pages may have failed."""
    made: list[Visitor] = []

    def make(name: str | None = None, **context) -> Visitor:
        made.append(Visitor(browser, site, name, **context))
        return made[-1]

    yield make
    for one in made:
        one.close()
    assert [problem for one in made for problem in one.problems] == []


@pytest.fixture
def open_page(browser, live_server):
    """Open pages of Django's live server, each in a context of its own, as a user or as a stranger;
    none of their scripts may have failed.
    """
    contexts, problems = [], []

    def open_it(who: User | Client | None = None, **context) -> Page:
        options = {"locale": "en", "viewport": {"width": 1280, "height": 800}, **context}
        contexts.append(browser.new_context(base_url=live_server.url, **options))
        client = who if isinstance(who, Client) else Client()
        if isinstance(who, User):
            client.force_login(who)
        if who is not None:
            session = client.cookies["sessionid"].value
            cookie = {"name": "sessionid", "value": session, "url": live_server.url}
            contexts[-1].add_cookies([cookie])
        page = contexts[-1].new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        return page

    yield open_it
    for context in contexts:
        context.close()
    assert problems == [], problems
