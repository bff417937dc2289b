"""Sockets of the network and of the machine."""

from __future__ import annotations

import os
import socket
import struct

from hostile.common import CALLS, NETWORK, Attempt, Probe
from hostile.targets import TARGETS


class OpensSockets(Probe):
    def attempts(self) -> dict[str, Attempt]:
        return {
            "tcp": (
                lambda: self.connects(socket.AF_INET, ("127.0.0.1", int(TARGETS["port"]))),
                CALLS | NETWORK | {"landlock-net"},
            ),
            "udp": (lambda: self.sends_to(("127.0.0.1", int(TARGETS["udp_port"]))), CALLS | NETWORK),
            "unix": (lambda: self.connects(socket.AF_UNIX, TARGETS["unix"]), CALLS),
            "abstract": (
                lambda: self.connects(socket.AF_UNIX, "\0" + TARGETS["abstract"]),
                CALLS | NETWORK | {"landlock-scope"},
            ),
            "listen": (lambda: self.listens(), CALLS | {"landlock-net"}),
            "pair": (lambda: self.sends_over_a_pair(socket.SOCK_DGRAM), CALLS),
            "pair-of-packets": (lambda: self.sends_over_a_pair(socket.SOCK_SEQPACKET), CALLS),
            "pair-descriptor": (lambda: self.sends_descriptor(), CALLS),
        }

    def sends_over_a_pair(self, kind: int) -> bool:
        """A datagram socket that was never bound nor connected reaches any address."""
        ours, _ = socket.socketpair(socket.AF_UNIX, kind)
        ours.sendto(b"the truth", TARGETS["unix_datagram"])
        return True

    def sends_descriptor(self) -> bool:
        ours, _ = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, struct.pack("i", os.open(".", os.O_RDONLY)))]
        return ours.sendmsg([b"the truth"], rights, 0, TARGETS["unix_datagram"]) > 0

    def connects(self, family: int, address: object) -> bool:
        with socket.socket(family, socket.SOCK_STREAM) as caller:
            caller.settimeout(1.0)
            caller.connect(address)  # type: ignore[arg-type]
        return True

    def sends_to(self, address: tuple[str, int]) -> bool:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caller:
            caller.sendto(b"the truth", address)
        return False  # whether it arrived is for the test to see

    def listens(self) -> bool:
        with socket.create_server(("127.0.0.1", 0)):
            return True
