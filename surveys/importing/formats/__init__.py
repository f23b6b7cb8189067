"""The file formats of other survey systems, by name: each module of this package is one."""

from surveys.importing.draft import SurveyFormat
from surveys.registry import family

FORMATS = family(__name__, __path__, SurveyFormat)
