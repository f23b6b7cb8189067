"""Addresses of the app."""

from django.urls import URLPattern, URLResolver, include, path

from accounts.views import ProfileView

urlpatterns: list[URLPattern | URLResolver] = [
    path("profile/", ProfileView.as_view(), name="profile"),
    path("i18n/", include("django.conf.urls.i18n")),
]
