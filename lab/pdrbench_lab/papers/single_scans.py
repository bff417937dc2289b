"""Scans one by one, as the papers' receivers took them: no sweep, no memory, every access point one identifier."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from pdrbench.geometry import FloatArray
from pdrbench_sim.noise import autoregressive
from pdrbench_sim.radio.wlan import RadioField


def receive(
    field: RadioField,
    rng: np.random.Generator,
    t_s: ArrayLike,
    polygon: ArrayLike,
    xy_m: ArrayLike,
    heading_rad: ArrayLike,
    *,
    doors_open: ArrayLike = True,
) -> FloatArray:
    """One scan at each of K places on the way of one receiver.

    Args:
        field: Access points (A) and their propagation.
        rng: Draws fading, the body's loss and what is noticed.
        t_s: (K,) non-decreasing: what lies close in time fades alike, first-order autoregressive.
        polygon: (K,) int, floor polygon of each place.
        xy_m: (K, 2).
        heading_rad: (K,) where the bearer faces: the body is behind the receiver.
        doors_open: As for `RadioField.rssi_mean_dbm`.

    Returns:
        (K, A) whole dBm, NaN where an access point went unnoticed.
    """
    params, building = field.params, field.building
    place_xy_m = np.asarray(xy_m, dtype=np.float64).reshape(-1, 2)
    height_m = building.height(polygon) + params.receiver_height_m
    rssi_dbm = field.rssi_mean_dbm(building.level(polygon), place_xy_m, height_m, doors_open=doors_open)
    max_loss_db = rng.uniform(*params.body_loss_db, size=(len(place_xy_m), 1))
    rssi_dbm -= field.body_loss_db(place_xy_m, np.asarray(heading_rad, dtype=np.float64), max_loss_db)
    noise = rng.standard_normal(rssi_dbm.shape)
    kept = params.fading_correlation_1s ** np.diff(np.asarray(t_s, dtype=np.float64))
    rssi_dbm += params.fading_sigma_db * autoregressive(noise, kept)
    is_noticed = rng.random(rssi_dbm.shape) < ndtr((rssi_dbm - params.detection_dbm) / params.detection_width_db)
    return np.where(is_noticed, np.clip(np.rint(rssi_dbm), -128.0, 127.0), np.nan)


def wifi_rows(field: RadioField, t_s: FloatArray, rssi_dbm: FloatArray) -> FloatArray:
    """(n, 5) rows of the `wifi` stream: scans at times (K,) of what `receive` returns, (K, A)."""
    scan, sender = np.nonzero(~np.isnan(rssi_dbm))
    senders = field.access_points
    columns = (t_s[scan], senders.id[sender], rssi_dbm[scan, sender], senders.frequency_mhz[sender])
    return np.column_stack([*columns, np.zeros(len(scan))])
