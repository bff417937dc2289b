"""Pictures and pages of recordings that were tried, of plans and of formats."""
