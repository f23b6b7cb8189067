"""Reading XML that may be hostile: depth and number of elements are bounded, and a document type
is refused before it is read, because only it can define entities or refer to other files.
"""

from typing import NoReturn
from xml.etree import ElementTree as ET

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError

MAX_DEPTH = 50
MAX_ELEMENTS = 500_000


class _BoundedTree(ET.TreeBuilder):
    def __init__(self) -> None:
        super().__init__()
        self._depth = self._count = 0

    def start(self, tag: str, attributes: dict[str, str], /) -> ET.Element:
        self._depth += 1
        self._count += 1
        if self._depth > MAX_DEPTH or self._count > MAX_ELEMENTS:
            raise BadDefinitionError([_("The XML file is nested too deeply or is too long.")])
        return super().start(tag, attributes)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, *_declared: str | None) -> NoReturn:
        words = _(
            "The XML file contains a document type or entities, which this site does not accept."
        )
        raise BadDefinitionError([words])


def read(document: bytes) -> ET.Element:
    """Return the root of an XML document, names with their prefixes. Raises BadDefinitionError for
    one that is malformed, too deep, too long, or has a document type.
    """
    parser = ET.XMLParser(target=_BoundedTree())  # noqa: S314 - the tree refuses entities
    try:
        parser.feed(document)
        return parser.close()
    except BadDefinitionError:
        raise
    except (ET.ParseError, ValueError, LookupError) as error:
        words = _("This is not valid XML: %(problem)s.") % {"problem": error}
        raise BadDefinitionError([words]) from error
