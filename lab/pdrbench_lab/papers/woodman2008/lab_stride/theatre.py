"""A lecture theatre as in Fig. 3 of Woodman & Harle 2008."""

from __future__ import annotations

from pdrbench_lab.papers.woodman2008.lab_stride.plan import Theatre
from pdrbench_lab.papers.woodman2008.lab_stride.rooms import add_end_door
from pdrbench_sim.buildings.assembly import Cell, Draft, Opening, Span, mm


def add_theatre(draft: Draft, theatre: Theatre, level: int, height_m: float) -> None:
    """A flat stage, then rows of seats, each two risers above the one before it.

    A wall separates neighbouring rows. The aisle is stairs: two treads a row, both joined to the ends of that row.
    """
    hall, aisle = theatre.hall, theatre.aisle
    pose, name = hall.pose, f"{level}/{hall.id}"
    front_m = mm(hall.gap_m + theatre.stage_m)
    draft.cells.append(
        Cell(name, pose.rectangle(hall.span, Span(hall.gap_m, front_m)), height_m, level, use="theatre stage")
    )
    add_end_door(draft, hall, level, height_m)
    seats = [
        (side, span)
        for side, span in (("left", Span(hall.span.low, aisle.low)), ("right", Span(aisle.high, hall.span.high)))
        if span.length > 0
    ]
    before, half_m = name, theatre.row_m / 2
    for number in range(theatre.num_rows):
        low_m, middle_m, high_m = (mm(front_m + number * theatre.row_m + i * half_m) for i in range(3))
        top_m = height_m + 2 * (number + 1) * theatre.riser_m
        rows = [f"{name}-row-{number + 1}-{side}" for side, _ in seats]
        for row, (_, span) in zip(rows, seats, strict=True):
            ring = pose.rectangle(span, Span(low_m, high_m))
            draft.cells.append(Cell(row, ring, top_m, level, use="seats"))
        for part, v in (("low", Span(low_m, middle_m)), ("high", Span(middle_m, high_m))):
            tread = f"{name}-aisle-{number + 1}-{part}"
            tread_m = top_m - (theatre.riser_m if part == "low" else 0.0)
            draft.cells.append(Cell(tread, pose.rectangle(aisle, v), tread_m, level, "stairs", "stairs"))
            draft.join(before, tread, pose, aisle, v.low)
            for row, (side, _) in zip(rows, seats, strict=True):
                u_m = aisle.low if side == "left" else aisle.high
                draft.openings.append(Opening(tread, row, pose.point(u_m, v.low), pose.point(u_m, v.high)))
            before = tread
