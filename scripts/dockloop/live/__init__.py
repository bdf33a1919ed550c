"""``dockloop live``: a page with sliders that computes the docking anew while one moves.

`bench` computes what the page asks for, the newest request only; `export` says the same docking as
command, Python lines and scene file; `server` lets a browser on this machine, and nothing else,
ask. The page is that of ``dockloop view`` with the panel in ``web/``.
"""
