"""Simulations of localization, navigation, docking and assisted driving."""
