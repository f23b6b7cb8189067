"""The study of a command: `exploration`, its newest published version, or `exploration:2`."""

from django.core.management import CommandError

from experiments.models import Study


def study_named(text: str) -> Study:
    slug, _, version = text.partition(":")
    found = Study.version_of(slug, version)
    if found is None:
        known = sorted(f"{one.slug}:{one.version}" for one in Study.objects.only("slug", "version"))
        raise CommandError(f"There is no study {text!r}; there are: {', '.join(known) or 'none'}.")
    return found
