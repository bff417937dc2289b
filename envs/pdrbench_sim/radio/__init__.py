"""Access points and beacons: propagation, scans and surveys."""
