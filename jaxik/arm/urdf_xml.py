"""XML of URDF files, read as tolerantly as other readers of URDF do.

Names with prefixes that nobody declared, odd versions, hyphens in comments, stray ampersands and wrong encodings occur
in published files and do not matter; a tag that is not closed does.
"""

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from jaxik.errors import FileFormatError
from jaxik.tables import decoded

_DECLARATION = re.compile(r"\s*<\?xml\b[^>]*\?>")
_ENCODING = re.compile(rb"<\?xml[^>]{0,200}encoding\s*=\s*[\"']([A-Za-z0-9._-]{1,40})[\"']")
_STRAY = re.compile(r"&(?!(?:#\d+|#x[0-9A-Fa-f]+|\w+);)")


@dataclass
class Element:
    """An XML element without its text.

    Attributes:
        tag: Name, with its prefix.
        attributes: Attributes by name.
        line: Line of the file on which it begins.
        children: Elements inside.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: "list[Element]" = field(default_factory=list)

    def get(self, name: str) -> str | None:
        """Return an attribute, or None."""
        return self.attributes.get(name)

    def all(self, tag: str) -> "Iterator[Element]":
        """Iterate over the children with a tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> "Element | None":
        """Return the first child with a tag, or None."""
        return next(self.all(tag), None)


def read_xml(path: Path) -> tuple[Element, str]:
    """Return the root element of a file, and the file's text.

    Args:
        path: The file.

    Raises:
        OSError: The file cannot be opened.
        FileFormatError: It is not well-formed; names the line.
    """
    text = _text(path)
    declaration = _DECLARATION.match(text)
    body = text[declaration.end() :] if declaration else text.lstrip()
    above = text[: len(text) - len(body)].count("\n")
    roots: list[Element] = []
    open_elements: list[Element] = []
    parser = expat.ParserCreate()  # without namespaces, a prefix is a part of the name

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentLineNumber + above)
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(tag: str) -> None:
        open_elements.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.UseForeignDTD(True)  # entities that nobody defined are skipped
    try:
        parser.Parse(_STRAY.sub("&amp;", _without_comments(body)), True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise FileFormatError(f"{path}, line {error.lineno + above}: not well-formed XML: {reason}") from None
    return roots[0], text


def _text(path: Path) -> str:
    """Return the file's text; a wrong encoding spoils remarks and material names only."""
    data = path.read_bytes()
    declared = _ENCODING.search(data[:400])
    if declared and declared[1].lower() not in (b"utf-8", b"utf-16"):
        try:
            return data.decode(codecs.lookup(declared[1].decode()).name)
        except (LookupError, ValueError):
            pass
    try:
        return decoded(data)
    except ValueError:
        return data.decode("latin-1")


def _without_comments(text: str) -> str:
    """Return the text with the comments' line breaks only; XML forbids two hyphens inside, which many authors write."""
    kept, at = [], 0
    while (start := text.find("<!--", at)) >= 0 and (end := text.find("-->", start + 4)) >= 0:
        kept += [text[at:start], "\n" * text.count("\n", start, end)]
        at = end + 3
    return "".join([*kept, text[at:]])
