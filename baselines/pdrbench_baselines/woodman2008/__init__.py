"""Woodman & Harle 2008: a particle filter for strides on a 2.5-D map, with KLD sampling and a start by WLAN."""
