"""Plans of buildings in formats that people have: each becomes a `Plan` through `pdrbench_formats.maps.builder`."""
