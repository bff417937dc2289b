"""Numbers of claims as text."""

from __future__ import annotations

import math
from typing import Final

from pdrbench.evaluation.number_text import NOTHING

SHARE: Final = "share"  # the unit of a fraction, which is shown in percent


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
