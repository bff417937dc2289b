"""The motion of a phone in the hand or in a pocket, and what its sensors deliver.

`phone.phone_motion` moves a phone with its walker (`gait`, `carry`); `magnetometer` and `heading` have the errors of
the magnetometer and of the reported attitude.
"""
