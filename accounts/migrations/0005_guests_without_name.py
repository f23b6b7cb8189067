"""Names that the system gave guests, in the language of the one who came, are said from their kind
from now on.
"""

from typing import Any

from django.db import migrations

GIVEN = ("Participant", "Participante", "Guest", "Invitado")


def forget_given_names(apps: Any, _schema_editor: Any) -> None:
    """Take such a name from every guest who has one."""
    apps.get_model("accounts", "User").objects.exclude(kind="full").filter(
        display_name__in=GIVEN
    ).update(display_name="")


class Migration(migrations.Migration):
    dependencies = [("accounts", "0004_user_kind")]

    operations = [migrations.RunPython(forget_given_names, migrations.RunPython.noop)]
