"""FootSLAM (Robertson, Angermann & Krach 2009): a map of transitions between hexagons, learned while walking."""
