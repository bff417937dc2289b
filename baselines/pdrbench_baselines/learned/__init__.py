"""Stride and heading of a phone by a small neural network, trained here: `python -m pdrbench_baselines.learned`.

`torch` and `safetensors` (extra `learned`) are imported by `model`, `weights` and `train` only.
"""
