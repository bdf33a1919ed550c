"""The compiled core and its programs, as Python calls them."""
