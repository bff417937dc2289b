"""`RetailPhone-v1` and `RetailPhoneLost-v1`: shopping centres of the set "Indoor Location & Navigation" of 2021."""
