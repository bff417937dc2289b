"""Stride and heading of a phone, or of a unit on a foot, by small neural networks in compiled code."""
