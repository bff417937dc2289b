"""Procedural buildings, and the parts they are assembled from.

`office.make_office`, `mall.make_mall` and `wings.make_wings` return a `pdrbench.building.Building`. `assembly` has
the cells and openings it is made of, `stairwell` the treads; `walls` and `passages` answer what walkers ask of it.
"""
