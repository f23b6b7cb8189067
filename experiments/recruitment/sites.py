"""What recruitment sites add to a study's link, and how they want participants back.

- Prolific: https://docs.prolific.com/api-reference/studies/the-study-object (`external_study_url`,
  `completion_codes`);
- Amazon Mechanical Turk: ApiReference_ExternalQuestionArticle of its API. An assignment id is not
  unique, because a returned assignment goes to another worker: workers are recognized by their own;
- Sona: "External Study Credit Granting" of its help. Opening the return address grants the credit;
- CloudResearch Connect: "Project Completion" of its help: each ending has a redirect of its own;
- `other`: any site that can add a parameter to the link, as oTree's `participant_label` is used.

Pure: parameters of a link come in, an id or an address goes out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

import msgspec

from experiments.definition.recruitment.recruiting import Ending, Recruiting

LONGEST_ID = 100
# A preview: the worker has not accepted the assignment yet.
MTURK_PREVIEW = "ASSIGNMENT_ID_NOT_AVAILABLE"
MTURK_HOSTS = frozenset({"www.mturk.com", "workersandbox.mturk.com"})


@dataclass(frozen=True)
class SiteProfile:
    """A recruitment site (sites.toml): the parameters that hold the participant's id and the id of
    this submission, what the study's link must end in, the address to return to, and the endings
    that lead there.
    """

    title: str
    id_parameter: str
    session_parameter: str = ""
    query: str = ""
    return_address: str = ""
    returning: tuple[Ending, ...] = ()


PROFILES = msgspec.toml.decode(
    Path(__file__).with_suffix(".toml").read_bytes(), type=dict[str, SiteProfile]
)
UNKNOWN = SiteProfile("", "")
ANY = Recruiting()


@dataclass(frozen=True)
class Arrival:
    """The person that a link names: the site, the id there, and the id of the submission."""

    site: str = ""
    identifier: str = ""
    session: str = ""


UNNAMED = Arrival()


def arrival(recruiting: Recruiting | None, parameters: Mapping[str, str]) -> Arrival:
    """Return the person that a link's parameters name; UNNAMED without an id. A study that names no
    site recognizes the parameters of every known one.
    """
    asked = recruiting or ANY
    names = list(PROFILES) if asked.site == "any" else [asked.site]
    for name in names:
        profile = PROFILES.get(name, UNKNOWN)
        key = asked.id_parameter or profile.id_parameter
        identifier = parameters.get(key, "").strip()[:LONGEST_ID]
        session = parameters.get(profile.session_parameter, "").strip()[:LONGEST_ID]
        # a placeholder that the site did not fill in would make all participants one person
        is_placeholder = "%" in identifier or identifier.startswith(("{", "[", "$"))
        if identifier and not is_placeholder and session != MTURK_PREVIEW:
            return Arrival(name, identifier, session)
    return UNNAMED


def return_address(
    recruiting: Recruiting | None, parameters: Mapping[str, str], ending: Ending, code: str
) -> str:
    """Return the address to which a participant returns at the end; may be empty."""
    came = arrival(recruiting, parameters)
    profile = PROFILES.get(came.site, UNKNOWN)
    asked = recruiting or ANY
    template = asked.return_address or profile.return_address
    returning = asked.returning or profile.returning
    if not came.identifier or not template or not code or (returning and ending not in returning):
        return ""
    if came.site == "mturk" and not asked.return_address:
        host = urlsplit(parameters.get("turkSubmitTo", "")).netloc
        if host in MTURK_HOSTS:  # any other host would be an open redirect
            template = template.replace("www.mturk.com", host)
    values = {"code": code, "id": came.identifier, "session": came.session}
    for name, value in values.items():
        template = template.replace(f"{{{name}}}", quote(value, safe=""))
    return template


def study_link(recruiting: Recruiting | None, address: str) -> str:
    site = (recruiting or ANY).site
    query = PROFILES[site].query if site in PROFILES else ""
    return f"{address}?{query}" if query else address
