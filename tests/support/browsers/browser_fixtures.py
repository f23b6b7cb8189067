"""One running site, one browser, and what they need, a module."""

import pytest
from playwright._impl import timeout_settings
from playwright.async_api import expect as expect_of_async
from playwright.sync_api import expect, sync_playwright

from tests.support.browsers.visitor import Visitor, chromium
from tests.support.patience import patient
from tests.support.programs.namespace import HERE
from tests.support.sessions.site import LOOPBACK, running_site

# Of every click and page; there is no public setting for all contexts.
timeout_settings.DEFAULT_PLAYWRIGHT_TIMEOUT = patient(30.0) * 1000
expect.set_options(timeout=patient(5.0) * 1000)
expect_of_async.set_options(timeout=patient(5.0) * 1000)


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
    """Make visitors; each is closed at the end, and none of their pages may have raised."""
    made: list[Visitor] = []

    def make(name: str | None = None, **context) -> Visitor:
        made.append(Visitor(browser, site, name, **context))
        return made[-1]

    yield make
    for one in made:
        one.close()
    assert [problem for one in made for problem in one.problems] == []
