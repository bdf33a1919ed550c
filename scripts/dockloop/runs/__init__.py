"""One docking in this process, and whether it is right."""
