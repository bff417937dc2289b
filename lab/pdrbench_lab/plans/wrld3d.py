"""Indoor maps of WRLD 3D as a format of files: the reader of the plan of Westport House, for any folder or archive."""

from __future__ import annotations

from typing import Final

from pdrbench.errors import MapError
from pdrbench.io.reader import Head, Reader
from pdrbench_envs.westport_plan import MAIN, read
from pdrbench_formats.maps.features import member


def sniff(head: Head) -> bool:
    """True for a folder or archive with a `main.json` that lists levels."""
    content = head_member(head, MAIN)
    return b'"levels"' in content and b'"z_order"' in content


def head_member(head: Head, name: str) -> bytes:
    """The content of a member of a folder or archive; empty where there is none or it is damaged."""
    if head.container is None or name not in head.container.sizes:
        return b""
    try:
        return member(head.container, name)
    except MapError:
        return b""


READER: Final = Reader(read, sniff)
