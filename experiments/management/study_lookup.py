"""The study of a command: `exploration`, its newest published version, or `exploration:2`."""

from django.core.management import CommandError

from experiments.models import Study


def study_named(text: str) -> Study:
    slug, _, version = text.partition(":")
    rows = Study.objects.filter(slug=slug).order_by("-version")
    if version:
        rows = rows.filter(version=int(version)) if version.isdigit() else rows.none()
    found = rows.exclude(status=Study.Status.DRAFT).first() or rows.first()
    if found is None:
        known = sorted(f"{one.slug}:{one.version}" for one in Study.objects.only("slug", "version"))
        raise CommandError(f"There is no study {text!r}; there are: {', '.join(known) or 'none'}.")
    return found
