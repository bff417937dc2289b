"""Strangers' localizers: one process for each walk, which the kernel keeps from files, networks and other processes."""
