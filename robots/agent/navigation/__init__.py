"""Navigation to a goal. Pure; no clock and no thread of its own."""
