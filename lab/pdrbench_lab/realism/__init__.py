"""How far synthetic recordings are from real ones: the same statistics of both, side by side.

Each block (`block.Block`) measures one kind of signal; `BLOCKS` names them and `load_block` imports one. `scorecard`
compares both sides by the criteria of `criteria`, `targets` stores real values; `pdrbench validate-sim` is `command`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from pdrbench.errors import unknown_name
from pdrbench.registry import PluginEntry, PluginError

if TYPE_CHECKING:
    from pdrbench_lab.realism.block import Block

BLOCKS: Final[dict[str, str]] = {
    "foot_imu": "pdrbench_lab.realism.foot:FOOT_IMU",
    "foot_ins": "pdrbench_lab.realism.foot:FOOT_INS",
    "free_inertial": "pdrbench_lab.realism.foot:FREE_INERTIAL",
    "phone": "pdrbench_lab.realism.phone:PHONE",
    "pocket": "pdrbench_lab.realism.phone:POCKET",
    "people": "pdrbench_lab.realism.people:HAND",
    "heading": "pdrbench_lab.realism.heading:HEADING",
    "legs": "pdrbench_lab.realism.heading:LEGS",
    "magnetic": "pdrbench_lab.realism.magnetic:MAGNETIC",
    "radio": "pdrbench_lab.realism.radio:RADIO",
    "gait": "pdrbench_lab.realism.gait:GAIT",
    "order": "pdrbench_lab.realism.ordering:ORDER",
}


def load_block(name: str) -> Block:
    """A block by its registered name or as `package.module:BLOCK`; its module is imported when it is asked for.

    Raises:
        UnknownNameError: No such block; suggests the nearest name.
        PluginError: It cannot be loaded, or is no block.
    """
    from pdrbench_lab.realism.block import Block

    if name not in BLOCKS and ":" not in name:
        raise unknown_name("block", name, BLOCKS)
    found = PluginEntry(name, BLOCKS.get(name, name), "pdrbench").load()
    if not isinstance(found, Block):
        raise PluginError(f"{name} is {type(found).__name__}, not a Block")
    return found
