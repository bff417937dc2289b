"""The heading of a walker from the attitude of a phone, step by step (Li et al. 2012, claims L10 and L11).

The phone sits in a pocket in any way. Once, when the walker's heading is known, the turn Q between the attitude in the
pocket and that of a phone which points ahead is taken: V_h Q^-1 = V_p, eq. (1), hence Q = V_p^-1 V_h. In a pocket the
phone swings with the thigh, but at one point of every step, while one leg passes the other, it is where it was. There
the same Q leads back to the walker: V_u(t) = V_p(t) Q, whose top edge points where the walker goes. Quaternions are
Hamilton, body to building, so that Q acts on the side of the body.
"""

from __future__ import annotations

import math

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import about_vertical, inverse, multiply, phone_heading_rad


def facing(heading_rad: float) -> FloatArray:
    """(4,) V_h: a phone that lies flat in the hand of its owner and points where they walk.

    Its pitch is of no consequence for the heading and is left at zero.

    >>> round(float(phone_heading_rad(facing(0.3))), 6)
    0.3
    """
    return about_vertical(heading_rad - math.pi / 2)  # unrotated, the top edge points along +y


def to_user(attitude: FloatArray, heading_rad: float) -> FloatArray:
    """(4,) Q of eq. (1).

    Args:
        attitude: (4,) V_p, of the phone where it is carried.
        heading_rad: Of the walker at that moment.
    """
    return multiply(inverse(attitude), facing(heading_rad))


class UserHeading:
    """Headings of steps from the attitudes at their inference points.

    A thigh is in the same attitude at every other step only: the phone's own leg passes the other one, or is passed.
    The paper takes one Q for all steps.

    Args:
        start_heading_rad: Of the walker during the first step; None for a phone that points ahead, which is assumption
            1 of the paper with an offset of zero: Q is no turn at all.
        alternate_q: Two Q, one for each leg; the second is taken at the second step, with the same heading.
    """

    def __init__(self, start_heading_rad: float | None = None, *, alternate_q: bool = False) -> None:
        self._start_heading_rad = start_heading_rad
        self._transforms: list[FloatArray] = []
        self._num_transforms = 2 if alternate_q else 1
        self._num_steps = 0

    def heading_rad(self, attitude: FloatArray) -> float:
        """Of the next step.

        Args:
            attitude: (4,) wxyz of the phone at its inference point.
        """
        if self._start_heading_rad is None:
            return float(phone_heading_rad(attitude))
        if len(self._transforms) < self._num_transforms:
            self._transforms.append(to_user(attitude, self._start_heading_rad))
        transform = self._transforms[self._num_steps % len(self._transforms)]
        self._num_steps += 1
        return float(phone_heading_rad(multiply(attitude, transform)))
