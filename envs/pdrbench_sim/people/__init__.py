"""People, the routes they plan, the walks they take and where their feet rest."""
