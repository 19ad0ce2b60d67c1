"""The workbench page: the loop from a log to a better model, in a browser.

``page`` draws, ``session`` remembers, ``worker`` starts one process for each session, and there
``views`` asks ``ident``.  Nothing of the page computes, so nothing that computes blocks it.
"""
