"""The boundary of a criterion in two or three quantities, found with few dockings.

``mesh`` refines cells where dockings differ, ``search`` runs the dockings that the mesh asks for,
``report`` says and draws what was found, ``command`` is `dockloop.envelope` and the work of
``dockloop envelope``.
"""
