"""Learned inertial odometry in its published architectures: RoNIN's and TLIO's ResNet-18.

`torch` is imported by `resnet`, `inference`, `weights` and `train` only; `python -m pdrbench_lab.learned odometry`
trains a network.
"""
