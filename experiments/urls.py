"""Addresses of the app."""

from django.urls import URLPattern, URLResolver, path

from experiments.instruction_media import media
from experiments.participation import step_views, views
from experiments.participation.appointment_views import appointment, stop_reminders
from experiments.participation.own_data import views as own_views
from experiments.participation.withdrawal.receipt import receipt_text
from experiments.recruitment import api

urlpatterns: list[URLPattern | URLResolver] = [
    path("studies/link/<str:token>/", views.link, name="study_link"),
    path("studies/media/<slug:name>", media, name="study_media"),
    path("studies/<slug:slug>/", views.front, name="study"),
    path("studies/<slug:slug>/step/", step_views.step, name="study_step"),
    path("studies/<slug:slug>/drive/", step_views.drive, name="study_drive"),
    path("studies/<slug:slug>/appointment/", appointment, name="study_appointment"),
    path("taking-part/reminders/<str:token>/stop/", stop_reminders, name="study_reminders_stop"),
    path("api/v1/studies/<slug:slug>/", api.study, name="api_study"),
    path("api/v1/studies/<slug:slug>/participants/", api.participants, name="api_participants"),
    path("studies/<slug:slug>/return/", step_views.go_back, name="study_return"),
    path("taking-part/", views.enter_code, name="study_code"),
    path("taking-part/receipt.txt", receipt_text, name="withdrawal_receipt"),
    path("taking-part/<slug:code>/withdraw/", own_views.withdraw, name="study_withdraw"),
    path("taking-part/<slug:code>/unshare/", own_views.unshare, name="study_unshare"),
    path(
        "taking-part/<slug:code>/consent/<slug:step>.txt", own_views.receipt, name="study_receipt"
    ),
    path("profile/data/", own_views.data, name="own_data"),
    path("profile/data.json", own_views.data_download, name="own_data_download"),
    path("profile/data/code/", own_views.new_code, name="own_data_code"),
    path("profile/data/delete/", own_views.data_delete, name="own_data_delete"),
]
