"""Safe reading of XML files, and the list of faults found in these files.

A description contains only data: this module refuses a DTD and entities, and loads nothing from other places.
The size of the file and the depth of its elements are bounded. This module collects all faults of a file, so
that a user can correct all of them at once.
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from lxml import etree

from tci.errors import DescriptionError, Fault

MAX_BYTES = 1 << 20
"""Size [bytes] of the largest description that is read. Real descriptions have some tens of kilobytes."""
MAX_DEPTH = 64
"""Deepest nesting of elements that is read. Valid descriptions need a depth of only 6."""
MAX_FAULTS = 500
"""Largest number of faults that are listed. Further faults are only counted."""

_DOCTYPE = re.compile(r"(?>\s|<\?.*?\?>|<!--.*?-->)*+<!DOCTYPE", re.DOTALL)
_ENCODING = re.compile(r"""<\?xml[^>]*?encoding\s*=\s*["']([^"']*)["']""")
_POSITION = re.compile(r"(, line \d+, column \d+)?( \([^()]*, line \d+\))?$")


class Faults:
    """The faults of one file, in the order in which they are found."""

    def __init__(self, source: str) -> None:
        self.source = source
        self._found: dict[Fault, None] = {}
        self._more = 0
        self.angles = self.implausible = 0
        """Number of angles that were read, and number of these angles that are too large for their unit."""

    def add(self, line: int, message: str) -> None:
        """Records a fault on `line`. The first line is 1; 0 means that the fault belongs to no line."""
        if len(self._found) >= MAX_FAULTS:
            self._more += 1
        else:
            self._found[Fault(line, message)] = None

    def __bool__(self) -> bool:
        return bool(self._found)

    def check(self) -> None:
        """Raises DescriptionError with all faults found so far, sorted by line, if there are any."""
        if self._found:
            faults = sorted(self._found, key=lambda fault: fault.line)
            if self._more:
                faults.append(Fault(0, f"and {self._more} more faults"))
            raise DescriptionError(self.source, faults)


def refuse(source: str, line: int, message: str) -> DescriptionError:
    """Returns the error to raise for a fault after which the rest of the file can't be read."""
    return DescriptionError(source, [Fault(line, message)])


def read_bytes(path: Path, *, limit: int = MAX_BYTES) -> bytes:
    """Returns the bytes of a regular file. Raises DescriptionError if the file can't be read or has more than
    `limit` bytes."""
    try:
        # Without O_NONBLOCK, opening a named pipe would block for ever.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise refuse(str(path), 0, f"can't be opened: {reason}; valid: the path of a file") from error
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise refuse(str(path), 0, "is not a regular file; valid: the path of a file")
    with os.fdopen(handle, "rb") as file:
        try:
            data = file.read(limit + 1)
        except OSError as error:
            raise refuse(str(path), 0, f"can't be read: {error.strerror}") from error
    if len(data) > limit:
        raise refuse(str(path), 0, f"has more than {limit} bytes, which is the most that is read")
    return data


def parse(data: bytes, source: str) -> etree._Element:
    """Returns the root element of an XML document in UTF-8.

    Raises DescriptionError if the document is not well-formed, has a DTD or another encoding, or if its
    elements are nested deeper than MAX_DEPTH.
    """
    text = _decode(data, source)
    if doctype := _DOCTYPE.match(text):
        line = 1 + text.count("\n", 0, doctype.end())
        raise refuse(source, line, "a DTD (<!DOCTYPE>) is refused, and with it all entities; remove it")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False,
        huge_tree=False, recover=False, encoding="utf-8",
    )  # fmt: skip
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        reason = _POSITION.sub("", (error.msg or "empty").strip()).strip()
        raise refuse(source, error.lineno or 1, f"not well-formed XML: {reason}{_hint(reason)}") from None
    depth = 0
    for event, element in etree.iterwalk(root, events=("start", "end")):
        depth += 1 if event == "start" else -1
        if depth > MAX_DEPTH:
            line = element.sourceline or 0
            raise refuse(source, line, f"elements are nested more than {MAX_DEPTH} deep")
    return root


def _decode(data: bytes, source: str) -> str:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = 1 + data.count(b"\n", 0, error.start)
        raise refuse(source, line, f"byte {error.start} is not UTF-8; save the file as UTF-8") from None
    declared = _ENCODING.match(text)
    if declared and declared[1].lower() not in ("utf-8", "us-ascii", "ascii"):
        raise refuse(source, 1, f"encoding {shown(declared[1])} is refused; save the file as UTF-8")
    return text


def _hint(reason: str) -> str:
    if "end of the document" in reason:
        return "; everything belongs into one root element, <generic_robot>"
    if "tag mismatch" in reason:
        return "; an end tag must have the name of the element that it ends"
    if "Entity" in reason:
        return "; only &lt; &gt; &amp; &quot; &apos; exist"
    return ""


def shown(text: str) -> str:
    """Returns `text` as messages show it: on one line, in ASCII, and shortened."""
    return ascii(text if len(text) <= 60 else text[:57] + "...")
