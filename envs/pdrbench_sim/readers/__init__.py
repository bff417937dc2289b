"""Readers of recorded sets: each converts the files of one set to the units, axes and clock of pdrbench.

Environments replay these recordings; the laboratory fits the simulator to them and compares it with them. `pdrbench
inspect` and `pdrbench convert` find the readers through the table `pdrbench_sim.READERS`.
"""
