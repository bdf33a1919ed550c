"""Measured time histories next to a run: ``dockloop compare``.

``data`` reads the table of measurements, ``overlay`` finds the time shift and the differences,
``drawing`` draws them, ``command`` is the work of the command. (The folder ``src/compare`` has
methods of integration for comparison; it has nothing to do with measurements.)
"""
