"""An FMU: made, described, driven by a host."""
