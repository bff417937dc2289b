"""Trials of the EvAAL competition: a server of environments, and a client that plays a server with a localizer."""

from __future__ import annotations

from typing import Final

COMMANDS: Final = {"evaal": "pdrbench_evaal.command:app"}
