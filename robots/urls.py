"""Addresses of the app."""

from django.urls import URLPattern, path

from robots import views
from robots.enrol import views as enrolment_views

urlpatterns: list[URLPattern] = [
    path("api/v1/agent/", views.agent_configuration, name="agent_configuration"),
    path("api/v1/agent/enrol/", enrolment_views.enrol, name="agent_enrol"),
    path("api/v1/agent/renew/", enrolment_views.renew, name="agent_renew"),
    path("floorplans/<slug:name>.json", views.floor_plan, name="floor_plan"),
    path("floorplans/<slug:name>.png", views.floor_plan_image, name="floor_plan_image"),
]
