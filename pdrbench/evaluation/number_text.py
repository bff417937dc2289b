"""Numbers as text for tables and pages."""

from __future__ import annotations

import math
from typing import Final

NEVER: Final = "never"
NOTHING: Final = "–"


def decimals(value: float | None) -> str:
    """Two decimals, or two digits where that would show zero; "never" for infinity, which JSON holds as None.

    >>> decimals(12.345), decimals(0.01234), decimals(-0.004), decimals(0.0), decimals(None)
    ('12.35', '0.012', '-0.004', '0.00', 'never')
    """
    if value is None or math.isinf(value):
        return NEVER
    return f"{value:.2g}" if 0 < abs(value) < 0.1 else f"{value:.2f}"


def page_decimals(value: float) -> str:
    """`decimals` for pages: a minus sign, and no decimals from 1000 on.

    >>> page_decimals(-0.004), page_decimals(12345.678)
    ('−0.004', '12346')
    """
    text = f"{value:.0f}" if 1000 <= abs(value) < math.inf else decimals(value)
    return text.replace("-", "−")
