"""The motion of a foot-mounted inertial unit."""
