"""Plans of buildings in formats that people have: each becomes a `Plan` through `pdrbench.building.builder`."""
