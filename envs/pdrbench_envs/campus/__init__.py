"""The Campus environments: a new building, person and device for every walk, in kinds that are drawn evenly."""
