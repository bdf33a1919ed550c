"""Parameters from measurements with their uncertainty: ``dockloop fit``.

``order`` says what is asked for and does it, ``trials`` reads the tests and their tables,
``problem`` runs the scene and has residuals and their derivatives, ``search`` minimises them,
``statistics`` says what follows from them, ``profile`` how far that is true, ``plan`` which test
would say most, ``report`` has words and figures, ``command`` is the command and `fit`.
"""
