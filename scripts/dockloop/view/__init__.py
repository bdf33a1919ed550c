"""``dockloop view``: a docking in three dimensions, as one page that opens offline.

`geometry` takes shapes from the resolved scene, `mesh` reads meshes, `results` reads result
files, `page` puts all into one HTML file with the viewer in ``web/``, `browser` drives Chromium,
`pictures` lets it draw stills and films, `command` is the work of the command.
"""
