"""Readers of recorded sets: each converts the files of one set to the units, axes and clock of pdrbench.

The simulator is fitted to these recordings and compared with them, and environments replay them. `pdrbench inspect` and
`pdrbench convert` find the readers through the table `pdrbench_sim.READERS`.
"""
