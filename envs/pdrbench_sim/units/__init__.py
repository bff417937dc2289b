"""Inertial units: error profiles, what one of a kind measures, and the errors of the strides they yield.

`motion.RigidMotion` gives ideal signals, `device.draw_unit` a unit of a profile (`profiles.imu_profile`) that measures
them. `stride_errors` fits the error model of strides to recordings; `pdrbench error-model` (`command`) prints it.
"""
