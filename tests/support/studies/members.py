"""Members of studies, and staff who are signed in."""

from django.test import Client

from accounts.models import User
from experiments.models import StudyMember
from tests.support.people import person


def member(role: str, slug: str = "cabin-study", *, name: str = "", is_staff: bool = False) -> User:
    """A member of a study; without a role, a user who is a member of no study."""
    user = person(name or f"{role}-{slug}", is_staff=is_staff)
    if role:
        StudyMember.objects.create(slug=slug, user=user, role=role)
    return user


def signed_in(client: Client, role: str, slug: str = "cabin-study", name: str = "rosa") -> User:
    """A member of a study who is staff and signed in."""
    user = member(role, slug, name=name, is_staff=True)
    client.force_login(user)
    return user
