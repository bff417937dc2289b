"""Learned inertial odometry in its published architectures: RoNIN's and TLIO's ResNet-18, EqNIO's equivariant frame.

`torch` is imported by `resnet`, `equivariant`, `inference`, `weights` and `train` only, `python -m
pdrbench_lab.learned.odometry train` trains a network.
"""
