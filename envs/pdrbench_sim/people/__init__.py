"""People, the routes they plan, the walks they take and where their feet rest.

In this order: `person.draw_person`, `route.navigation_mesh`, `walker.walk_through` (a `walk.SimulatedWalk`) and
`strides.stances`, the rests of both feet; `strides.strides` turns rests into strides.
"""
