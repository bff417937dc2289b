"""The motion of a phone in the hand or in a pocket, and what its sensors deliver.

`phone.phone_motion` moves a phone with its walker (`gait`, `carry`). `sensors.phone_rows` gives the rows of its
sensors, with the errors of the magnetometer (`magnetometer`) and of the reported attitude (`heading`).
"""
