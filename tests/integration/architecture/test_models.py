"""Foreign keys point down the layers, as imports do; the linter does not see those by name."""

import uuid

import pytest
from django.apps import apps
from django.db import models

LAYERS = {"experiments": 3, "telepresence_sessions": 2, "surveys": 2, "accounts": 1, "robots": 1}


def ours() -> list[type[models.Model]]:
    return [model for model in apps.get_models() if model._meta.app_label in LAYERS]


def test_no_foreign_key_points_up_the_layers():
    for model in ours():
        keys = [one for one in model._meta.get_fields() if isinstance(one, models.ForeignKey)]
        for field in keys:
            layer = LAYERS.get(field.related_model._meta.app_label, 0)
            is_down = layer <= LAYERS[model._meta.app_label]
            assert is_down, f"{model.__name__}.{field.name} points up"


def test_every_key_of_ours_can_be_held_by_every_database():
    for model in ours():
        key = model._meta.pk
        allowed = isinstance(key, models.UUIDField | models.OneToOneField | models.CharField)
        assert allowed, f"{model.__name__} has a {type(key).__name__} as its key"
        if isinstance(key, models.UUIDField):
            assert key.default is uuid.uuid4


@pytest.mark.django_db
def test_every_change_of_the_models_has_its_migration():
    from django.core.management import call_command

    call_command("makemigrations", check=True, dry_run=True, verbosity=1)
