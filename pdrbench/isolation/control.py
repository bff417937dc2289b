"""Orders to a launcher and its answers: JSON behind four bytes of length, with descriptors where there are any."""

from __future__ import annotations

import json
import socket
from collections.abc import Sequence
from typing import Any, Final

LENGTH_BYTES: Final = 4


def send(control: socket.socket, content: dict[str, Any], descriptors: Sequence[int] = ()) -> None:
    """Sends one object; the descriptors go with its first bytes."""
    body = json.dumps(content).encode()
    message = len(body).to_bytes(LENGTH_BYTES, "little") + body
    sent = socket.send_fds(control, [message[:LENGTH_BYTES]], descriptors) if descriptors else 0
    control.sendall(message[sent:])


def receive(control: socket.socket, most_descriptors: int) -> tuple[dict[str, Any], list[int]]:
    """The next object, and what came with it; raises `EOFError` where the other side has left."""
    head, descriptors, _, _ = socket.recv_fds(control, LENGTH_BYTES, most_descriptors)
    if not head:
        raise EOFError
    head += _exactly(control, LENGTH_BYTES - len(head))
    content: dict[str, Any] = json.loads(_exactly(control, int.from_bytes(head, "little")))
    return content, list(descriptors)


def _exactly(control: socket.socket, size: int) -> bytes:
    content = bytearray()
    while len(content) < size:
        part = control.recv(size - len(content))
        if not part:
            raise EOFError
        content += part
    return bytes(content)
