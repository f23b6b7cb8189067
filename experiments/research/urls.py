"""Addresses of the researchers' pages."""

from django.urls import URLPattern, URLResolver, include, path

from experiments.research import analysis_downloads, analysis_views, coding_views, views
from experiments.research.invitations import invitation

_ANALYSIS = [
    path("", analysis_views.page, name="analysis"),
    path("dataset.zip", analysis_downloads.dataset, name="analysis_dataset"),
    path("<slug:topic>/", analysis_views.page, name="analysis_topic"),
    path("tables/<slug:name>/", analysis_views.table, name="analysis_table"),
    path("sessions/<int:number>/", analysis_views.sessions, name="analysis_sessions"),
    path("files/<slug:kind>/<str:name>", analysis_views.file, name="analysis_file"),
]
_OF_STUDY = [
    path("analysis/", include(_ANALYSIS)),
    path("export/", analysis_downloads.page, name="analysis_export"),
    path("export/deposit/", analysis_downloads.deposit, name="analysis_deposit"),
    path("live/", views.live_page, name="study_live"),
    path("live.json", views.live_data, name="study_live_data"),
    path("live/act/", views.live_act, name="study_live_act"),
    path("coding/", coding_views.study_page, name="study_coding"),
    path("coding/scheme/", coding_views.upload_scheme, name="coding_scheme"),
]
_OF_CODING = [
    path("", coding_views.code_page, name="code_session"),
    path("record.json", coding_views.record, name="coding_record"),
    path("events.json", coding_views.events, name="coding_events"),
    path("save/", coding_views.save, name="coding_save"),
    path("done/", coding_views.done, name="coding_done"),
    path("import/", coding_views.upload, name="coding_import"),
    path("coding.eaf", coding_views.download, {"kind": "eaf"}, name="coding_eaf"),
    path("coding.boris", coding_views.download, {"kind": "boris"}, name="coding_boris"),
]
_REPLAY = "studies/replay/<uuid:session>"

urlpatterns: list[URLPattern | URLResolver] = [
    path("studies/invitation/<str:token>/", invitation, name="study_invitation"),
    path(f"{_REPLAY}/", views.replay_page, name="replay"),
    path(f"{_REPLAY}.json", views.replay_data, name="replay_data"),
    path(f"{_REPLAY}/photos/<uuid:photo>.jpg", views.replay_photo, name="replay_photo"),
    path("studies/coding/<uuid:session>/", include(_OF_CODING)),
    path("studies/<uuid:pk>/analysis/", analysis_views.of_version, name="study_analysis"),
    path("studies/<slug:slug>/", include(_OF_STUDY)),
]
