"""The model's changes of controller, independent of the kernel's: before, event, after."""

ALLOWED = """
    none,       driven,           driver
    none,       moves unbidden,   settling
    none,       handed over,      rca
    none,       passed on,        navigation
    driver,     at rest,          none
    driver,     driver changed,   settling
    driver,     moves unbidden,   settling
    settling,   at rest,          none
    navigation, navigation left,  driver
    rca,        passed on,        navigation
    rca,        navigation left,  settling
"""
EXPECTED = {
    (before, event): after
    for before, event, after in (
        [word.strip() for word in line.split(",")] for line in ALLOWED.strip().splitlines()
    )
}
