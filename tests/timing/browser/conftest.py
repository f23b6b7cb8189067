"""Browsers, and sites for them."""

from tests.support.browser_fixtures import browser, playwright, site, visitor

__all__ = ["browser", "playwright", "site", "visitor"]
