"""Acme's robot for the telepresence agent: an example of an adapter in a package of its own."""
