"""Addresses of the site."""

from allauth.account.decorators import secure_admin_login
from django.conf import settings
from django.contrib import admin
from django.urls import include, path

from experiments.wizard.views import console
from telepresence_site.ops import first_run, health, metrics
from telepresence_site.web import pages, reference_pages

admin.autodiscover()
# The site's log-in limits attempts; the administration's own form has no limit.
admin.site.login = secure_admin_login(admin.site.login)  # type: ignore[method-assign]

urlpatterns = [
    path("", first_run.or_setup(pages.home), name="home"),
    path("setup/", first_run.setup, name="setup"),
    path("setup/checks/", first_run.site_checks, name="site_checks"),
    path("robots.json", pages.robots_json, name="robots_json"),
    path("about/", pages.about, name="about"),
    path("reference/<slug:name>/", reference_pages.reference, name="reference"),
    path("manifest.webmanifest", pages.manifest, name="manifest"),
    path("healthz", health.healthz, name="healthz"),
    path("readyz", health.readyz, name="readyz"),
    path("metrics", metrics.metrics, name="metrics"),
    path("admin/", admin.site.urls),
    path("accounts/", include("allauth.urls")),
    path("", include("accounts.urls")),
    path("", include("robots.urls")),
    path("", include("sessions.urls")),
    path("", include("surveys.urls")),
    path("", include("experiments.urls")),
    path("", include("experiments.research.urls")),
    path("studies/<slug:slug>/wizard/", console, name="study_wizard"),
]

if settings.DEMO_TOKEN:
    urlpatterns.append(path("", include("telepresence_site.demo.links")))
