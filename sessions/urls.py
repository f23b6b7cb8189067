"""Addresses of the app."""

from django.urls import URLPattern, path

from sessions import practice, protocol, screen_views, views
from sessions.api import views as api_views
from sessions.consumers.connection_check import CheckConsumer
from sessions.consumers.drive import RobotConsumer
from sessions.consumers.robot_screen import ScreenConsumer
from sessions.consumers.wizard import WizardConsumer
from sessions.wizard import protocol as wizard_protocol

urlpatterns: list[URLPattern] = [
    path("check/", views.check, name="check"),
    path("practice/", practice.practice, name="practice"),
    path("try/", practice.try_robot, name="try_robot"),
    path("try/now/", practice.try_now, name="try_now"),
    path("practice/<slug:robot>/", views.practice_drive, name="practice_drive"),
    path("profile/visits/", views.my_visits, name="my_visits"),
    path("robots/<slug:robot>/", views.drive, name="drive"),
    path("robots/<slug:robot>/snapshots/", views.snapshots, name="snapshots"),
    path("robots/<slug:robot>/snapshots/<uuid:snapshot>.jpg", views.snapshot, name="snapshot"),
    path("robots/<slug:robot>/screen/", screen_views.screen, name="screen"),
    path("robots/<slug:robot>/screen/key/", screen_views.screen_key, name="screen_key"),
    path("api/v1/robots/", api_views.robots, name="api_robots"),
    path("api/v1/robots/<slug:robot>/", api_views.robot, name="api_robot"),
    path("api/v1/robots/<slug:robot>/actions/", api_views.act, name="api_act"),
]
websocket_urlpatterns: list[URLPattern] = [
    path(protocol.PATH, RobotConsumer.as_asgi()),
    path(protocol.SCREEN_PATH, ScreenConsumer.as_asgi()),
    path(wizard_protocol.PATH, WizardConsumer.as_asgi()),
    path(protocol.CHECK_PATH, CheckConsumer.as_asgi()),
]
