"""dockloop: docking dynamics as FMUs. The Python side: from scene files to FMUs to results.

Modules, in the order in which a docking passes through them::

    cli        the command line; arguments in, text and exit status out
    scene      scene file + mechanism file + overrides -> one resolved document
    schema     both files against their JSON Schemas, errors as one sentence
    core       calls the C++ program dockloop-core (checks, placement, model description)
    fmu        resolved document + compiled library -> NAME.fmu
    simulate   drives an FMU with FMPy and records its outputs
    summary    a recorded docking in words and numbers
    plots      the same as figures
    figures    how figures are written, and that they may be missing
    outputs    which files a command may replace, and how all files are written

and many of them::

    sampling      sweep file -> the values of every case
    sweep         plans cases, runs them on Dask workers, keeps a journal that can be resumed
    batch         the same cases on threads of the compiled core
    journal       results as they arrive, to go on with after an interruption
    cases         what happens on a worker: one case of a loaded FMU
    sweep_report  the table, its summary in words and numbers, figures

Nothing here computes dynamics; that is the C++ core inside the FMU.
"""

__version__ = "0.1.0"
