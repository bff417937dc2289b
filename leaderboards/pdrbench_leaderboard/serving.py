"""Requests to `leaderboard serve`: files of the site and nothing else, for a browser on this machine."""

from __future__ import annotations

import io
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from typing import BinaryIO, Final

LOCAL: Final = ("127.0.0.1", "localhost")


class SiteHandler(SimpleHTTPRequestHandler):
    """Serves a folder; no link leads out of it, and no page from elsewhere reads it under a name of its own."""

    def send_head(self) -> io.BytesIO | BinaryIO | None:
        """As its parent does, where the request is for this machine and the file lies in the folder."""
        if self.headers.get("Host", "").rpartition(":")[0] not in LOCAL:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST, "This server answers to 127.0.0.1 and localhost")
            return None
        if not Path(self.translate_path(self.path)).resolve().is_relative_to(Path(self.directory).resolve()):
            self.send_error(HTTPStatus.NOT_FOUND)
            return None
        return super().send_head()

    def list_directory(self, path: object) -> None:
        """Names of files are not listed."""
        self.send_error(HTTPStatus.NOT_FOUND)
