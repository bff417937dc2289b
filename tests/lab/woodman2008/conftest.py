from __future__ import annotations

from sample_buildings import hangar, stairs

__all__ = ["hangar", "stairs"]
