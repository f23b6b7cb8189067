"""Addresses of the pages on which replays are coded."""

from django.urls import URLPattern, path

from experiments.research import coding_views as views

urlpatterns: list[URLPattern] = [
    path("studies/<slug:slug>/coding/", views.study_page, name="study_coding"),
    path("studies/<slug:slug>/coding/scheme/", views.upload_scheme, name="coding_scheme"),
    path("studies/coding/<uuid:session>/", views.code_page, name="code_session"),
    path("studies/coding/<uuid:session>/record.json", views.record, name="coding_record"),
    path("studies/coding/<uuid:session>/events.json", views.events, name="coding_events"),
    path("studies/coding/<uuid:session>/save/", views.save, name="coding_save"),
    path("studies/coding/<uuid:session>/done/", views.done, name="coding_done"),
    path("studies/coding/<uuid:session>/import/", views.upload, name="coding_import"),
    *(
        path(
            f"studies/coding/<uuid:session>/coding.{kind}",
            views.download,
            {"kind": kind},
            name=f"coding_{kind}",
        )
        for kind in ("eaf", "boris")
    ),
]
