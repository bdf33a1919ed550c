"""Many dockings: their values, where they run, what they left behind."""
