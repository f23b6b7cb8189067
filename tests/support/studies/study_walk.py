"""A participant who goes through a study over HTTP: what they see, and how they answer a step."""

from dataclasses import dataclass
from typing import Any

from django.test import Client
from django.urls import reverse
from django.utils import timezone

from accounts.models import User
from experiments.definition.step import AskingStep, DriveStep, Step
from experiments.models import Participant, Study
from experiments.participation import progress
from robots.models import Robot
from surveys.models import Response
from tests.support.browsers.html_page import Page, read
from tests.support.studies import participants as p


@dataclass
class Walker:
    """One user, who may have several browsers."""

    study: Study
    user: User
    robot: Robot

    def __post_init__(self) -> None:
        self.client = self.browser()

    def browser(self) -> Client:
        client = Client()
        client.force_login(self.user)
        return client

    @property
    def participant(self) -> Participant:
        found = progress.found(self.study, self.user)
        assert found is not None
        return found

    @property
    def step(self) -> Step:
        return progress.step_of(self.participant)

    def url(self, name: str = "study_step") -> str:
        return reverse(name, args=[self.study.slug])

    def come(self) -> Any:
        return self.client.post(self.url("study"))

    def look(self, client: Client | None = None) -> Page:
        """What the step's address shows, wherever it leads."""
        return read((client or self.client).get(self.url(), follow=True))

    def send(self, client: Client | None = None, **fields: str) -> Any:
        return (client or self.client).post(
            self.url(), {"place": progress.place(self.participant).word, **fields}
        )

    def answers(self) -> dict[str, str]:
        """What a page of the current step sends."""
        here = {"place": progress.place(self.participant).word}
        return {**here, "age": "30", "agree": "on"} if self.step.kind == "consent" else here

    def do(self, client: Client | None = None) -> None:
        """Do what the current step asks, in a browser, and look where that leads."""
        if isinstance(self.step, AskingStep):
            self.look(client)
            Response.objects.filter(user=self.user, finished_at=None).update(
                finished_at=timezone.now()
            )
        elif isinstance(self.step, DriveStep):
            self.drive()
        elif self.step.kind != "debrief":
            (client or self.client).post(self.url(), self.answers())
        self.look(client)

    def drive(self, outcome: str = "completed", *, moved: bool = True) -> Any:
        own = self.participant
        if not own.cell:
            cell = progress.assignment.cells(self.study.as_definition(), "open")[0]
            own = p.assign(own, *cell.conditions)
        return p.drive_of(self.robot, own, outcome=outcome, moved=moved)
