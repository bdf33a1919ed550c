"""Where a scene holds, over two quantities: right, refused or wrong, and what that costs.

``verdicts`` lets `dockloop.studies.envelopes.search` refine its mesh where verdicts of
`dockloop.runs.judging` change, ``report`` writes the page with its picture and tables, ``command``
is the work of ``dockloop map``.
"""
