"""Sites: their plans, their maps, and casting rays in them; robots as data."""
