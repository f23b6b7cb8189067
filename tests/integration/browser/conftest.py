"""Browsers, and sites for them."""

from tests.support.browsers.browser_fixtures import browser, playwright, site, visitor

__all__ = ["browser", "playwright", "site", "visitor"]
