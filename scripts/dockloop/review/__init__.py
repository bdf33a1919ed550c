"""The report of one docking for a review board."""
