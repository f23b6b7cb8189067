"""XML files of others, read so that a hostile one does no harm.

A document type is refused before anything of it is read: without one there are no entities to
expand and nothing that names another file or address. Depth and number of elements are bounded.
Python's own `xml.etree` takes document types, so its tree is built here from expat's events.
"""

from typing import NoReturn
from xml.etree import ElementTree as ET
from xml.parsers import expat

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError

MAX_DEPTH = 50
MAX_ELEMENTS = 500_000


class _Tree:
    """The events of expat, as a tree."""

    def __init__(self) -> None:
        self._builder = ET.TreeBuilder()
        self._depth = self._count = 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._count += 1
        if self._depth > MAX_DEPTH or self._count > MAX_ELEMENTS:
            raise BadDefinitionError([_("The XML file is nested too deeply or is too long.")])
        self._builder.start(name, attributes)

    def end(self, name: str) -> None:
        self._depth -= 1
        self._builder.end(name)

    def text(self, data: str) -> None:
        self._builder.data(data)

    def close(self) -> ET.Element:
        return self._builder.close()


def _refuse(*_event: object) -> NoReturn:
    raise BadDefinitionError(
        [_("The XML file contains a document type or entities, which this site does not accept.")]
    )


def read(document: bytes) -> ET.Element:
    """Return the root of an XML document; names keep their prefixes as written.

    Raises:
        BadDefinitionError: it is malformed, too deep, too long, or has a document type.
    """
    tree = _Tree()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = tree.start
    parser.EndElementHandler = tree.end
    parser.CharacterDataHandler = tree.text
    parser.StartDoctypeDeclHandler = _refuse
    parser.EntityDeclHandler = _refuse
    parser.ExternalEntityRefHandler = _refuse
    try:
        parser.Parse(document, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        if isinstance(error, BadDefinitionError):
            raise
        raise BadDefinitionError(
            [_("This is not valid XML: %(problem)s.") % {"problem": error}]
        ) from error
    return tree.close()
