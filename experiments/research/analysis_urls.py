"""Addresses of the analysis."""

from django.urls import URLPattern, URLResolver, path

from experiments.research import analysis_downloads, analysis_views

urlpatterns: list[URLPattern | URLResolver] = [
    path("studies/<uuid:pk>/analysis/", analysis_views.of_version, name="study_analysis"),
    path("studies/<slug:slug>/analysis/", analysis_views.page, name="analysis"),
    path("studies/<slug:slug>/analysis/<slug:topic>/", analysis_views.page, name="analysis_topic"),
    path(
        "studies/<slug:slug>/analysis/tables/<slug:name>/",
        analysis_views.table,
        name="analysis_table",
    ),
    path(
        "studies/<slug:slug>/analysis/sessions/<int:number>/",
        analysis_views.sessions,
        name="analysis_sessions",
    ),
    path(
        "studies/<slug:slug>/analysis/files/<slug:kind>/<str:name>",
        analysis_views.file,
        name="analysis_file",
    ),
    path("studies/<slug:slug>/export/", analysis_downloads.page, name="analysis_export"),
    path(
        "studies/<slug:slug>/export/deposit/", analysis_downloads.deposit, name="analysis_deposit"
    ),
    path(
        "studies/<slug:slug>/analysis/dataset.zip",
        analysis_downloads.dataset,
        name="analysis_dataset",
    ),
]
