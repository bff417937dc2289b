"""`MallPhone-v2` and `MallPhoneLost-v2`: 698 recorded phone walks on 13 floors of two shopping centres."""
