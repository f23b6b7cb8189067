"""Addresses of the app."""

from django.urls import URLPattern, URLResolver, path

from experiments.instruction_media import media
from experiments.participation import step_views, views
from experiments.participation.withdrawal.views import receipt_text

urlpatterns: list[URLPattern | URLResolver] = [
    path("studies/link/<str:token>/", views.link, name="study_link"),
    path("studies/media/<slug:name>", media, name="study_media"),
    path("studies/<slug:slug>/", views.front, name="study"),
    path("studies/<slug:slug>/step/", step_views.step, name="study_step"),
    path("studies/<slug:slug>/drive/", step_views.drive, name="study_drive"),
    path("taking-part/", views.enter_code, name="study_code"),
    path("taking-part/receipt.txt", receipt_text, name="withdrawal_receipt"),
    path("taking-part/<slug:code>/withdraw/", views.withdraw, name="study_withdraw"),
    path("taking-part/<slug:code>/consent/<slug:step>.txt", views.receipt, name="study_receipt"),
    path("profile/data/", views.data, name="own_data"),
    path("profile/data.json", views.data_download, name="own_data_download"),
    path("profile/data/code/", views.new_code, name="own_data_code"),
    path("profile/data/delete/", views.data_delete, name="own_data_delete"),
]
