"""Addresses of the researchers' pages."""

from django.urls import URLPattern, path

from experiments.research import views
from experiments.research.invitations import invitation

urlpatterns: list[URLPattern] = [
    path("studies/invitation/<str:token>/", invitation, name="study_invitation"),
    path("studies/replay/<uuid:session>/", views.replay_page, name="replay"),
    path("studies/replay/<uuid:session>.json", views.replay_data, name="replay_data"),
    path(
        "studies/replay/<uuid:session>/photos/<uuid:photo>.jpg",
        views.replay_photo,
        name="replay_photo",
    ),
    path("studies/<slug:slug>/live/", views.live_page, name="study_live"),
    path("studies/<slug:slug>/live.json", views.live_data, name="study_live_data"),
    path("studies/<slug:slug>/live/act/", views.live_act, name="study_live_act"),
]
