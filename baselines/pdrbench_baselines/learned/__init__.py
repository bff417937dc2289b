"""Stride and heading of a phone by a small neural network, trained here: `python -m pdrbench_baselines.learned`.

`torch` and `safetensors` (extra `learned`) are imported by `model`, `weights` and `train` only.
"""

from pdrbench.arithmetic import compute_alike

compute_alike()  # here, since it counts only before torch computes
