"""Mechanisms of other tools: MJCF, URDF and SDF come in, MJCF goes out.

`constructs` lists what each format has and what becomes of it; a reader (`mjcf`, `urdf`, `sdf`)
makes a `robot` of a file; `tree` cuts its loops; `document` writes the mechanism; `exporting` goes
the other way.
"""
