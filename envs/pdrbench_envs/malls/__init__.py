"""`MallPhone-v1` and `MallPhoneLost-v1`: 698 recorded phone walks on 13 floors of two shopping centres."""
