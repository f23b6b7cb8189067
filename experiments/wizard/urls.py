"""Addresses of the operator's page."""

from django.urls import URLPattern, path

from experiments.wizard import views

urlpatterns: list[URLPattern] = [
    path("studies/<slug:slug>/wizard/", views.console, name="study_wizard"),
]
