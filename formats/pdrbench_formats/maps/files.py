"""Files of plans from strangers: members of folders and archives, JSON, XML and TOML that can be trusted."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any, Final, NoReturn
from xml.etree import ElementTree

import msgspec

from pdrbench.errors import MapError, RecordingError
from pdrbench.io.compressed import plain_name
from pdrbench.io.container import Container, open_container
from pdrbench.io.text import from_utf16
from pdrbench_formats.toml import Table, read_toml

MAX_MEMBER_BYTES: Final = 256 << 20
MAX_NAME: Final = 250  # characters
MAX_XML_DEPTH: Final = 100  # GML has 15 levels; what looks below each element takes the square of it
_UTF16_DECLARED: Final = re.compile(rb"\A(\s*<\?xml[^>]*?)\s+encoding=.UTF-16(?:LE|BE)?.", re.I)


def opened(path: Path) -> Container:
    """A file, folder or archive; `MapError` where it cannot be read."""
    try:
        return open_container(Path(path))
    except RecordingError as error:
        raise MapError(str(error)) from error


def member(container: Container, name: str) -> bytes:
    """The content of a member, UTF-16 as UTF-8 and without a byte-order mark, decompressed where it is compressed.

    Raises:
        MapError: It is missing, too large or damaged.
    """
    if name not in container.sizes and not container.is_file:
        raise MapError(f"{container.path}: holds no {name!r}; it has {', '.join(sorted(container.sizes)[:12])}")
    if container.sizes.get(name, 0) > MAX_MEMBER_BYTES:
        raise MapError(f"{container.label(name)}: more than {MAX_MEMBER_BYTES >> 20} MiB; simplify the plan")
    try:
        content = from_utf16(container.read(name, MAX_MEMBER_BYTES + 1))
    except RecordingError as error:
        raise MapError(str(error)) from error
    if len(content) > MAX_MEMBER_BYTES:
        raise MapError(f"{container.label(name)}: more than {MAX_MEMBER_BYTES >> 20} MiB unpacked; simplify the plan")
    return _UTF16_DECLARED.sub(rb"\1", content, count=1)


def name_of(path: Path) -> str:
    """The name of a file without its endings, for a building that has no other."""
    return Path(plain_name(path.name)).stem


def decoded(content: bytes, kind: Any, where: object) -> Any:
    """JSON of a shape; `MapError` where it is none."""
    try:
        return msgspec.json.decode(content, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MapError(f"{where}: {error}; copy or export the plan again") from error


class _NoEntities(ElementTree.TreeBuilder):
    def doctype(self, *_: object) -> NoReturn:
        raise LookupError("it declares XML entities, which no plan needs")


def xml_root(content: bytes, path: Path) -> ElementTree.Element:
    """The root of an XML document, in whatever encoding it declares; `MapError` where it is none."""
    try:
        root = ElementTree.fromstring(content, ElementTree.XMLParser(target=_NoEntities()))
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter two of encodings
        raise MapError(f"{path}: not XML that can be read ({error}); export it again") from error
    nodes = [root]
    for _ in range(MAX_XML_DEPTH):
        nodes = [child for node in nodes for child in node]
    if nodes:
        raise MapError(f"{path}: XML of more than {MAX_XML_DEPTH} levels; export it again")
    return root


def toml_table(path: Path, kind: type[Table], needs: str) -> Table:
    """A TOML file of a shape; `MapError`, which says what it `needs`, where it is none."""
    try:
        return read_toml(path, kind, "Buildings")
    except RecordingError as error:
        raise MapError(f"{error}; {needs}") from error


def beside(table: Path, name: str) -> Path:
    """The path of a file in the folder of a table that names it; `MapError` where it would lie elsewhere."""
    inside = PurePosixPath(name)
    if inside.is_absolute() or ".." in inside.parts or not 0 < len(name) <= MAX_NAME or not name.isprintable():
        raise MapError(f"{table}: {name[:80]!r} is no file beside it; copy it there")
    return table.parent / inside
