"""Access points and beacons: propagation, scans and surveys.

`wlan` is propagation and an ideal receiver, `networks.make_networks` the WLAN of a building as phones find it,
`scans.scan_walk` the scans of a phone on its way, `survey` a radio map, `ble` Bluetooth beacons. `rays` finds the walls
between two places.
"""
