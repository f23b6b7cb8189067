"""Addresses of the app."""

from django.urls import URLPattern, URLResolver, path

from surveys import views

urlpatterns: list[URLPattern | URLResolver] = [
    path("questions/<uuid:response>/", views.resume, name="survey"),
    path("questions/<uuid:response>/<int:number>/", views.page, name="survey_page"),
    path("questions/<uuid:response>/answer/", views.answer, name="survey_answer"),
    path("questions/<uuid:response>/done/", views.done, name="survey_done"),
]
