"""The magnetic field of a surveyed building as evidence on where a walker is, without and with its radio map."""
