from accounts.models import User

PASSWORD = "seven green kettles"


def person(username: str = "ada", **more) -> User:
    return User.objects.create_user(username=username, password=PASSWORD, **more)
