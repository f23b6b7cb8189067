"""How dates and times are written, beside what Django says of each language."""
