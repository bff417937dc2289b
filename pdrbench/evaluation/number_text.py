"""Numbers as text for tables and pages."""

from __future__ import annotations

import math
from typing import Final

NEVER: Final = "never"
NOTHING: Final = "–"
SHARE: Final = "share"  # the unit of a fraction, which is shown in percent


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


def three_digits(value: float, unit: str = "") -> str:
    """Three digits and the unit, with a space between thousands; a fraction in percent.

    >>> three_digits(4531234.0), three_digits(151_000), three_digits(0.4962, "m"), three_digits(0.985, "share")
    ('4.53 M', '151 000', '0.496 m', '98.5 %')
    """
    if math.isnan(value):
        return NOTHING
    if unit == SHARE:
        return f"{100 * value:.3g} %"
    if math.isinf(value):
        text = "∞" if value > 0 else "-∞"
    elif 999_999.5 <= abs(value) < 999.5e6:
        text = f"{value / 1e6:.3g} M"
    elif 999.5 <= abs(value) < 999_999.5:
        text = f"{value:,.0f}".replace(",", " ")
    else:
        text = f"{value:.3g}"
    return f"{text} {unit}".rstrip()
