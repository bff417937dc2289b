"""Frank et al. 2009: WLAN fingerprints and a foot-mounted inertial unit in a cascaded Kalman filter."""
