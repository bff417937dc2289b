"""What `BuildingBuilder` does with a drawing, one step in each module: areas, doors, stairs and lifts, joining."""
