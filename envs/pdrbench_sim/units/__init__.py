"""Inertial units: error profiles, and what one of a kind measures.

`motion.RigidMotion` gives ideal signals, `device.draw_unit` a unit of a profile (`profiles.imu_profile`) that measures
them. `strides.measure` gives what a unit on a foot makes of true strides.
"""
