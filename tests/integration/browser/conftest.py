"""Browsers, and sites for them."""

from tests.support.browsers.browser_fixtures import browser, open_page, playwright, site, visitor

__all__ = ["browser", "open_page", "playwright", "site", "visitor"]
